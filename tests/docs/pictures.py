"""Makes what in docs/ is made by programs: `make pictures`. Plots of experiments come from `cell lab eval`.

python -m tests.docs.pictures [docs/looks.png ...]
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial

from cell.wiring.node_library import node_registry
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


def main(names: list[str]) -> None:
    """Make these, or all."""
    from tests.docs.page_shot import shot
    from tests.docs.parts_sheet import sheet
    from tests.docs.photograph import look_sheet_of, photograph, png

    made: dict[str, Callable[[], bytes]] = {
        **{name: partial(_text, make) for name, make in MADE.items()},
        PHOTOGRAPH: lambda: png(photograph()),
        PARTS: lambda: png(sheet()),
        LOOKS: lambda: png(look_sheet_of(SEEDS)),
        PAGE: shot,
    }
    if unknown := set(names) - set(made):
        sys.exit(f"nothing makes {', '.join(sorted(unknown))}; known: {', '.join(made)}")
    for name in names or made:
        (ROOT / name).write_bytes(made[name]())


def _text(make: Callable[[], str]) -> bytes:
    return make().encode()


if __name__ == "__main__":
    main(sys.argv[1:])
