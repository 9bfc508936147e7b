"""A tree as an SVG picture that grows from left to right: a file's, or one that runs, with its statuses."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar
from xml.etree import ElementTree
from xml.sax.saxutils import escape

from btxml.engine.decorators import SubTree
from btxml.engine.errors import TreeFileError
from btxml.files.compile.registry import Registry
from btxml.files.parse.xml_file import Element, node_tag
from btxml.views.show import connections, read_checked, reading_order

ROW_PX = 46
BOX_PX = 34
GAP_PX = 34
MARGIN_PX = 16
PNG_ZOOM = 1
FONT, FONT_PACKAGE = "DejaVu Sans", "fonts-dejavu-core"
TITLE_PX = 34
LETTER_PX = 6.7
LETTERS_MAX = 56
FILLS = {
    "Action": "#d9ecff",
    "Condition": "#fff1c9",
    "Control": "#e9e9ee",
    "Decorator": "#e4dcf5",
    "SubTree": "#d8f0dc",
}


# Frames by status in Groot2's numbers; 10 and more is what an idle node was before.
IDLE, RUNNING = 0, 1
FRAMES = {
    RUNNING: 'stroke="#e07b00" stroke-width="4"',
    2: 'stroke="#1a8f3c" stroke-width="3"',
    3: 'stroke="#c62828" stroke-width="3"',
    4: 'stroke="#777" stroke-width="2" stroke-dasharray="5 4"',
    11: 'stroke="#e0a860" stroke-width="1.5"',
    12: 'stroke="#8cc79c" stroke-width="1.5"',
    13: 'stroke="#e0a0a0" stroke-width="1.5"',
    14: 'stroke="#aaa" stroke-width="1.5" stroke-dasharray="5 4"',
}
PLAIN = 'stroke="#555"'

Source = TypeVar("Source")


@dataclass
class _Box:
    """A node in the picture, its middle's height and its column.

    Attributes:
        name, words: its two lines of text.
        kind: of node, as Groot2 files it.
        status: number in Groot2's protocol.
    """

    name: str
    words: str
    kind: str
    status: int = IDLE
    children: list[_Box] = field(default_factory=list)
    level: int = 0
    row: float = 0.0

    @property
    def width(self) -> float:
        return 16 + max(LETTER_PX * 1.2 * len(self.name), LETTER_PX * 0.84 * len(self.words))


def picture(path: Path, registry: Registry, beside: Iterable[Path] = ()) -> str:
    """SVG of the main tree and of every tree that it reaches; of all trees where a file names no main tree.

    Args:
        beside: further files, and folders with them, whose trees it may name.

    Raises:
        TreeFileError: everything that is wrong with the file.
    """
    library = read_checked(path, registry, beside)

    def box(element: Element) -> _Box:
        tag = node_tag(element)
        node = SubTree if tag == "SubTree" else registry.classes[tag]
        title = element.get("ID") or "" if tag == "SubTree" else tag
        return _named(title, element.get("name"), "  ".join(connections(element)), node.node_type)

    names = reading_order(library, unused=not library.main)
    trees = {name: _boxes(library.trees[name].children[0], box, lambda element: element.children) for name in names}
    return _drawn(trees)


def running_picture(xml: ElementTree.Element, statuses: Mapping[int, int], said: Mapping[int, str]) -> str:
    """SVG of a tree in Groot2's form, with SubTrees in their places, and what its nodes do.

    What is below a node that does not run is folded, and only counted.

    Args:
        statuses: numbers in Groot2's protocol, by uid.
        said: what nodes say, by uid; written in place of the ports.
    """
    trees = {tree.get("_fullpath", ""): tree for tree in xml.iter("BehaviorTree")}
    kinds = {model.get("ID"): model.tag for model in xml.findall("TreeNodesModel/*")}

    def box(element: ElementTree.Element) -> _Box:
        uid = int(element.get("_uid", "0"))
        title = element.get("ID") or element.tag
        name = element.get("name")
        ports = [f"{key}={value}" for key, value in element.items() if key not in ("name", "ID", "_uid", "_fullpath")]
        words = said.get(uid) or "  ".join(ports)
        folded = "" if not len(inside(element)) or runs(element) else f"  … {count(element)}"
        kind = "SubTree" if element.tag == "SubTree" else kinds.get(element.tag, "Action")
        box = _named(title, None if name == title else name, words, kind, statuses.get(uid, IDLE))
        box.name += folded
        return box

    def inside(element: ElementTree.Element) -> ElementTree.Element:
        return trees[element.get("_fullpath", "")] if element.tag == "SubTree" else element

    def runs(element: ElementTree.Element) -> bool:
        return statuses.get(int(element.get("_uid", "0")), IDLE) == RUNNING

    def count(element: ElementTree.Element) -> int:
        return sum(1 + count(child) for child in inside(element))

    def below(element: ElementTree.Element) -> Iterable[ElementTree.Element]:
        return inside(element) if runs(element) else ()

    return _drawn({trees[""].get("ID", ""): _boxes(trees[""][0], box, below)})


def _drawn(trees: Mapping[str, list[_Box]]) -> str:
    parts: list[str] = []
    top, width = float(MARGIN_PX), 0.0
    for title, boxes in trees.items():
        lines, right, bottom = _tree(boxes, title, top)
        parts += lines
        top, width = bottom + MARGIN_PX, max(width, right)
    size = f'width="{width + MARGIN_PX:.0f}" height="{top:.0f}"'
    style = 'font-family="sans-serif" font-size="12" style="background: white"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} {style}>'
    return "\n".join([head, *parts, "</svg>", ""])


def to_png(svg: str) -> bytes:
    """A picture in pixels.

    Raises:
        TreeFileError: no font is installed, so the boxes would be empty.
    """
    if not draws_text():
        raise TreeFileError(f"no font is installed for pictures; apt-get install -y {FONT_PACKAGE}, or use --svg")
    return _rendered(svg)


def draws_text() -> bool:
    """Whether this machine has a font for pictures in pixels."""
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="20" height="20" font-family="sans-serif">'
    return _rendered(f'{head}<text x="2" y="15">M</text></svg>') != _rendered(f"{head}</svg>")


def _rendered(svg: str) -> bytes:
    from resvg_py import svg_to_bytes  # only who wants pixels pays for the import

    return bytes(svg_to_bytes(svg_string=svg, background="white", zoom=PNG_ZOOM, sans_serif_family=FONT))


def _boxes(root: Source, box: Callable[[Source], _Box], below: Callable[[Source], Iterable[Source]]) -> list[_Box]:
    """The boxes of a tree, parents first, in their places: leaves take rows in order, parents stand between."""
    boxes: list[_Box] = []
    waiting = [(root, box(root))]
    while waiting:
        source, parent = waiting.pop()
        boxes.append(parent)
        inner = [(child, box(child)) for child in below(source)]
        for _, child in inner:
            child.level = parent.level + 1
            parent.children.append(child)
        waiting += reversed(inner)
    leaves = [leaf for leaf in boxes if not leaf.children]
    for row, leaf in enumerate(leaves):
        leaf.row = row
    for placed in reversed(boxes):
        if placed.children:
            placed.row = (placed.children[0].row + placed.children[-1].row) / 2
    return boxes


def _tree(boxes: list[_Box], title: str, top: float) -> tuple[list[str], float, float]:
    """SVG lines of one tree, its right edge and its bottom."""
    columns = _columns(boxes)
    lines = [f'<text x="{MARGIN_PX}" y="{top + 18}" font-size="16" font-weight="bold">{escape(title)}</text>']
    first_row = top + TITLE_PX + BOX_PX / 2
    for box in boxes:
        lines += [_link(columns, box, child, first_row) for child in box.children]
    for box in boxes:
        lines += _node(columns, box, first_row)
    rows = sum(not box.children for box in boxes)
    return lines, columns[-1] - GAP_PX, top + TITLE_PX + rows * ROW_PX


def _columns(boxes: list[_Box]) -> list[float]:
    """Left edges of all levels, and where a further one would begin."""
    widths = [0.0] * (1 + max(box.level for box in boxes))
    for box in boxes:
        widths[box.level] = max(widths[box.level], box.width)
    edges = [float(MARGIN_PX)]
    for width in widths:
        edges.append(edges[-1] + width + GAP_PX)
    return edges


def _node(columns: list[float], box: _Box, first_row: float) -> Iterator[str]:
    left, middle = columns[box.level], first_row + box.row * ROW_PX
    shape = f'x="{left}" y="{middle - BOX_PX / 2}" width="{box.width:.0f}" height="{BOX_PX}" rx="6"'
    yield f'<rect {shape} fill="{FILLS[box.kind]}" {FRAMES.get(box.status, PLAIN)}/>'
    lift = 3 if box.words else -4
    yield f'<text x="{left + 8}" y="{middle - lift}" font-weight="bold">{escape(box.name)}</text>'
    if box.words:
        yield f'<text x="{left + 8}" y="{middle + 12}" font-size="10" fill="#444">{escape(box.words)}</text>'


def _link(columns: list[float], parent: _Box, child: _Box, first_row: float) -> str:
    x0, y0 = columns[parent.level] + parent.width, first_row + parent.row * ROW_PX
    x1, y1 = columns[child.level], first_row + child.row * ROW_PX
    bend = x1 - GAP_PX / 2
    return f'<path d="M{x0:.0f} {y0} H{bend} V{y1} H{x1}" fill="none" stroke="#888"/>'


def _named(title: str, name: str | None, words: str, kind: str, status: int = IDLE) -> _Box:
    return _Box(_cut(f"{title}: {name}" if name else title), _cut(words), kind, status)


def _cut(text: str) -> str:
    return text if len(text) <= LETTERS_MAX else text[: LETTERS_MAX - 3] + "..."
