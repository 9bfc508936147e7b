"""docs/architecture.svg: the rooms of the import contracts, and the imports between them as the code has them.

A room is a package or module that a contract in pyproject.toml names. It stands one row above the highest room that it
imports. An arrow is an import that does not follow from others; all arrows point downwards, or a contract is broken.
Imports that a contract excepts (`ignore_imports`) are not drawn.
"""

from __future__ import annotations

import ast
import re
import textwrap
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import grimp

Imports = Mapping[str, frozenset[str]]  # by room, the rooms that it imports
Point = tuple[float, float]

BOX_PX, BOX_HIGH_PX, GAP_PX, ROW_PX, MARGIN_PX = 190, 74, 26, 112, 16
LETTERS = 33  # of a description that fit into a box's width
CELL = "bracket_cell"
FILLS = {
    CELL: "#d9ecff",
    "btxml": "#d8f0dc",
    "bracket_ground": "#fff1c9",
    "bracket_sim": "#e9e9ee",
    "bracket_lab": "#e9e9ee",
}


@dataclass(frozen=True)
class Layout:
    """Where everything stands.

    Attributes:
        boxes: by room, the upper left corner [px].
        arrows: by (importing room, imported room), the corners of a line from the one's box to the other's [px].
    """

    boxes: Mapping[str, Point]
    arrows: Mapping[tuple[str, str], tuple[Point, ...]]
    size_px: Point


def rooms(project: Mapping[str, Any]) -> list[str]:
    """The distributions that the contracts of pyproject.toml name, the highest first; of the cell, its rooms."""
    contracts = [contract for contract in project["tool"]["importlinter"]["contracts"] if contract["type"] == "layers"]
    distributions = next(layers["layers"] for layers in contracts if "containers" not in layers)
    inside = next(layers["layers"] for layers in contracts if layers.get("containers") == [CELL])
    rooms_of = {CELL: [f"{CELL}.{room}" for layer in inside for room in _parts(layer)]}
    return [room for layer in distributions for name in _parts(layer) for room in rooms_of.get(name, [name])]


def exceptions(project: Mapping[str, Any]) -> list[str]:
    """Imports that the contracts of pyproject.toml allow against their order, as "IMPORTER -> IMPORTED" with `*`."""
    contracts = project["tool"]["importlinter"]["contracts"]
    return [pattern for contract in contracts for pattern in contract.get("ignore_imports", ())]


def imports(names: list[str], excepted: Sequence[str]) -> Imports:
    """Which room imports which, from the code itself, but for exceptions."""
    graph = grimp.build_graph(*sorted({name.split(".")[0] for name in names}), cache_dir=None)
    found: dict[str, set[str]] = {name: set() for name in names}
    for module in graph.modules:
        importer = _room_of(module, names)
        for imported in graph.find_modules_directly_imported_by(module):
            room = _room_of(imported, names)
            allowed = any(fnmatchcase(f"{module} -> {imported}", pattern) for pattern in excepted)
            if importer and room and importer != room and not allowed:
                found[importer].add(room)
    return {name: frozenset(rooms) for name, rooms in found.items()}


def reached(found: Imports, room: str) -> set[str]:
    """All rooms that a room imports, directly or through others."""
    seen: set[str] = set()
    waiting = list(found[room])
    while waiting:
        if (name := waiting.pop()) not in seen:
            seen.add(name)
            waiting += found[name]
    return seen


def essential(found: Imports) -> set[tuple[str, str]]:
    """The imports that do not follow from others."""
    return {
        (importer, room)
        for importer, direct in found.items()
        for room in direct
        if not any(room in reached(found, between) for between in direct - {room})
    }


def layout(names: list[str], found: Imports) -> Layout:
    """Rooms in rows; arrows pass between the boxes of the rows that they cross."""
    row_of: dict[str, int] = {}
    for name in reversed(names):
        row_of[name] = 1 + max((row_of[below] for below in found[name] if below in row_of), default=-1)
    paths = {pair: _path(pair, row_of) for pair in sorted(essential(found))}
    slots = _in_order(row_of, paths)
    width = max(sum(_width(slot) for slot in row) for row in slots)
    places: dict[str, Point] = {}
    for number, row in enumerate(slots):
        left = MARGIN_PX + (width - sum(_width(slot) for slot in row)) / 2
        for slot in row:
            places[slot] = (left, MARGIN_PX + (len(slots) - 1 - number) * ROW_PX)
            left += _width(slot)
    arrows = {pair: tuple(_corners(path, places, names)) for pair, path in paths.items()}
    size = width + 2 * MARGIN_PX, (len(slots) - 1) * ROW_PX + BOX_HIGH_PX + 2 * MARGIN_PX
    return Layout({name: places[name] for name in names}, arrows, size)


def picture(root: Path) -> str:
    """The whole picture as SVG."""
    project = tomllib.loads((root / "pyproject.toml").read_text())
    names = rooms(project)
    placed = layout(names, imports(names, exceptions(project)))
    width, height = placed.size_px
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}"'
    style = 'font-family="sans-serif" font-size="13" style="background: white"'
    tip = '<marker id="tip" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
    lines = [f"{head} {style}>", f'<defs>{tip}<path d="M0 0 L8 4 L0 8 z" fill="#666"/></marker></defs>']
    for points in placed.arrows.values():
        corners = " ".join(f"{x:.0f},{y:.0f}" for x, y in points)
        lines.append(f'<polyline points="{corners}" fill="none" stroke="#888" marker-end="url(#tip)"/>')
    for name, place in placed.boxes.items():
        lines += _box(name, place, _description(root, name))
    return "\n".join([*lines, "</svg>", ""])


def _parts(layer: str) -> list[str]:
    return [name.strip(" ()") for name in re.split("[|:]", layer)]


def _room_of(module: str, names: list[str]) -> str | None:
    return max((name for name in names if module == name or module.startswith(f"{name}.")), key=len, default=None)


def _path(pair: tuple[str, str], row_of: Mapping[str, int]) -> list[str]:
    """The slots that an arrow passes: its two rooms, and one of its own in every row between."""
    importer, room = pair
    step = -1 if row_of[importer] > row_of[room] else 1
    between = [f"{row} {importer} {room}" for row in range(row_of[importer] + step, row_of[room], step)]
    return [importer, *between, room]


def _in_order(row_of: Mapping[str, int], paths: Mapping[tuple[str, str], list[str]]) -> list[list[str]]:
    """Slots by row, the lowest row first, each near the slots that it is joined to."""
    rows: list[list[str]] = [[] for _ in range(1 + max(row_of.values()))]
    for name, number in row_of.items():
        rows[number].append(name)
    for path in paths.values():
        for slot in path[1:-1]:
            rows[int(slot.split()[0])].append(slot)
    joined: dict[str, list[str]] = {slot: [] for row in rows for slot in row}
    for path in paths.values():
        for upper, lower in pairwise(path):
            joined[upper].append(lower)
            joined[lower].append(upper)
    for _ in range(20):
        for row in [*rows, *reversed(rows)]:
            where = _middles(rows)
            wish = {slot: sum(map(where.__getitem__, joined[slot])) / max(len(joined[slot]), 1) for slot in row}
            row.sort(key=wish.__getitem__)
    return rows


def _middles(rows: list[list[str]]) -> dict[str, float]:
    """How far each slot is from the picture's middle [px]."""
    found: dict[str, float] = {}
    for row in rows:
        left = -sum(_width(slot) for slot in row) / 2
        for slot in row:
            found[slot] = left + _width(slot) / 2
            left += _width(slot)
    return found


def _width(slot: str) -> float:
    return GAP_PX if " " in slot else BOX_PX + GAP_PX


def _corners(path: list[str], places: Mapping[str, Point], names: list[str]) -> Iterator[Point]:
    """From the middle of a box's lower side, through the gaps, to the middle of another's upper side."""
    down = places[path[-1]][1] > places[path[0]][1]
    for number, slot in enumerate(path):
        x, y = places[slot]
        middle = x + (BOX_PX if slot in names else 0) / 2
        if number > 0:
            yield middle, y if down else y + BOX_HIGH_PX
        if number < len(path) - 1:
            yield middle, y + BOX_HIGH_PX if down else y


def _box(name: str, place: Point, description: str) -> Iterator[str]:
    x, y = place
    fill = FILLS.get(name.split(".")[0], "#ffffff")
    size = f'width="{BOX_PX}" height="{BOX_HIGH_PX}"'
    yield f'<rect x="{x:.0f}" y="{y:.0f}" {size} rx="6" fill="{fill}" stroke="#555"/>'
    yield f'<text x="{x + 8:.0f}" y="{y + 18:.0f}" font-weight="bold">{escape(name)}</text>'
    for number, line in enumerate(textwrap.wrap(description, LETTERS, max_lines=4, placeholder=" ...")):
        yield f'<text x="{x + 8:.0f}" y="{y + 32 + 12 * number:.0f}" font-size="10" fill="#444">{escape(line)}</text>'


def _description(root: Path, name: str) -> str:
    """What the first sentence of a room's docstring says, without who may import it."""
    top, *inner = name.split(".")
    path = next(root.glob(f"*/{top}")).joinpath(*inner)
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    text = ast.get_docstring(ast.parse(file.read_text())) or ""
    return text.partition("\n")[0].partition(";")[0].rstrip(".")
