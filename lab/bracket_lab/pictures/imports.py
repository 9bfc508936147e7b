"""Labels of other programs, read into a folder of pictures: their categories become the product's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np

from bracket_cell.learned.hands.records import HandRow
from bracket_cell.learned.hands.regions import POINTS
from bracket_cell.learned.records import MOST_PROBLEMS, Hole, PartRow
from bracket_ground.errors import InputError, mistakes
from bracket_ground.interfaces.product import Product
from bracket_lab.pictures.foreign import SHARES, ForeignBox, read_foreign
from bracket_lab.pictures.labels import COVERED, EMPTY, HAND, HOLE, LabelFolder, PictureLabels, Size, categories, fit_of

SAME_SHAPE, OUTSIDE = 0.02, 0.005  # shares by which shapes of one picture may differ, and boxes reach over its edge
NEAREST_PX = 12.0  # from the middle of a box to the hole that it is of


def read_labels(
    folder: LabelFolder,
    path: Path,
    holes_px: Mapping[str, Mapping[str, tuple[float, float]]],
    renamed: Mapping[str, str] | None = None,
) -> dict[str, PictureLabels]:
    """The labels of another program, by picture of the folder; pictures are known by their names, wherever they lie.

    Args:
        renamed: names of this product by those of the file; an empty one leaves boxes out.

    Raises:
        InputError: the file cannot be read, names one picture twice, or what nobody knows, or boxes lie outside.
    """
    names, problems = _Names(folder.product, renamed or {}), list[str]()
    rows = {name: row for row in folder.pictures for name in (Path(row.file).name, Path(row.file).stem)}
    given: dict[str, list[tuple[str, ForeignBox]]] = {}
    for picture in read_foreign(path):
        called = PurePosixPath(picture.name.replace("\\", "/"))
        row = rows.get(called.name) or rows.get(called.stem)
        if row is None:
            problems.append(f"{path}: no picture {picture.name} in {folder.path}")
            continue
        if row.file in given:
            problems.append(f"{path}: has labels of {called.name} twice; legal: once a picture, each of another name")
        boxes, size_px = given.setdefault(row.file, []), folder.size_px(row)
        for box in picture.boxes:
            if name := names.of(box.category, box.where):
                try:
                    boxes.append((name, _placed(box, picture.size_px, row.source_px or size_px, size_px)))
                except ValueError as error:
                    problems.append(f"{box.where}: {error}")
    found = {}
    for file, some in given.items():
        try:
            found[file] = _labels(some, holes_px.get(file, {}))
            folder.check(found[file])
        except ValueError as error:
            problems += [f"{path}: {file}: {what}" for what in mistakes(error)]
    if problems := [*names.unknown(), *problems]:
        raise InputError(*problems[:MOST_PROBLEMS])
    return found


class _Names:
    """Categories of the product by those of a file; only in upper and lower case they may differ by themselves."""

    def __init__(self, product: Product, renamed: Mapping[str, str]) -> None:
        self._legal, self._renamed = categories(product), renamed
        self._unknown: dict[str, list[str]] = {}
        if wrong := [name for name in renamed.values() if name and name not in self._legal]:
            raise InputError(f"--rename: no category {', '.join(wrong)}; legal: {', '.join(self._legal)}")

    def of(self, name: str, where: str) -> str:
        """The product's name; empty where the box is to be left out, or where there is none, which `unknown` says."""
        if name in self._renamed or name in self._legal:
            return self._renamed.get(name, name)
        alike = [legal for legal in self._legal if legal.casefold() == name.casefold()]
        if len(alike) != 1:
            self._unknown.setdefault(name, []).append(where)
            return ""
        return alike[0]

    def unknown(self) -> list[str]:
        """What to say of names that nobody knows."""
        return [
            f"{some[0]}: no category {name!r} ({len(some)} boxes); legal: {', '.join(self._legal)}; give it a name "
            f"with --rename {name!r}=NAME, or leave its boxes out with --rename {name!r}="
            for name, some in self._unknown.items()
        ]


def _placed(box: ForeignBox, told_px: tuple[float, float] | None, source_px: Size, size_px: Size) -> ForeignBox:
    """A box, with its keypoints, in the folder's picture.

    Args:
        told_px: size of the picture that the box is told in.
        source_px: that of the picture before it was fitted into the folder's size, `size_px`.

    Raises:
        ValueError: it lies outside, or was told in a picture of another shape.
    """
    width, height = told_px or source_px
    if told_px not in (None, SHARES) and abs(width * source_px[1] / (height * source_px[0]) - 1) > SAME_SHAPE:
        raise ValueError(
            f"is told in a picture of {width:g} x {height:g}, and the picture here has {source_px[0]} x {source_px[1]}:"
            " record the pictures that the labels were exported with"
        )
    shares = np.array(box.box) / (width, height, width, height)
    if not (shares[2:] > shares[:2]).all() or shares.min() < -OUTSIDE or shares.max() > 1 + OUTSIDE:
        left, top, right, bottom = box.box
        where = f"within {width:g} x {height:g}"
        raise ValueError(
            f"a box of {left:g}, {top:g}, {right:g}, {bottom:g} (left, top, right, bottom): must lie {where}"
        )
    scale, shift = fit_of(source_px, size_px)
    placed = shares.clip(0, 1).reshape(2, 2) * np.array(source_px) * scale + shift
    left, top, right, bottom = (float(value) for value in placed.reshape(4))
    points = np.array(box.keypoints).reshape(-1, 3)
    points[:, :2] = points[:, :2] / (width, height) * np.array(source_px) * scale + shift
    return replace(box, box=(left, top, right, bottom), keypoints=tuple(points.ravel().tolist()))


def _labels(given: Sequence[tuple[str, ForeignBox]], holes_px: Mapping[str, tuple[float, float]]) -> PictureLabels:
    holes, hands, parts = [], [], []
    for name, placed in given:
        box = placed.box
        if name == HAND:
            points = np.array(placed.keypoints).reshape(-1, 3)[: len(POINTS)]
            known = {name: (x, y) for name, (x, y, shown) in zip(POINTS, points.tolist(), strict=False) if shown > 0}
            hands.append(HandRow(box_px=box, points_px=known, known=False))
        elif name.startswith(HOLE):
            middle = (box[0] + box[2]) / 2, (box[1] + box[3]) / 2
            holes.append(_hole(name.removeprefix(HOLE), middle, holes_px, placed.where))
        else:
            parts.append(PartRow(part=name, whole_box_px=box))
    return PictureLabels(holes=tuple(holes), hands=tuple(hands), parts=tuple(parts))


def _hole(what: str, middle: tuple[float, float], holes_px: Mapping[str, tuple[float, float]], where: str) -> Hole:
    away = {name: float(np.hypot(x - middle[0], y - middle[1])) for name, (x, y) in holes_px.items()}
    nearest = min(away, key=lambda name: away[name])
    if away[nearest] > NEAREST_PX:
        raise ValueError(f"{where}: is {away[nearest]:.0f} px from the nearest hole, {nearest}")
    if what in (EMPTY, COVERED):
        return Hole(position=nearest, part=None, covered=float(what == COVERED))
    return Hole(position=nearest, part=what)
