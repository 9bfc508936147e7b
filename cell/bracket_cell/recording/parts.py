"""Names of the parts of a rotated log: run.mcap is run.0001.mcap, run.0002.mcap, ..."""

from __future__ import annotations

import re
from pathlib import Path

PART = re.compile(r"\.(\d{4,})\.mcap$")


def part_path(log: Path, number: int) -> Path:
    """File of one part."""
    return log.with_suffix(f".{number:04d}{log.suffix}")


def part_number(path: Path) -> int | None:
    """Which part of a rotated log a file is, by its name; None for a whole log."""
    found = PART.search(path.name)
    return int(found[1]) if found else None


def parts_of(log: Path) -> list[Path]:
    """The parts of a rotated log that are there, in order.

    Args:
        log: the name of the log without a part's number.
    """
    beside = log.parent.glob(f"{_escaped(log.stem)}.*{log.suffix}")
    found = [path for path in beside if part_number(path) is not None and whole_path(path) == log]
    return sorted(found, key=lambda path: part_number(path) or 0)


def whole_path(part: Path) -> Path:
    """The name of the log that a part belongs to."""
    return part.with_name(PART.sub(".mcap", part.name))


def _escaped(text: str) -> str:
    return re.sub(r"([*?[])", r"[\1]", text)
