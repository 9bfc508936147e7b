"""Parts cut out of photographs on a plain sheet, and pasted onto pictures of trays: boxes that nobody has to draw.

Cut and paste (Dwibedi, Cut, Paste and Learn, 2017): what differs from the sheet's colour is the part.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.records import PartRow, read_image
from bracket_ground.errors import InputError
from bracket_ground.files.data_folder import DataFolder
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.observation import Image
from bracket_ground.interfaces.product import PartType, Product
from bracket_lab.pictures.labels import fitted, taken_by
from bracket_lab.pictures.sources import PICTURES, camera_pose

SMALL_PX = 400  # longest side of a photograph in which the part is looked for
BORDER_SHARE = 0.04  # of its shorter side: the band along its edges that shows the sheet alone
LEAST_STEP = 12.0  # of colour (CIE Lab), between a sheet and what lies on it
LEAST_SHARE, MOST_SHARE = 0.005, 0.7  # of a photograph that its part may take
LEAST_SOLID = 0.75  # share of what differs that is one piece
GROUPS = 5  # of photographs: those of one group are pasted together, so that scores are of photographs unseen
PASTED = (2, 6)  # parts of an image, by those of the product at most
SIZES, GAIN, SHADOW = 0.2, 0.25, 0.45  # spread of logarithms of sizes; of each channel's light; darkest shadow
LEAST_SEEN = 0.35  # share of a part that others may not hide; what is hidden more has no label
CLOSER = 0.9  # of the way from the look pose to the tray's floor: parts stand on it


@dataclass(frozen=True, eq=False)
class Cutting:
    """A part of a photograph: (height, width, 3) colours, and (height, width) how much of each pixel it covers."""

    image: Image
    mask: NDArray[np.float32]


def cut(file: Path) -> Cutting:
    """The part of a photograph on a plain sheet.

    Raises:
        InputError: no single thing stands out from one colour.
    """
    image = read_image(file)
    scale = min(1.0, SMALL_PX / max(image.shape[:2]))
    small = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
    lab = cv2.cvtColor(small.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
    band = max(2, round(BORDER_SHARE * min(small.shape[:2])))
    edge = np.ones(small.shape[:2], bool)
    edge[band:-band, band:-band] = False
    away = np.linalg.norm(lab - np.median(lab[edge], axis=0), axis=2)
    grey = np.clip(away * 2.5, 0, 255).astype(np.uint8)
    split, _ = cv2.threshold(cv2.GaussianBlur(grey, (0, 0), 1.5), 0, 255, cv2.THRESH_OTSU)
    differs = (away > max(LEAST_STEP, split / 2.5)).astype(np.uint8)
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(
        cv2.morphologyEx(differs, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    )
    areas = np.asarray(stats[1:, cv2.CC_STAT_AREA] if count > 1 else [0], np.float64)
    largest = (pieces == 1 + int(areas.argmax())) & (areas.max() > 0)
    if trouble := _trouble(areas, largest, edge):
        raise InputError(f"{file}: {trouble}")
    hull = _filled(largest.astype(np.uint8))
    left, top, width, height = cv2.boundingRect(hull)
    inside = slice(top, top + height), slice(left, left + width)
    soft = cv2.GaussianBlur(hull.astype(np.float32), (0, 0), 0.7)
    return Cutting(np.ascontiguousarray(small[inside]), np.ascontiguousarray(soft[inside]))


def _trouble(areas: NDArray[np.float64], largest: NDArray[np.bool_], edge: NDArray[np.bool_]) -> str:
    if not LEAST_SHARE <= float(areas.max()) / largest.size <= MOST_SHARE:
        return "no part stands out: lay it alone on a sheet of one colour that it has not, and keep the edges free"
    if float(areas.max()) < LEAST_SOLID * float(areas.sum()):
        return "several things stand out from the sheet: one part on each photograph"
    return "the part reaches the edge of the photograph" if (largest & edge).mean() > LEAST_SHARE / 2 else ""


def _filled(piece: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """With its holes, but those that are seen through stay: larger than a hundredth of it."""
    holes = (1 - piece).astype(np.uint8)
    count, parts, stats, _ = cv2.connectedComponentsWithStats(holes)
    for number in range(1, count):
        if stats[number, cv2.CC_STAT_AREA] < piece.sum() / 100:
            piece[parts == number] = 1
    return piece


def cuttings_of(folder: Path, product: Product) -> tuple[dict[str, list[Cutting]], list[str]]:
    """Parts cut out of `folder/TYPE/*`, by type, and why photographs are left out.

    Raises:
        InputError: a type has no photograph that can be cut.
    """
    found: dict[str, list[Cutting]] = {}
    left_out: list[str] = []
    for part in product.parts:
        files = sorted(file for file in (folder / part).glob("*") if file.suffix.lower() in PICTURES)
        found[part] = []
        for file in files:
            try:
                found[part].append(cut(file))
            except InputError as error:
                left_out.append(str(error))
    if bare := [part for part, cuttings in found.items() if not cuttings]:
        legal = f"a folder for each type ({', '.join(product.parts)}) with photographs of one part each"
        raise InputError(f"{folder}: nothing could be cut out for {', '.join(bare)}; legal: {legal}", *left_out)
    return found, left_out


class Paster:
    """Pastes cuttings onto pictures, as large as the wrist camera sees parts in the tray."""

    def __init__(self, cuttings: Mapping[str, Sequence[Cutting]], product: Product, bench: Bench) -> None:
        self._cuttings, self._product, self._setup = cuttings, product, bench.wrist
        self._groups = min(GROUPS, *(len(some) for some in cuttings.values()))
        pose = camera_pose(bench, "wrist")
        self._taken_by = taken_by(bench.wrist, pose)
        self._away_m = CLOSER * (pose.position_m[2] - bench.tray.centre_m[2])

    def write(self, folder: DataFolder, behind: Sequence[Image], count: int, seed: int) -> None:
        """So many images and their rows of objects.jsonl, on pictures of the tray, or on plain ground."""
        for number in range(count):
            rng, group = np.random.default_rng([seed, number]), number % self._groups
            image = self._ground(behind, group, rng)
            image, boxes = self._pasted(image, group, rng)
            file = folder.image(f"images/pasted-{number:05d}.jpg", image)
            parts = [PartRow(part=part, whole_box_px=box).model_dump(exclude_unset=True) for part, box in boxes]
            row = {"file": file, "log": f"sheet-{group}", "camera": "wrist", **self._taken_by, "parts": parts}
            folder.row("objects", row)

    def _ground(self, behind: Sequence[Image], group: int, rng: np.random.Generator) -> Image:
        size = self._setup.width_px, self._setup.height_px
        mine = behind[group :: self._groups] or behind
        if len(mine):
            return fitted(mine[int(rng.integers(len(mine)))], self._setup).copy()
        coarse = rng.uniform(40, 220, 3) + rng.normal(0, 12, (6, 8, 3))
        smooth = cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC) + rng.normal(0, 4, (*reversed(size), 3))
        return np.clip(smooth, 0, 255).astype(np.uint8)

    def _pasted(
        self, image: Image, group: int, rng: np.random.Generator
    ) -> tuple[Image, list[tuple[str, tuple[float, float, float, float]]]]:
        types, shown, layers = (
            list(self._product.parts),
            image.astype(np.float32),
            list[tuple[str, NDArray[np.bool_]]](),
        )
        for _ in range(int(rng.integers(*PASTED, endpoint=True))):
            part = types[int(rng.integers(len(types)))]
            mine = self._cuttings[part][group :: self._groups]
            cutting = mine[int(rng.integers(len(mine)))]
            onto = self._onto(cutting, self._product.parts[part], rng)
            size = self._setup.width_px, self._setup.height_px
            mask = cv2.warpAffine(cutting.mask, onto, size)
            colours = cv2.warpAffine(cutting.image, onto, size, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
            shade = cv2.GaussianBlur(np.roll(mask, rng.integers(-6, 7, 2), (0, 1)), (0, 0), float(rng.uniform(2, 7)))
            shown *= 1 - float(rng.uniform(0, SHADOW)) * (shade * (1 - mask))[..., np.newaxis]
            light = np.exp(rng.normal(0, GAIN, 1) + rng.normal(0, GAIN / 5, 3))
            shown += mask[..., np.newaxis] * (colours * light - shown)
            layers.append((part, mask > 0.5))
        return np.clip(shown, 0, 255).astype(np.uint8), _boxes(layers)

    def _onto(self, cutting: Cutting, kind: PartType, rng: np.random.Generator) -> NDArray[np.float64]:
        """(2, 3) from a cutting to the image: as large as its longest side is seen, anywhere, turned anyhow."""
        height, width = cutting.mask.shape
        longest_m = max(*kind.size_m[:2], kind.size_m[2] + kind.peg_length_m)
        longest_px = self._setup.focal_px * longest_m / self._away_m * math.exp(rng.normal(0, SIZES))
        scale, turn = longest_px / max(height, width), rng.uniform(0, 2 * math.pi)
        rotation = scale * np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
        middle = rng.uniform(0.1, 0.9, 2) * (self._setup.width_px, self._setup.height_px)
        return np.column_stack([rotation, middle - rotation @ (np.array([width, height]) / 2)])


def _boxes(layers: Sequence[tuple[str, NDArray[np.bool_]]]) -> list[tuple[str, tuple[float, float, float, float]]]:
    """Type and box of what later layers leave to be seen."""
    found = []
    for number, (part, covers) in enumerate(layers):
        above = np.any([other for _, other in layers[number + 1 :]], axis=0) if number + 1 < len(layers) else False
        if not covers.any() or (covers & ~above).sum() < LEAST_SEEN * covers.sum():
            continue
        rows, columns = np.flatnonzero(covers.any(axis=1)), np.flatnonzero(covers.any(axis=0))
        found.append((part, (float(columns[0]), float(rows[0]), float(columns[-1] + 1), float(rows[-1] + 1))))
    return found
