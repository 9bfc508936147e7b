"""Lines and files of each room against `[tool.ceilings]` in pyproject.toml: `python -m tests.ceilings`.

Whoever raises a number says why in the commit. A room is a distribution, or a package or module directly inside it.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
DISTRIBUTIONS = {
    "ground": "bracket_ground",
    "engine": "btxml",
    "cell": "bracket_cell",
    "sim": "bracket_sim",
    "lab": "bracket_lab",
}
Size = tuple[int, int]  # lines and files of Python


def sizes(root: Path) -> dict[str, Size]:
    """Of each distribution, and of each room in it, by its import name."""
    return {
        name: _size(path)
        for folder, top in DISTRIBUTIONS.items()
        for name, path in _rooms(root / folder / top, top)
        if any(path.rglob("*.py")) or path.suffix == ".py"
    }


def _rooms(package: Path, top: str) -> Iterator[tuple[str, Path]]:
    yield top, package
    for path in sorted(package.iterdir()):
        if path.is_dir() and not path.is_symlink() and path.name != "__pycache__":
            yield f"{top}.{path.name}", path


def _size(path: Path) -> Size:
    files = [file for file in path.rglob("*.py") if "__pycache__" not in file.parts]
    return sum(len(file.read_text().splitlines()) for file in files), len(files)


def problems(found: Mapping[str, Size], ceilings: Mapping[str, Sequence[int]]) -> list[str]:
    """Each room that is over its ceiling, has none, or is gone; empty if all is well."""
    over = [
        f"{name}: {size[0]} lines in {size[1]} files; its ceiling is {ceilings[name][0]} in {ceilings[name][1]}"
        for name, size in found.items()
        if name in ceilings and (size[0] > ceilings[name][0] or size[1] > ceilings[name][1])
    ]
    new = [
        f"{name}: no ceiling; it has {size[0]} lines in {size[1]} files"
        for name, size in found.items()
        if name not in ceilings
    ]
    return [*over, *new, *(f"{name}: there is no such room" for name in ceilings if name not in found)]


def main() -> int:
    """Print all problems; 1 if there are any."""
    ceilings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["ceilings"]
    wrong = problems(sizes(ROOT), ceilings)
    sys.stderr.writelines(f"pyproject.toml, [tool.ceilings]: {line}\n" for line in wrong)
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
