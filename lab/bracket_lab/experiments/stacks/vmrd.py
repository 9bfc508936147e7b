"""VMRD's folder: one writer, one reader. Annotations (Pascal VOC), ImageSets/Main, JPEGImages, Grasps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.parsers import expat
from xml.sax.saxutils import escape

from bracket_ground.errors import InputError, Place, Problem
from bracket_ground.files.files import read_text
from bracket_ground.interfaces.stacks import VMRD_CLASSES, StackedObject, StackedScene, StackGrasp
from bracket_lab.experiments.stacks.checks import Part, StackData, faults, require, require_splits

ANNOTATIONS, GRASPS, IMAGES, SPLITS = "Annotations", "Grasps", "JPEGImages", "ImageSets/Main"
DRAWN_FROM = "drawn_from"  # of drawn pictures alone
TRAINVAL, TEST = "trainval.txt", "test.txt"
CORNERS = 8
_TAGS: dict[Part, str] = {
    "index": "index",
    "name": "name",
    "box": "bndbox",
    "fathers": "father",
    "children": "children",
}


def write_scene(folder: Path, scene: StackedScene, jpeg: bytes) -> None:
    """Write one picture with its labels; the splits come last, by `write_splits`."""
    grasps = (" ".join(f"{value:g}" for value in grasp.corners_px) + f" {grasp.index}\n" for grasp in scene.grasps)
    _put(folder / IMAGES / f"{scene.name}.jpg", jpeg)
    _put(folder / GRASPS / f"{scene.name}.txt", "".join(grasps).encode())
    _put(folder / ANNOTATIONS / f"{scene.name}.xml", _annotation(scene).encode())


def write_splits(folder: Path, trainval: Iterable[str], test: Iterable[str]) -> None:
    """Write which pictures are for training and which for tests."""
    for file, names in ((TRAINVAL, trainval), (TEST, test)):
        _put(folder / SPLITS / file, "".join(f"{name}\n" for name in names).encode())


def read_vmrd(folder: Path) -> StackData:
    """Read a folder of VMRD.

    `father` lies below and is taken after; `children` lie on top and are taken before.

    Raises:
        InputError: all that is wrong, with file and line.
    """
    if not (folder / SPLITS).is_dir():
        raise InputError(
            Problem(Place(folder), "no folder of stacks", f"{SPLITS}, as `cell lab data stacks` writes it")
        )
    splits = {
        file: read_text(file, "a folder of VMRD has it").split()
        for file in (folder / SPLITS / TRAINVAL, folder / SPLITS / TEST)
    }
    require_splits(splits)
    problems: list[Problem] = []
    scenes = [tuple(_read_scenes(folder, names, file, problems)) for file, names in splits.items()]
    require(problems)
    images = {scene.name: folder / IMAGES / f"{scene.name}.jpg" for some in scenes for scene in some}
    return StackData(scenes[0], scenes[1], images)


def _read_scenes(folder: Path, names: list[str], split: Path, problems: list[Problem]) -> Iterator[StackedScene]:
    for line, name in enumerate(names, 1):
        if not (folder / IMAGES / f"{name}.jpg").is_file():
            problems.append(Problem(Place(split, line), f"there is no picture {folder / IMAGES / name}.jpg"))
        try:
            yield read_scene(folder, name)
        except InputError as error:
            problems += [
                problem if isinstance(problem, Problem) else Problem(Place(split, line), problem)
                for problem in error.problems
            ]


def read_scene(folder: Path, name: str) -> StackedScene:
    """Read the labels of one picture.

    Raises:
        InputError: all that is wrong in them.
    """
    path = folder / ANNOTATIONS / f"{name}.xml"
    root = _parsed(path)
    nodes = [node for node in root.children if node.tag == "object"]
    size = _size(root)
    objects = tuple(_object(node) for node in nodes)
    if not objects:
        raise InputError(Problem(Place(path, root.line), "no <object>", "a picture has 1 or more"))
    drawn_from = root.one(DRAWN_FROM).whole() if any(node.tag == DRAWN_FROM for node in root.children) else None
    scene = StackedScene(name, size, objects, drawn_from=drawn_from)
    require(faults(scene, lambda number, part: nodes[number].one(_TAGS[part]).place, VMRD_CLASSES))
    return replace(scene, grasps=_read_grasps(folder / GRASPS / f"{name}.txt", objects))


def _annotation(scene: StackedScene) -> str:
    width, height = scene.size_px
    drawn = [] if scene.drawn_from is None else [f"  <{DRAWN_FROM}>{scene.drawn_from}</{DRAWN_FROM}>"]
    lines = [
        "<annotation>",
        f"  <filename>{escape(scene.name)}.jpg</filename>",
        f"  <size><width>{width}</width><height>{height}</height><depth>3</depth></size>",
        *drawn,
    ]
    for item in scene.objects:
        sides = zip(("xmin", "ymin", "xmax", "ymax"), item.box_px, strict=True)
        box = "".join(f"<{side}>{value + 1:g}</{side}>" for side, value in sides)
        top = [] if item.top_m is None else [f"    <top_m>{item.top_m:g}</top_m>"]
        lines += [
            "  <object>",
            f"    <name>{escape(item.name)}</name>",
            f"    <bndbox>{box}</bndbox>",
            f"    <difficult>{int(item.difficult)}</difficult>",
            f"    <index>{item.index}</index>",
            f"    <father>{_numbers(item.fathers)}</father>",
            f"    <children>{_numbers(item.children)}</children>",
            *top,
            "  </object>",
        ]
    return "\n".join([*lines, "</annotation>", ""])


def _numbers(indices: Iterable[int]) -> str:
    return "".join(f"<num>{index}</num>" for index in indices)


def _put(file: Path, content: bytes) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(content)


@dataclass
class _Node:
    """An XML element with its line."""

    tag: str
    place: Place
    text: str = ""
    children: list[_Node] = field(default_factory=list)

    @property
    def line(self) -> int | None:
        return self.place.line

    def one(self, tag: str) -> _Node:
        """The only child of this tag; raises InputError where there is none, or more than one."""
        found = [node for node in self.children if node.tag == tag]
        if len(found) != 1:
            count = "no" if not found else f"{len(found)} times"
            raise InputError(Problem(self.place, f"<{self.tag}> has {count} <{tag}>", "exactly one is wanted"))
        return found[0]

    def number(self) -> float:
        """Its text as a number; raises InputError where it is none."""
        try:
            value = float(self.text)
        except ValueError:
            value = float("nan")
        if value != value or abs(value) == float("inf"):
            raise InputError(Problem(self.place, f"<{self.tag}> is {self.text.strip()!r}", "a number is wanted"))
        return value

    def whole(self) -> int:
        """Its text as a whole number."""
        value = self.number()
        if value != int(value):
            raise InputError(Problem(self.place, f"<{self.tag}> is {self.text.strip()!r}", "a whole number is wanted"))
        return int(value)


def _parsed(path: Path) -> _Node:
    """The root of an XML file."""
    text = read_text(path, "each picture of a split has one")
    parser, root = expat.ParserCreate(), _Node("", Place(path, 1))
    stack = [root]

    def begin(tag: str, _: object) -> None:
        stack[-1].children.append(_Node(tag, Place(path, parser.CurrentLineNumber)))
        stack.append(stack[-1].children[-1])

    def end(_: str) -> None:
        stack.pop()

    def characters(some: str) -> None:
        stack[-1].text += some

    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = begin, end, characters
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        what = f"this is not well-formed XML: {expat.ErrorString(error.code)}"
        raise InputError(Problem(Place(path, error.lineno, error.offset + 1), what)) from None
    return root.one("annotation")


def _size(root: _Node) -> tuple[int, int]:
    size = root.one("size")
    width, height = size.one("width").whole(), size.one("height").whole()
    if min(width, height) < 1:
        raise InputError(Problem(size.place, f"a picture of {width} x {height} pixels", "both are 1 or more"))
    return width, height


def _object(node: _Node) -> StackedObject:
    optional = {child.tag: child for child in node.children}
    box = node.one("bndbox")
    left, top, right, bottom = (box.one(side).number() - 1 for side in ("xmin", "ymin", "xmax", "ymax"))
    return StackedObject(
        node.one("index").whole(),
        node.one("name").text.strip().lower(),
        (left, top, right, bottom),
        tuple(_members(node.one("father"))),
        tuple(_members(node.one("children"))),
        optional["top_m"].number() if "top_m" in optional else None,
        "difficult" in optional and optional["difficult"].whole() != 0,
    )


def _members(node: _Node) -> Iterator[int]:
    for child in node.children:
        if child.tag != "num":
            raise InputError(Problem(child.place, f"<{child.tag}> in <{node.tag}>", "only <num> is legal here"))
        yield child.whole()
    if node.text.strip():
        raise InputError(Problem(node.place, f"<{node.tag}> holds {node.text.strip()!r}", "only <num> is legal here"))


def _read_grasps(path: Path, objects: tuple[StackedObject, ...]) -> tuple[StackGrasp, ...]:
    """Rectangles of a file, a line each; a picture without a file has none."""
    if not path.is_file():
        return ()
    found, known = [], {item.index for item in objects}
    for line, text in enumerate(read_text(path).splitlines(), 1):
        words = text.split()
        if not words:
            continue
        try:
            x1, y1, x2, y2, x3, y3, x4, y4 = (float(word) for word in words[:CORNERS])
            index = int(words[CORNERS])
        except (ValueError, IndexError):
            legal = "x and y of four corners and an object's index are wanted"
            raise InputError(Problem(Place(path, line), f"no grasp: {text.strip()!r}", legal)) from None
        if index not in known:
            legal = f"there are {', '.join(map(str, sorted(known)))}"
            raise InputError(Problem(Place(path, line), f"a grasp of object {index}, which is not there", legal))
        found.append(StackGrasp((x1, y1, x2, y2, x3, y3, x4, y4), index))
    return tuple(found)
