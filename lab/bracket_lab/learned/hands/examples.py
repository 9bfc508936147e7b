"""What the tracker's three networks are shown in training, and what is true of it. Imports torch."""

from __future__ import annotations

import math

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from bracket_cell.learned.hands.refinement import Closeup, middle_of, to_the_right_rad
from bracket_cell.learned.hands.regions import PATCH_PX, POINTS, REGION_PX, planes
from bracket_ground.interfaces.pose import Array
from bracket_lab.learned.hands.augment import drawn_turns, turned_images, turned_points, varied
from bracket_lab.learned.hands.data import EDGE_PX, HandData
from bracket_lab.learned.hands.network import FINDER_CELLS

SHIFT_PX = (PATCH_PX - REGION_PX) // 2  # of a region about its hand, in training
SHIFT_OF_NONE = 0.3  # of that, about what is no hand: else it might show one in its middle
FINDER_NOISE = 0.03  # its images are made small, which averages noise
SCALED_SHARE, LARGEST_SCALE = 0.5, 1.2  # of hands that are made larger or smaller, and by how much
RATIO, OFF_SHARE, OFF_RAD, WRONG_SIDE = 0.1, 0.15, 0.12, 0.03  # of what the refiner learns to correct
PLAIN_SHARE = 0.5  # of close-ups that keep light, colours and sharpness: in clear ones sizes can be told exactly
PATCH_MIDDLE = (PATCH_PX - 1) / 2
MIXED = 0.3  # of the colours: beyond it nobody could tell a part by its paint


def finder_batch(data: HandData, rows: NDArray[np.int64], rng: np.random.Generator) -> dict[str, Tensor]:
    """Small images of frames, some turned, half of the batches mirrored; what is true of their cells."""
    turns, mirrored_all = drawn_turns(len(rows), rng), rng.random() < 0.5
    small = planes(turned_images(data.small[rows], turns))
    image, _ = varied(torch.from_numpy(small), rng, FINDER_NOISE)
    score, offset, weight = (torch.from_numpy(finder_target) for finder_target in finder_targets(data, rows, turns))
    batch = {"image": image, "score": score, "offset": offset, "weight": weight}
    if mirrored_all:
        batch = {name: values.flip(-1) for name, values in batch.items()}
        batch["offset"][:, 0] = 1 - batch["offset"][:, 0]
    return batch


def finder_targets(data: HandData, rows: NDArray[np.int64], turns: Array) -> tuple[NDArray[np.float32], ...]:
    """By frame and cell: score (n, 1, r, c), offset (n, 2, r, c), and weight (n, 1, r, c), 0 if unknown.

    Args:
        rows: (n,) frames, in order.
        turns: (n,) [rad] by which each is turned.
    """
    lines, columns = FINDER_CELLS
    score = np.zeros((len(rows), 1, lines, columns), np.float32)
    offset = np.full((len(rows), 2, lines, columns), 0.5, np.float32)
    weight = np.ones_like(score)
    line, column = np.mgrid[0:lines, 0:columns] + 0.5
    size_px, small_px = data.regions.size_px, np.array(data.small.shape[2:0:-1], np.float64)
    for hands, sure in ((data.unsure, False), (data.centres, True)):
        places = np.searchsorted(rows, hands[:, 0])
        chosen = np.flatnonzero(np.isin(hands[:, 0], rows))
        seen = turned_points(hands[chosen, 1:] - 0.5, turns[places[chosen]], small_px) + 0.5
        inside = (np.minimum(seen, 1 - seen) * size_px).min(axis=1) >= EDGE_PX
        for place, (x, y), shown in zip(places[chosen], seen, inside, strict=True):
            away = (column - x * columns) ** 2 + (line - y * lines) ** 2
            if not (sure and shown):
                weight[place, 0][away < 4] = 0
                continue
            cell = min(lines - 1, int(y * lines)), min(columns - 1, int(x * columns))
            score[place, 0] = np.maximum(score[place, 0], np.exp(-away / 1.5))
            score[place, 0][cell] = 1.0
            weight[place, 0][away < 4] = 1
            offset[(place, slice(None), *cell)] = x * columns - cell[1], y * lines - cell[0]
    return score, offset, weight


def reader_batch(data: HandData, rows: NDArray[np.int64], rng: np.random.Generator) -> dict[str, Tensor]:
    """Regions that do not quite sit on their hands, of other sizes, half of them mirrored; what is true of them."""
    shifts = np.clip(rng.normal(0.0, SHIFT_PX / 2.5, (len(rows), 2)), -SHIFT_PX, SHIFT_PX)
    shifts = (shifts * np.where(data.facts[rows, :1] > 0, 1.0, SHIFT_OF_NONE)).round()
    logs = rng.uniform(-1.0, 1.0, len(rows)) * (rng.random(len(rows)) < SCALED_SHARE) * np.log(LARGEST_SCALE)
    scales = np.exp(logs).astype(np.float32)
    seen = list(zip(rows, scales, shifts, strict=True))
    cuts = [_scaled(data.patches[row], scale, shift) for row, scale, shift in seen]
    around = [
        data.regions.around(data.small[data.frames[row]], data.centres_px[row], shift, float(scale))
        for row, scale, shift in seen
    ]
    places = [data.regions.place(data.centres_px[row]) for row in rows]
    moved = (shifts / REGION_PX).astype(np.float32)
    points, boxes = (shares - 0.5 for shares in (data.points[rows], data.boxes[rows]))
    arrays = {
        "region": planes(np.stack(cuts)),
        "around": planes(np.stack(around)),
        "points": (points - moved[:, np.newaxis]) * scales[:, np.newaxis, np.newaxis] + 0.5,
        "box": (boxes - np.tile(moved, 2)) * scales[:, np.newaxis] + 0.5,
        "facts": data.facts[rows],
        "heights": data.heights_m[rows],
        "angle": data.log_angles[rows] + logs.astype(np.float32),
        "held": data.held[rows],
        "place": np.array(places, np.float32),
    }
    batch: dict[str, Tensor] = {name: torch.from_numpy(np.ascontiguousarray(array)) for name, array in arrays.items()}
    batch["around"], _ = varied(batch["around"], rng, FINDER_NOISE, shades=False)
    batch["region"], mixed = varied(batch["region"], rng, shades=False)
    batch["paint"] = mixed < MIXED
    return mirrored(batch, torch.from_numpy(rng.random(len(rows)) < 0.5))


def refiner_batch(data: HandData, rows: NDArray[np.int64], rng: np.random.Generator) -> dict[str, Tensor]:
    """Close-ups of hands that are not quite upright, in the middle, and as large as they seem; what is true of them."""
    cuts, points, places, ratios = [], [], [], []
    for row in rows:
        true = closeup_in_patch(data, row)
        ratio = float(np.clip(rng.normal(0.0, RATIO), -2.5 * RATIO, 2.5 * RATIO))
        off = rng.normal(0.0, OFF_SHARE, 2) * true.length_px
        turn = rng.normal(0.0, OFF_RAD * (1 + 2 * (rng.random() < 0.1)))
        wrong = rng.random() < WRONG_SIDE
        thought_px = true.length_px * math.exp(-ratio)
        seen = Closeup(true.middle + off, true.right_rad + turn, thought_px, true.mirrored != wrong)
        cuts.append(seen.cut(data.patches[row]))
        points.append(seen.inside((data.points[row, :-1].astype(float) - 0.5) * REGION_PX + PATCH_MIDDLE))
        places.append(seen.aligned(data.regions.from_middle(data.centres_px[row])))
        ratios.append(ratio)
    plain = torch.from_numpy(planes(np.stack(cuts)))
    changed, _ = varied(plain, rng, shades=False)
    stays = torch.from_numpy(rng.random(len(rows)) < PLAIN_SHARE)[:, None, None, None]
    return {
        "closeup": torch.where(stays, plain, changed),
        "points": torch.from_numpy(np.array(points, np.float32)),
        "place": torch.from_numpy(np.array(places, np.float32)),
        "ratio": torch.from_numpy(np.array(ratios, np.float32)),
    }


def closeup_in_patch(data: HandData, row: int) -> Closeup:
    """Where the hand of a patch truly is in it."""
    seen = dict(zip(POINTS, (data.points[row] - 0.5) * REGION_PX, strict=True))
    palm, pinch, wrist = (seen[name] for name in ("palm", "pinch", "wrist"))
    length_px = math.exp(float(data.log_angles[row])) * data.regions.focal_px * REGION_PX / data.regions.side_px
    left = bool(data.facts[row, 1])
    return Closeup(middle_of(palm, pinch) + PATCH_MIDDLE, to_the_right_rad(wrist, palm), length_px, left)


def _scaled(patch: NDArray[np.uint8], scale: float, shift_px: NDArray[np.float64]) -> NDArray[np.uint8]:
    """The region about the middle of a patch, shifted (right, down), and seen so much larger."""
    corner = (PATCH_PX - 1) / 2 + shift_px - (REGION_PX - 1) / 2 / scale
    back = np.array([[1 / scale, 0.0, corner[0]], [0.0, 1 / scale, corner[1]]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    cut = cv2.warpAffine(patch, back, (REGION_PX, REGION_PX), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return cut.astype(np.uint8, copy=False)


def mirrored(batch: dict[str, Tensor], chosen: Tensor) -> dict[str, Tensor]:
    """The chosen rows seen in a mirror: a left hand becomes a right one."""
    hand = chosen & (batch["facts"][:, 0] > 0)
    for name in ("region", "around"):
        batch[name] = torch.where(chosen[:, None, None, None], batch[name].flip(-1), batch[name])
    side = torch.tensor([1.0, 0.0])
    batch["points"] = torch.where(
        chosen[:, None, None], side - batch["points"] * torch.tensor([1.0, -1.0]), batch["points"]
    )
    left, top, right, bottom = batch["box"].unbind(dim=1)
    batch["box"] = torch.where(chosen[:, None], torch.stack([1 - right, top, 1 - left, bottom], dim=1), batch["box"])
    batch["place"] = torch.where(chosen[:, None], batch["place"] * torch.tensor([-1.0, 1.0]), batch["place"])
    batch["facts"][:, 1] = torch.where(hand, 1 - batch["facts"][:, 1], batch["facts"][:, 1])
    return batch
