"""REGRAD's relation part, V1 and V2, read. Parents lie below: what moves when another is taken away lay on that one.

V1 has `<split>/<scene>/mrt.json` and `<split>/<scene>/<view>/{info.json, rgb.jpg}`; V2 has all of a split in
`<split>/mrts.json` and `<split>/objects.json`. One object is called "table": a model like the others.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2

from bracket_ground.errors import InputError, Place, Problem
from bracket_ground.files.files import read_text
from bracket_ground.files.yaml_file import place_of
from bracket_ground.interfaces.stacks import StackedObject, StackedScene
from bracket_lab.experiments.stacks.checks import Part, StackData, faults, require

TRAIN, TEST = "train", "test"
PICTURE, TREE, OBJECTS = "rgb.jpg", "mrt.json", "info.json"
TREES, ALL_OBJECTS = "mrts.json", "objects.json"
SEGMENT = 10  # a segment's number is ten times its object's, and one more; some files have it as obj_id
_KEYS: dict[Part, str] = {"index": "obj_id", "name": "model_name", "box": "bbox"}

Location = tuple[str | int, ...]


def is_regrad(folder: Path) -> bool:
    """Whether a folder looks like one of REGRAD."""
    return (folder / TRAIN).is_dir() or (folder / TEST).is_dir()


def read_regrad(folder: Path) -> StackData:
    """Read a folder of REGRAD, V1 or V2.

    Raises:
        InputError: all that is wrong, with file and line.
    """
    problems: list[Problem] = []
    images: dict[str, Path] = {}
    splits = []
    for split in (TRAIN, TEST):
        views = list(_views(folder / split))
        if not views:
            problems.append(Problem(Place(folder / split), "the split is empty", f"{TREE} or {TREES}, and pictures"))
        found = []
        for view in views:
            scene = view.read(f"{split}/{view.name}", problems)
            if scene is not None:
                found.append(scene)
                images[scene.name] = view.picture
        splits.append(tuple(found))
    require(problems)
    return StackData(splits[0], splits[1], images)


class _View:
    """One view of a scene: where its objects and its tree of relations stand.

    Args:
        objects, tree: file and location in it.
    """

    def __init__(self, name: str, picture: Path, objects: tuple[Path, Location], tree: tuple[Path, Location]) -> None:
        self.name, self.picture, self._objects, self._tree = name, picture, objects, tree

    def read(self, name: str, problems: list[Problem]) -> StackedScene | None:
        """The scene; None where it cannot be made out, and what is wrong is told."""
        try:
            parents, names = _parents(*self._tree)
            rows = _list(*self._objects)
            objects, places = _objects(rows, self._objects, parents)
            scene = StackedScene(name, _size(self.picture), objects)
        except InputError as error:
            problems += [one for one in error.problems if isinstance(one, Problem)]
            return None
        keys = [names[one.index] for one in scene.objects]
        found = list(faults(scene, lambda number, part: self._place(places[number], keys[number], part), None))
        problems += found
        return None if found else scene

    def _place(self, row: int, key: str, part: Part) -> Place:
        file, location = self._objects
        if part in _KEYS:
            return place_of(file, (*location, row, _KEYS[part]))
        file, location = self._tree
        return place_of(file, (*location, key))


def _views(split: Path) -> Iterator[_View]:
    if (split / TREES).is_file():
        scenes = _mapping(split / ALL_OBJECTS, ())
        for scene, views in scenes.items():
            for view in _mapping(split / ALL_OBJECTS, (scene,)) if isinstance(views, dict) else ():
                picture = split / scene / view / PICTURE
                yield _View(f"{scene}/{view}", picture, (split / ALL_OBJECTS, (scene, view)), (split / TREES, (scene,)))
        return
    for file in sorted(split.glob(f"*/*/{OBJECTS}")):
        folder = file.parent
        tree = folder.parent / TREE
        yield _View(f"{folder.parent.name}/{folder.name}", folder / PICTURE, (file, ()), (tree, ()))


def _parents(path: Path, location: Location) -> tuple[dict[int, list[int]], dict[int, str]]:
    """Numbers of what lies below each object, and what the object is called, by its number."""
    parents: dict[int, list[int]] = {}
    names: dict[int, str] = {}
    for name, below in _mapping(path, location).items():
        if not isinstance(below, list):
            raise InputError(Problem(place_of(path, (*location, name)), f"the parents of {name} are no list"))
        number = _number(name, path, (*location, name))
        parents[number] = [_number(one, path, (*location, name, place)) for place, one in enumerate(below)]
        names[number] = name
    for number, below_it in parents.items():
        for place, one in enumerate(below_it):
            if one not in parents:
                legal = f"there are {', '.join(map(str, sorted(parents)))}"
                what = f"object {number} has parent {one}, which is not there"
                raise InputError(Problem(place_of(path, (*location, names[number], place)), what, legal))
    return parents, names


def _number(name: object, path: Path, location: Location) -> int:
    """3 of "mug-3"."""
    words = name.rpartition("-")[2] if isinstance(name, str) else ""
    if not words.isdecimal():
        raise InputError(
            Problem(place_of(path, location), f"{name!r} names no object", "a name and a number, as mug-3")
        )
    return int(words)


def _objects(
    rows: Sequence[Any], where: tuple[Path, Location], parents: Mapping[int, Sequence[int]]
) -> tuple[tuple[StackedObject, ...], list[int]]:
    """Objects of a view that are seen, and the rows that they stand in."""
    path, location = where
    numbers: dict[int, int] = {}
    for row, told in enumerate(rows):
        if not isinstance(told, dict) or not {"obj_id", "model_name", "bbox"} <= told.keys():
            legal = "obj_id, model_name and bbox are wanted"
            raise InputError(Problem(place_of(path, (*location, row)), "no object", legal))
        if told["bbox"] is not None:  # what is hidden has none
            numbers[row] = _known(told["obj_id"], parents, path, (*location, row, "obj_id"))
    seen, objects = set(numbers.values()), []
    for row, number in numbers.items():
        fathers = tuple(one for one in parents[number] if one in seen)
        children = tuple(sorted(one for one in seen if number in parents[one]))
        box = rows[row]["bbox"]
        if not (isinstance(box, list) and len(box) == 4 and all(isinstance(side, int | float) for side in box)):
            legal = "four numbers: left, top, right, bottom"
            raise InputError(Problem(place_of(path, (*location, row, "bbox")), f"no box: {box!r}", legal))
        left, top, right, bottom = (float(side) for side in box)
        name = str(rows[row]["model_name"]).strip().lower()
        objects.append(StackedObject(number, name, (left, top, right, bottom), fathers, children))
    if not objects:
        raise InputError(Problem(place_of(path, location), "no object is seen"))
    return tuple(objects), list(numbers)


def _known(number: object, parents: Mapping[int, object], path: Path, location: Location) -> int:
    if isinstance(number, int):
        for one in (number, number // SEGMENT):
            if one in parents:
                return one
    legal = f"there are {', '.join(map(str, sorted(parents)))}"
    raise InputError(Problem(place_of(path, location), f"object {number!r} has no entry among the relations", legal))


def _size(picture: Path) -> tuple[int, int]:
    image = cv2.imread(str(picture))
    if image is None:
        raise InputError(Problem(Place(picture), "cannot be read as a picture", "each view has one"))
    return image.shape[1], image.shape[0]


_documents: dict[Path, tuple[int, Any]] = {}  # the last files, by when they were written


def _document(path: Path) -> Any:
    """What a JSON file holds."""
    text = read_text(path)
    written = hash(text)
    if path not in _documents or _documents[path][0] != written:
        try:
            document = json.loads(text)
        except ValueError as error:
            line = getattr(error, "lineno", 1)
            raise InputError(Problem(Place(path, line), f"not JSON: {error}")) from None
        _documents.clear()
        _documents[path] = written, document
    return _documents[path][1]


def _found(path: Path, location: Location) -> Any:
    found = _document(path)
    for depth, key in enumerate(location):
        try:
            found = found[key]
        except (KeyError, IndexError, TypeError):
            raise InputError(Problem(place_of(path, location[:depth]), f"{key!r} is missing")) from None
    return found


def _mapping(path: Path, location: Location) -> dict[str, Any]:
    found = _found(path, location)
    if not isinstance(found, dict):
        raise InputError(Problem(place_of(path, location), "an object of JSON is wanted"))
    return found


def _list(path: Path, location: Location) -> list[Any]:
    found = _found(path, location)
    if not isinstance(found, list):
        raise InputError(Problem(place_of(path, location), "a list is wanted"))
    return found
