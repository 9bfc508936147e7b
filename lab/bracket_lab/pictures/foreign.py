"""Boxes of other programs: COCO, YOLO, Pascal VOC and CVAT, read as one kind of labelled picture."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from pydantic import ConfigDict, Field, ValidationError

from bracket_cell.learned.records import MOST_PROBLEMS, Box
from bracket_ground.errors import InputError, Place, Problem, mistakes
from bracket_ground.files.files import read_text
from bracket_ground.files.model import Model
from bracket_ground.files.yaml_file import read_data

LEGAL = "a COCO file (.json), a folder of YOLO (data.yaml or classes.txt), of Pascal VOC (.xml), or a CVAT file (.xml)"
CLASSES = ("classes.txt", "obj.names")  # names by number, one a line, where YOLO has no data.yaml
CVAT_PASSED = ("tag", "points", "polyline")  # of an image, which no box is of
SHARES = (1.0, 1.0)  # the size of a picture whose boxes are told as shares of it


@dataclass(frozen=True)
class ForeignBox:
    """A box in a picture.

    Attributes:
        box: (left, top, right, bottom) in the picture's size.
        keypoints: of COCO, (x, y, visible) each.
        where: file, and line or number.
    """

    category: str
    box: Box
    where: str
    keypoints: tuple[float, ...] = ()


@dataclass(frozen=True)
class ForeignPicture:
    """A picture with its boxes; none say that nothing is there.

    Attributes:
        name: of its file, with or without folder and suffix.
        size_px: (width, height) in which its boxes are told; None where nobody says it.
    """

    name: str
    size_px: tuple[float, float] | None
    boxes: tuple[ForeignBox, ...]


def read_foreign(path: Path) -> list[ForeignPicture]:
    """The labelled pictures of a file or folder.

    Raises:
        InputError: it is of no known format, or wrong, with file and line where they are known.
    """
    if path.name in ("data.yaml", "data.yml", *CLASSES):
        path = path.parent
    if path.is_dir():
        if names := next((file for file in _of_names(path) if file.is_file()), None):
            return list(_yolo(path, names))
        if files := sorted(path.rglob("*.xml")):
            return [picture for file in files for picture in _xml(file)]
        raise InputError(f"{path}: holds no labels; legal: {LEGAL}")
    if path.suffix.lower() == ".xml":
        return _xml(path)
    if path.suffix.lower() == ".json":
        return _coco(path)
    raise InputError(f"{path}: is of no known format; legal: {LEGAL}")


class _Some(Model):
    """Keys that COCO has besides are passed over."""

    model_config = ConfigDict(extra="ignore")


class _Picture(_Some):
    id: int
    file_name: str
    width: int | None = Field(default=None, gt=0)
    height: int | None = Field(default=None, gt=0)


class _Category(_Some):
    id: int
    name: str


class _Annotation(_Some):
    id: int = 0
    image_id: int
    category_id: int
    bbox: tuple[float, float, float, float]
    keypoints: tuple[float, ...] = ()


class _CocoFile(_Some):
    images: tuple[_Picture, ...]
    categories: tuple[_Category, ...]
    annotations: tuple[_Annotation, ...]


def _coco(path: Path) -> list[ForeignPicture]:
    try:
        read = _CocoFile.model_validate_json(read_text(path))
    except ValidationError as error:
        told = mistakes(error)[:MOST_PROBLEMS]
        raise InputError(*(Problem(Place(path), what, f"legal: {LEGAL}") for what in told)) from None
    name_of = {category.id: category.name for category in read.categories}
    boxes: dict[int, list[ForeignBox]] = {image.id: [] for image in read.images}
    for annotation in read.annotations:
        if annotation.image_id not in boxes:
            raise InputError(
                Problem(Place(path), f"annotation {annotation.id}: there is no image {annotation.image_id}")
            )
        left, top, width, height = annotation.bbox
        name = name_of.get(annotation.category_id, f"number {annotation.category_id}")
        at = f"annotation {annotation.id}"
        if len(annotation.keypoints) % 3:
            raise InputError(Problem(Place(path), f"{at}: keypoints must be x, y, visible of each"))
        boxes[annotation.image_id].append(
            ForeignBox(name, (left, top, left + width, top + height), f"{path}: {at}", annotation.keypoints)
        )
    return [
        ForeignPicture(
            image.file_name,
            (image.width, image.height) if image.width and image.height else None,
            tuple(boxes[image.id]),
        )
        for image in read.images
    ]


def _of_names(folder: Path) -> Iterator[Path]:
    """Where YOLO may say what its numbers mean; in the folder, or in the one that its labels are in."""
    for there in (folder, folder.parent, folder.parent.parent):
        yield from (there / name for name in ("data.yaml", "data.yml", *CLASSES))
        if there == folder and any(folder.rglob("*.xml")):
            return


def _yolo(folder: Path, names_file: Path) -> Iterator[ForeignPicture]:
    text, names, pose = read_text(names_file), dict[int, str](), False
    if names_file.name in CLASSES:
        names = dict(enumerate(line.strip() for line in text.splitlines() if line.strip()))
    else:
        data = read_data(names_file, text)
        pose = isinstance(data, dict) and "kpt_shape" in data
        data = data.get("names") if isinstance(data, dict) else None
        pairs = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
        names = {int(number): str(name) for number, name in pairs if str(number).isdecimal()}
    if not names:
        raise InputError(f"{names_file}: names no classes: `names` must be a list, or names by number")
    files = [file for file in sorted(folder.rglob("*.txt")) if file.name not in CLASSES]
    problems: list[Problem] = []
    found = [_yolo_picture(file, names, pose, problems) for file in files if not file.name.lower().startswith("readme")]
    if problems or not found:
        raise InputError(*(problems or [Problem(Place(folder), "holds no .txt files with boxes")])[:MOST_PROBLEMS])
    yield from found


def _yolo_picture(file: Path, names: dict[int, str], pose: bool, problems: list[Problem]) -> ForeignPicture:
    """Its boxes; of a pose the points that follow are passed over."""
    boxes = []
    for number, line in enumerate(read_text(file).splitlines(), 1):
        words = line.split()
        if not words:
            continue
        try:
            kind, values = int(words[0]), [float(word) for word in words[1:]]
            category = names[kind]
            if len(values) < 4 or not all(math.isfinite(value) for value in values):
                raise ValueError
        except KeyError:
            problems.append(Problem(Place(file, number), f"class {kind}: legal are {', '.join(map(str, names))}"))
        except ValueError:
            problems.append(Problem(Place(file, number), "must be: class, then middle x, middle y, width, height"))
        else:
            boxes.append(ForeignBox(category, _from_shares(values[: 4 if pose else None]), f"{file}:{number}"))
    return ForeignPicture(file.name, SHARES, tuple(boxes))


def _from_shares(values: Sequence[float]) -> Box:
    """A box of its middle and size, or around a polygon."""
    if len(values) in (4, 5):  # a confidence may follow
        x, y, width, height = values[:4]
        return x - width / 2, y - height / 2, x + width / 2, y + height / 2
    return min(values[::2]), min(values[1::2]), max(values[::2]), max(values[1::2])


@dataclass(frozen=True)
class _Element:
    """An element of an XML file, which knows its line."""

    file: Path
    root: ElementTree.Element
    lines: Mapping[ElementTree.Element, int]

    @property
    def at(self) -> Place:
        return Place(self.file, self.lines[self.root])

    def all(self, tag: str) -> Iterator[_Element]:
        return (_Element(self.file, child, self.lines) for child in self.root.iter(tag))

    def child(self, path: str) -> tuple[float, ...]:
        """The number in a child's text, or nothing where there is no such child."""
        found = self.root.find(path)
        return () if found is None else (self.number(f"<{found.tag}>", found.text),)

    def key(self, name: str) -> float:
        """The number of an attribute."""
        return self.number(name, self.root.get(name))

    def number(self, name: str, text: str | None) -> float:
        """Raises InputError where it is none."""
        try:
            if math.isfinite(value := float(text or "")):
                return value
        except ValueError:
            pass
        raise InputError(Problem(self.at, f"{name} of {text or ''!r}: must be a number"))


def _parsed(file: Path) -> _Element:
    builder, parser, lines = ElementTree.TreeBuilder(), expat.ParserCreate(), dict[ElementTree.Element, int]()

    def begun(tag: str, attributes: dict[str, str]) -> None:
        lines[builder.start(tag, attributes)] = parser.CurrentLineNumber

    parser.StartElementHandler, parser.EndElementHandler = begun, builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(read_text(file), True)
    except expat.ExpatError as error:
        raise InputError(Problem(Place(file, error.lineno), f"is not XML: {expat.ErrorString(error.code)}")) from None
    return _Element(file, builder.close(), lines)


def _xml(file: Path) -> list[ForeignPicture]:
    """Pictures of a file of Pascal VOC (one) or of CVAT (all of a task)."""
    root = _parsed(file)
    if root.root.tag == "annotation":
        return [_voc(root)]
    if root.root.tag == "annotations" and root.root.find("image") is not None:
        return [_cvat(element) for element in root.all("image")]
    raise InputError(f"{file}: is neither Pascal VOC (<annotation>) nor CVAT for images (<annotations> of <image>)")


def _voc(root: _Element) -> ForeignPicture:
    corners = (*root.child("size/width"), *root.child("size/height"))
    size_px = (corners[0], corners[1]) if len(corners) == 2 and all(side > 0 for side in corners) else None
    boxes = []
    for element in root.all("object"):
        sides = [value for side in ("xmin", "ymin", "xmax", "ymax") for value in element.child(f"bndbox/{side}")]
        if len(sides) < 4:
            raise InputError(Problem(element.at, "<bndbox> must have xmin, ymin, xmax and ymax"))
        left, top, right, bottom = sides
        name = (element.root.findtext("name") or "").strip()
        boxes.append(ForeignBox(name, (left, top, right, bottom), str(element.at)))
    return ForeignPicture(root.root.findtext("filename") or root.file.stem, size_px, tuple(boxes))


def _cvat(image: _Element) -> ForeignPicture:
    boxes = [
        ForeignBox(element.get("label") or "", _outline(shape), str(shape.at))
        for element in image.root
        if element.tag not in CVAT_PASSED
        for shape in (_Element(image.file, element, image.lines),)
    ]
    size = width, height = image.key("width"), image.key("height")
    if min(size) <= 0:
        raise InputError(Problem(image.at, f"<image> of {width:g} x {height:g}: must be 1 x 1 or more"))
    return ForeignPicture(image.root.get("name") or "", size, tuple(boxes))


def _outline(shape: _Element) -> Box:
    """The box around a shape of CVAT; one of boxes may be turned about its middle."""
    if shape.root.tag == "box":
        left, top, right, bottom = (shape.key(side) for side in ("xtl", "ytl", "xbr", "ybr"))
        turn = math.radians(shape.number("rotation", shape.root.get("rotation", "0")))
        across, down = (right - left) / 2, (bottom - top) / 2
        wide = across * abs(math.cos(turn)) + down * abs(math.sin(turn))
        high = across * abs(math.sin(turn)) + down * abs(math.cos(turn))
        x, y = (left + right) / 2, (top + bottom) / 2
        return (x - wide, y - high, x + wide, y + high) if turn else (left, top, right, bottom)
    if shape.root.tag != "polygon":
        raise InputError(Problem(shape.at, f"<{shape.root.tag}>: legal are box, polygon"))
    text = shape.root.get("points", "")
    pairs = [pair.split(",") for pair in text.split(";")]
    if len(pairs) < 3 or any(len(pair) != 2 for pair in pairs):
        raise InputError(Problem(shape.at, f"points of {text!r}: must be x,y;x,y;x,y or more"))
    return _from_shares([shape.number("points", value) for pair in pairs for value in pair])
