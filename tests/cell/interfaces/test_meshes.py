"""Meshes: read from files of either kind, parted into shells, and made into types of parts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bracket_cell.commands.new import stl
from bracket_ground.errors import InputError
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.meshes import hull_of, loaded
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import PartType, Product
from tests import ROOT

EXAMPLE = ROOT / "config" / "examples" / "mesh"
UNIT = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])


def box(size: tuple[float, float, float], low: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Array:
    """Corners (8, 3)."""
    corners: Array = UNIT * size + np.array(low)
    return corners


@pytest.mark.parametrize("seed", range(5))
def test_a_hull_looks_outwards_and_has_volume_and_middle_of_its_solid(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size, low = rng.uniform(0.01, 0.1, 3), rng.uniform(-1, 1, 3)
    inner = rng.uniform(0.1, 0.9, (20, 3))
    hull = hull_of(np.concatenate([UNIT, inner]) * size + low)
    assert len(hull.points_m) == 8
    assert hull.volume_m3 == pytest.approx(float(np.prod(size)))
    assert hull.middle_m == pytest.approx(low + size / 2)
    assert ((hull.corners_m[:, 0] - hull.middle_m) * hull.normals).sum(axis=1).min() > 0


def test_a_mesh_is_read_back_in_its_shells(tmp_path: Path) -> None:
    hulls = (box((0.02, 0.03, 0.04)), box((0.05, 0.01, 0.01), (0.02, 0.0, 0.0)))
    file = tmp_path / "two.stl"
    file.write_bytes(stl(hulls))
    pieces = loaded(file).pieces
    assert sorted(piece.volume_m3 for piece in pieces) == pytest.approx([5e-6, 24e-6], rel=1e-3)


def test_obj_files_are_read_too(tmp_path: Path) -> None:
    hull = hull_of(box((0.02, 0.03, 0.04)))
    lines = [f"v {x} {y} {z}" for x, y, z in hull.points_m] + [
        f"f {a + 1} {b + 1} {c + 1}" for a, b, c in hull.triangles
    ]
    file = tmp_path / "one.obj"
    file.write_text("\n".join(lines))
    assert loaded(file).volume_m3 == pytest.approx(24e-6, rel=1e-4)


def test_the_shipped_example_is_made_of_its_shells_and_needs_no_file_any_more() -> None:
    product = load_yaml(EXAMPLE / "product.yaml", Product)
    kind = product.parts["housing"]
    assert [solid.solid for solid in kind.solids] == ["hull", "hull"]
    assert sum(solid.volume_m3 for solid in kind.solids) == pytest.approx(46.8e-6, rel=0.01)
    assert Product.model_validate_json(product.model_dump_json()) == product


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ("mesh: nothing.stl", "there is no file"),
        ("mesh: product.yaml", "makes them of STEP"),
        ("mesh: housing.stl", "is it in millimetres"),
        ("mesh: housing.part.stl\n    shape: box", "give either mesh or shape"),
        ("mesh: housing.part.stl\n    peg_diameter_m: 0", "a peg has a diameter and a length"),
    ],
)
def test_what_cannot_be_a_part_is_refused_with_its_line(tmp_path: Path, change: str, why: str) -> None:
    for name in ("housing.stl", "housing.part.stl"):
        (tmp_path / name).write_bytes((EXAMPLE / name).read_bytes())
    text = (EXAMPLE / "product.yaml").read_text()
    if "peg" in change:
        text = text.replace("    peg_diameter_m: 0.022\n", "", 1)
    file = tmp_path / "product.yaml"
    file.write_text(text.replace("mesh: housing.part.stl", change, 1))
    with pytest.raises(InputError, match=why) as refused:
        load_yaml(file, Product)
    assert str(refused.value).startswith(f"{file}:")


def test_a_part_without_a_peg_is_its_body() -> None:
    kind = PartType(title="block", size_m=(0.04, 0.03, 0.02), colour_rgb=(1, 0, 0), mass_kg=0.1)
    assert kind.whole == kind.solids
