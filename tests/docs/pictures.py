"""Makes what in docs/ is made by programs: `make pictures`. Plots of experiments come from `cell eval`."""

from __future__ import annotations

from collections.abc import Callable

from cell.running.node_library import node_registry
from tests import ROOT
from tests.docs import architecture, reference
from trees.views.picture import picture


def _tree(name: str) -> Callable[[], str]:
    return lambda: picture(ROOT / "trees" / f"{name}.xml", node_registry())


MADE: dict[str, Callable[[], str]] = {
    reference.PAGE: reference.page,
    "docs/architecture.svg": lambda: architecture.picture(ROOT),
    "docs/assemble.svg": _tree("assemble"),
    "docs/clear_and_grasp.svg": _tree("clear_and_grasp"),
}
PHOTOGRAPH = "docs/cell.png"
PARTS = "docs/parts.png"
LOOKS = "docs/looks.png"
PAGE = "docs/page.png"
SEEDS = {"nominal": 1, "varied": 14, "hard": 9}


def main() -> None:
    from tests.docs.page_shot import shot
    from tests.docs.parts_sheet import sheet
    from tests.docs.photograph import look_sheet_of, photograph, png

    for name, make in MADE.items():
        (ROOT / name).write_text(make())
    (ROOT / PHOTOGRAPH).write_bytes(png(photograph()))
    (ROOT / PARTS).write_bytes(png(sheet()))
    (ROOT / LOOKS).write_bytes(png(look_sheet_of(SEEDS)))
    (ROOT / PAGE).write_bytes(shot())


if __name__ == "__main__":
    main()
