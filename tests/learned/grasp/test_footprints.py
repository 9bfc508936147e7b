"""Where parts stand around a part: what is taught is the geometry, and a mirrored crop has a mirrored answer."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bracket_cell.learned.grasp.boxes import boxes_of
from bracket_cell.learned.grasp.crops import CHANNELS, CROP_PX
from bracket_cell.learned.grasp.settings import DetectionNoise
from bracket_lab.learned.grasp.scenes import Scene, draw_scenes
from tests.learned.grasp.layouts import PRODUCT, moved, standing

pytestmark = pytest.mark.torch  # torch is imported in the tests alone: other processes collect this file, too
TYPES = list(PRODUCT.parts)


def test_bodies_fill_the_cells_where_they_stand() -> None:
    from bracket_lab.learned.grasp.footprints import CELL_M, MAP_PX, true_maps

    parts = (standing("o1", 0.0, 0.0), standing("o3", -0.01, 0.048))
    turned = tuple(moved(part, 0.05, -0.08, 0.9) for part in parts)
    boxes = boxes_of(turned, PRODUCT)
    scene = Scene(boxes, np.zeros((2, 1, 2), bool), turned, DetectionNoise())
    own = true_maps(scene, TYPES)[0].astype(float) / 255
    for name, place in (("o1", (0.0, 0.0)), ("o3", (-0.01, 0.048))):
        found = own[TYPES.index(name)]
        rows, columns = np.mgrid[:MAP_PX, :MAP_PX]
        middle = [((some - (MAP_PX - 1) / 2) * found).sum() / found.sum() * CELL_M for some in (columns, rows)]
        assert middle == pytest.approx(place, abs=0.001)
        length, width, _ = PRODUCT.parts[name].size_m
        assert found.sum() * CELL_M**2 == pytest.approx(length * width, rel=0.05)
    assert not own[TYPES.index("o2")].any()


def test_seen_from_its_other_end_a_part_has_its_surroundings_turned() -> None:
    from bracket_lab.learned.grasp.footprints import true_maps

    parts = (standing("o2", 0.01, 0.0, 0.4), standing("o1", 0.05, 0.04, 1.1))
    back = (standing("o2", 0.01, 0.0, 0.4 + math.pi), parts[1])
    there, again = (
        true_maps(Scene(boxes_of(parts, PRODUCT), np.zeros((2, 1, 2), bool), some), TYPES)[0] for some in (parts, back)
    )
    assert np.abs(there.astype(int) - again[:, ::-1, ::-1].astype(int)).max() <= 40  # a quarter of a pixel's edge


@pytest.mark.slow
def test_the_network_learns_where_parts_stand() -> None:
    from bracket_lab.learned.grasp.footprints import fit_footprints, true_maps

    scenes = list(draw_scenes(PRODUCT, 3, 2, "train"))
    rng, crops = np.random.default_rng(0), []
    for scene in scenes:  # images in which every type has a colour of its own
        maps = true_maps(scene, TYPES).repeat(2, axis=2).repeat(2, axis=3)
        noise = rng.integers(0, 256, (len(maps), CHANNELS - len(TYPES), CROP_PX, CROP_PX), np.uint8)
        crops.append(np.concatenate([maps, noise], axis=1))
    network = fit_footprints(crops, scenes, TYPES, 0, 400 * sum(map(len, crops)))
    told = np.concatenate([network.maps(some) for some in crops])
    wanted = np.concatenate([true_maps(scene, TYPES) for scene in scenes])
    assert np.mean((told > 127) != (wanted > 127)) < 0.25 * np.mean(wanted > 127)


def test_the_same_crops_give_the_same_network() -> None:
    from bracket_lab.learned.grasp.footprints import fit_footprints

    scenes = list(draw_scenes(PRODUCT, 4, 5, "train"))
    rng = np.random.default_rng(0)
    crops = [rng.integers(0, 256, (len(scene.parts), CHANNELS, CROP_PX, CROP_PX), np.uint8) for scene in scenes]
    first, second = (fit_footprints(crops, scenes, TYPES, 0, 100) for _ in range(2))
    assert np.array_equal(first.maps(crops[0]), second.maps(crops[0]))


def test_a_mirrored_crop_leans_the_other_way() -> None:
    import torch

    from bracket_lab.learned.grasp.footprints import flipped_crops

    crops = torch.randint(0, 256, (3, CHANNELS, CROP_PX, CROP_PX), dtype=torch.uint8)
    found = flipped_crops(crops, [3])
    assert torch.equal(found[:, :3], crops[:, :3].flip(3))
    assert torch.equal(found[:, 3], 255 - crops[:, 3].flip(2))
    assert torch.equal(found[:, 4], crops[:, 4].flip(2))
    assert torch.equal(flipped_crops(found, [3]), crops)
