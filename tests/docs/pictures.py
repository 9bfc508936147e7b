"""Makes what in docs/ is made by programs: `make pictures`.

python -m tests.docs.pictures [docs/parts.png ...]
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from bracket_cell.trees.node_library import node_registry
from btxml.views.picture import picture
from tests import ROOT
from tests.docs import architecture, command_pages, figures, old_logs, reference, reference_pages


def _tree(name: str) -> Callable[[], str]:
    return lambda: picture(ROOT / "trees" / f"{name}.xml", node_registry())


def _reference(name: str) -> str:
    return reference.pages()[name]


def _conformance() -> str:
    from tests.trees.engine import agreement

    return agreement.page(agreement.stored())


MADE: dict[str, Callable[[], str]] = {
    **{name: partial(_reference, name) for name in reference.pages()},
    **reference_pages.PAGES,
    **command_pages.PAGES,
    "docs/reference/old-logs.md": old_logs.page,
    "docs/reference/conformance.md": _conformance,
    "docs/architecture.svg": lambda: architecture.picture(ROOT),
    "docs/assemble.svg": _tree("assemble"),
    "docs/clear_and_grasp.svg": _tree("clear_and_grasp"),
    **figures.made(),
}
PHOTOGRAPH = "docs/cell.png"
PARTS = "docs/parts.png"
STANCES = "docs/housing.png"
PAGE = "docs/page.png"
FILM = "docs/assembly.webp"
README = "README.md"


def _stances() -> bytes:
    """What `cell new part` draws of the example's mesh."""
    from bracket_cell.commands.new import part

    with TemporaryDirectory() as folder:
        product = Path(folder) / "products.yaml"
        product.write_bytes((ROOT / "config" / "products.yaml").read_bytes())
        part(ROOT / "config" / "examples" / "mesh" / "housing.stl", product=product)
        return product.with_name("housing.part.png").read_bytes()


def main(names: list[str]) -> None:
    """Make these, or all."""
    from tests.docs.first_run import first_run, readme
    from tests.docs.page_shot import shot
    from tests.docs.parts_sheet import sheet
    from tests.docs.photograph import photograph, png

    made: dict[str, Callable[[], bytes]] = {
        **{name: partial(_text, make) for name, make in MADE.items()},
        PHOTOGRAPH: lambda: png(photograph()),
        PARTS: lambda: png(sheet()),
        STANCES: _stances,
        PAGE: shot,
        FILM: lambda: first_run().film,
        README: lambda: readme().encode(),
    }
    if unknown := set(names) - set(made):
        sys.exit(f"nothing makes {', '.join(sorted(unknown))}; known: {', '.join(made)}")
    for name in names or made:
        (ROOT / name).write_bytes(made[name]())


def _text(make: Callable[[], str]) -> bytes:
    return make().encode()


if __name__ == "__main__":
    main(sys.argv[1:])
