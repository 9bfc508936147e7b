"""A tree file as an SVG picture: each BehaviorTree grows from left to right."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import escape

from cell.interfaces.errors import InputError
from trees.engine.decorators import SubTree
from trees.files.registry import Registry
from trees.files.structure import node_tag
from trees.files.xml_file import Element
from trees.views.show import connections, read_checked, reading_order

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


@dataclass
class _Box:
    """A node in the picture, its middle's height and its column."""

    element: Element
    level: int
    row: float = 0.0


def picture(path: Path, registry: Registry) -> str:
    """SVG of the main tree and of every tree that it reaches; of all trees where a file names no main tree.

    Raises:
        InputError: everything that is wrong with the file.
    """
    library = read_checked(path, registry)
    parts: list[str] = []
    top, width = float(MARGIN_PX), 0.0
    for identifier in reading_order(library, unused=not library.main):
        lines, right, bottom = _tree(library.trees[identifier], identifier, registry, top)
        parts += lines
        top, width = bottom + MARGIN_PX, max(width, right)
    size = f'width="{width + MARGIN_PX:.0f}" height="{top:.0f}"'
    style = 'font-family="sans-serif" font-size="12" style="background: white"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} {style}>'
    return "\n".join([head, *parts, "</svg>", ""])


def to_png(svg: str) -> bytes:
    """A picture in pixels.

    Raises:
        InputError: no font is installed, so the boxes would be empty.
    """
    if not draws_text():
        raise InputError(f"no font is installed for pictures; apt-get install -y {FONT_PACKAGE}, or use --svg")
    return _rendered(svg)


def draws_text() -> bool:
    """Whether this machine has a font for pictures in pixels."""
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="20" height="20" font-family="sans-serif">'
    return _rendered(f'{head}<text x="2" y="15">M</text></svg>') != _rendered(f"{head}</svg>")


def _rendered(svg: str) -> bytes:
    from resvg_py import svg_to_bytes  # only who wants pixels pays for the import

    return bytes(svg_to_bytes(svg_string=svg, background="white", zoom=PNG_ZOOM, sans_serif_family=FONT))


def _tree(tree: Element, title: str, registry: Registry, top: float) -> tuple[list[str], float, float]:
    """SVG lines of one tree, its right edge and its bottom."""
    boxes, rows = _arrange(tree.children[0])
    columns = _columns(boxes)
    lines = [f'<text x="{MARGIN_PX}" y="{top + 18}" font-size="16" font-weight="bold">{escape(title)}</text>']
    first_row = top + TITLE_PX + BOX_PX / 2
    for box in boxes.values():
        lines += [_link(columns, box, boxes[id(child)], first_row) for child in box.element.children]
    for box in boxes.values():
        lines += _node(columns, box, registry, first_row)
    return lines, columns[-1] - GAP_PX, top + TITLE_PX + rows * ROW_PX


def _arrange(root: Element) -> tuple[dict[int, _Box], int]:
    """Leaves take rows in the order of the file; a parent stands between its first and last child."""
    boxes: dict[int, _Box] = {}
    waiting = [(root, 0)]
    while waiting:
        element, level = waiting.pop()
        boxes[id(element)] = _Box(element, level)
        waiting += [(child, level + 1) for child in reversed(element.children)]
    rows = 0
    for box in boxes.values():
        if not box.element.children:
            box.row = rows
            rows += 1
    for box in reversed(boxes.values()):
        if children := box.element.children:
            box.row = (boxes[id(children[0])].row + boxes[id(children[-1])].row) / 2
    return boxes, rows


def _columns(boxes: dict[int, _Box]) -> list[float]:
    """Left edges of all levels, and where a further one would begin."""
    widths = [0.0] * (1 + max(box.level for box in boxes.values()))
    for box in boxes.values():
        widths[box.level] = max(widths[box.level], _width(box.element))
    edges = [float(MARGIN_PX)]
    for width in widths:
        edges.append(edges[-1] + width + GAP_PX)
    return edges


def _node(columns: list[float], box: _Box, registry: Registry, first_row: float) -> Iterator[str]:
    left, middle = columns[box.level], first_row + box.row * ROW_PX
    width = _width(box.element)
    tag = node_tag(box.element)
    node = SubTree if tag == "SubTree" else registry.classes[tag]
    shape = f'x="{left}" y="{middle - BOX_PX / 2}" width="{width:.0f}" height="{BOX_PX}" rx="6"'
    yield f'<rect {shape} fill="{FILLS[node.node_type]}" stroke="#555"/>'
    name, ports = _texts(box.element)
    lift = 3 if ports else -4
    yield f'<text x="{left + 8}" y="{middle - lift}" font-weight="bold">{escape(name)}</text>'
    if ports:
        yield f'<text x="{left + 8}" y="{middle + 12}" font-size="10" fill="#444">{escape(ports)}</text>'


def _link(columns: list[float], parent: _Box, child: _Box, first_row: float) -> str:
    x0, y0 = columns[parent.level] + _width(parent.element), first_row + parent.row * ROW_PX
    x1, y1 = columns[child.level], first_row + child.row * ROW_PX
    bend = x1 - GAP_PX / 2
    return f'<path d="M{x0:.0f} {y0} H{bend} V{y1} H{x1}" fill="none" stroke="#888"/>'


def _texts(element: Element) -> tuple[str, str]:
    tag, name = node_tag(element), element.get("name")
    head = element.get("ID") or "" if tag == "SubTree" else tag
    ports = "  ".join(connections(element))
    return _cut(f"{head}: {name}" if name else head), _cut(ports)


def _width(element: Element) -> float:
    name, ports = _texts(element)
    return 16 + max(LETTER_PX * 1.2 * len(name), LETTER_PX * 0.84 * len(ports))


def _cut(text: str) -> str:
    return text if len(text) <= LETTERS_MAX else text[: LETTERS_MAX - 3] + "..."
