"""docs/architecture.svg shows the imports of today, and no arrow points upwards."""

from __future__ import annotations

import re
import tomllib
from functools import cache
from itertools import pairwise

import grimp

from tests import ROOT
from tests.docs.architecture import Imports, essential, exceptions, imports, layout, picture, reached, rooms

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
NAMES = rooms(PROJECT)


@cache
def found() -> Imports:
    return imports(NAMES, exceptions(PROJECT))


def graph(**rooms: str) -> Imports:
    return {name: frozenset(imported.split()) for name, imported in rooms.items()}


def test_arrows_and_what_follows_from_them_are_exactly_the_imports() -> None:
    arrows = {name: frozenset(low for high, low in layout(NAMES, found()).arrows if high == name) for name in NAMES}
    for name in NAMES:
        assert reached(arrows, name) == reached(found(), name)


def test_no_arrow_points_upwards() -> None:
    for pair, corners in layout(NAMES, found()).arrows.items():
        heights = [y for _, y in corners]
        assert heights == sorted(heights), pair
        assert heights[0] < heights[-1], pair


def test_an_import_that_runs_up_is_drawn_as_an_arrow_upwards() -> None:
    arrows = layout(["top", "middle", "bottom"], graph(top="middle", middle="bottom", bottom="top")).arrows
    heights = [y for _, y in arrows["bottom", "top"]]
    assert heights[0] > heights[-1]


def test_arrows_that_follow_from_others_are_left_out() -> None:
    assert essential(graph(a="b c", b="c", c="")) == {("a", "b"), ("b", "c")}


def test_boxes_do_not_overlap_and_stand_within_the_picture() -> None:
    placed = layout(NAMES, found())
    corners = sorted(placed.boxes.values(), key=lambda place: (place[1], place[0]))
    for (left, top), (right, lower) in pairwise(corners):
        assert right - left >= 190 or lower - top >= 74
    assert all(0 <= x <= placed.size_px[0] - 190 and 0 <= y <= placed.size_px[1] - 74 for x, y in corners)


def test_every_module_is_in_a_room_of_the_picture() -> None:
    modules = grimp.build_graph(*sorted({name.split(".")[0] for name in NAMES}), cache_dir=None).modules
    lost = [m for m in modules if not any(m == name or m.startswith(f"{name}.") for name in NAMES)]
    assert set(lost) == {"bracket_cell", "bracket_cell.config"}  # its front door, and files alone


def test_every_room_stands_in_the_picture_by_its_name() -> None:
    shown = re.findall(r'font-weight="bold">([^<]+)<', picture(ROOT))
    assert sorted(shown) == sorted(NAMES)
