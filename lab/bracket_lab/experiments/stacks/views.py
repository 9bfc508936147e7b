"""What a planner is asked about: the objects of a picture with features of their regions, kept on the disk."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from bracket_cell.learned.records import read_image
from bracket_ground.files.files import write_whole
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.stacks import StackedScene
from bracket_lab.experiments.stacks.checks import above_of
from bracket_lab.experiments.stacks.detector import Regions, boxes_of, mirrored_boxes

MOST = 8  # objects of a view
Features = NDArray[np.float16]


@dataclass(frozen=True, eq=False)
class StackView:
    """A picture as a planner sees it.

    Attributes:
        names: class of each object.
        boxes: (n, 4) as shares of the picture's width and height.
        regions: (n, features) of the objects.
        unions: (n, n, features) of the boxes around two objects; zero on the diagonal.
        tops_m: (n,) heights of the objects' highest points; None where they are not known.
    """

    names: tuple[str, ...]
    boxes: Array
    regions: Features
    unions: Features
    tops_m: Array | None = None


@dataclass(frozen=True, eq=False)
class Labelled:
    """A view of a scene's own boxes with the answer.

    Attributes:
        children: (n, n), [i, j] whether j is written as lying on i.
        above: (n, n), [i, j] whether j lies on i, also by way of others.
    """

    scene: StackedScene
    view: StackView
    children: NDArray[np.bool_]
    above: NDArray[np.bool_]


def labelled(scene: StackedScene, view: StackView) -> Labelled:
    """The view with the scene's answer; the objects of both are in the same order."""
    place = {item.index: number for number, item in enumerate(scene.objects)}
    count, above_by_index = len(scene.objects), above_of(scene)
    children, above = np.zeros((2, count, count), dtype=bool)
    for item in scene.objects:
        children[place[item.index], [place[child] for child in item.children]] = True
        above[place[item.index], [place[other] for other in above_by_index[item.index]]] = True
    return Labelled(scene, view, children, above)


def true_view(scene: StackedScene, image: NDArray[np.uint8], regions: Regions) -> StackView:
    """A view of the boxes that are written."""
    tops = [item.top_m for item in scene.objects]
    known = np.array(tops, dtype=float) if None not in tops else None
    return replace(_view(boxes_of(scene), [item.name for item in scene.objects], image, regions), tops_m=known)


def seen_view(image: NDArray[np.uint8], regions: Regions) -> StackView:
    """A view of what the detector finds."""
    boxes, names, _ = regions.found(image)
    return _view(boxes, names, image, regions)


def mirrored(scene: StackedScene) -> StackedScene:
    """The scene in the picture turned over."""
    boxes = mirrored_boxes(boxes_of(scene), scene.size_px[0]).tolist()
    objects = (replace(item, box_px=tuple(box)) for item, box in zip(scene.objects, boxes, strict=True))
    return replace(scene, objects=tuple(objects), grasps=())


def _view(boxes: Array, names: Sequence[str], image: NDArray[np.uint8], regions: Regions) -> StackView:
    height, width = image.shape[:2]
    count = len(boxes)
    pairs = list(combinations(range(count), 2))
    around = [np.concatenate([boxes[[i, j], :2].min(axis=0), boxes[[i, j], 2:].max(axis=0)]) for i, j in pairs]
    asked = np.concatenate([boxes.reshape(-1, 4), np.array(around).reshape(-1, 4)])
    features = regions.features(image, asked) if count else np.zeros((0, regions.width), np.float16)
    unions = np.zeros((count, count, features.shape[1]), np.float16)
    for (i, j), union in zip(pairs, features[count:], strict=True):
        unions[i, j] = unions[j, i] = union
    return StackView(tuple(names), boxes / (width, height, width, height), features[:count], unions)


def kept_views(
    path: Path, scenes: Sequence[StackedScene], images: Sequence[Path], regions: Regions, *, seen: bool, turn: bool
) -> list[StackView]:
    """Views of scenes, read from a file where it is there, else made and written.

    Args:
        seen: what the detector finds, instead of the boxes that are written.
        turn: of the pictures turned over.
    """
    if not path.exists():
        drawn = []
        for scene, file in track(
            list(zip(scenes, images, strict=True)),
            f"features {path.stem}",
            console=Console(stderr=True),
            transient=True,
        ):
            image = read_image(file)
            if turn:
                scene, image = mirrored(scene), np.ascontiguousarray(image[:, ::-1])
            drawn.append(seen_view(image, regions) if seen else true_view(scene, image, regions))
        _write(path, drawn)
    return _read(path)


def _write(path: Path, views: Iterable[StackView]) -> None:
    """Unions of i and j are written for i < j alone."""
    views = list(views)
    upper = [np.triu_indices(len(view.names), 1) for view in views]
    kept = {
        "counts": np.array([len(view.names) for view in views]),
        "names": np.array([name for view in views for name in view.names], dtype=str),
        "boxes": np.concatenate([view.boxes.reshape(-1, 4) for view in views]),
        "tops": np.concatenate(
            [np.full(len(view.names), np.nan) if view.tops_m is None else view.tops_m for view in views]
        ),
        "regions": np.concatenate([view.regions for view in views]),
        "unions": np.concatenate([view.unions[rows] for view, rows in zip(views, upper, strict=True)]),
    }
    written = io.BytesIO()
    np.savez(written, **kept)
    write_whole(path, written.getvalue())


def _read(path: Path) -> list[StackView]:
    kept = np.load(path)
    names, boxes, tops, regions, unions = (kept[name] for name in ("names", "boxes", "tops", "regions", "unions"))
    views, first, first_union = [], 0, 0
    for count in kept["counts"].tolist():
        rows, end = np.triu_indices(count, 1), first + count
        both = np.zeros((count, count, regions.shape[1]), np.float16)
        both[rows] = unions[first_union : first_union + len(rows[0])]
        both += both.transpose(1, 0, 2)
        known = None if not count or np.isnan(tops[first:end]).any() else tops[first:end]
        view = StackView(tuple(names[first:end].tolist()), boxes[first:end], regions[first:end], both, known)
        views.append(view)
        first, first_union = end, first_union + len(rows[0])
    return views
