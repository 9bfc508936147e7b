"""Where photographs come from: each folder is a source, and REUSE.toml says under which licence (REUSE 3.3)."""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, Field, ValidationError

from bracket_ground.errors import InputError, mistakes
from bracket_ground.files.files import read_text
from bracket_lab.pictures.sources import PICTURES

LICENCES, NOT_RECORDED = "REUSE.toml", "not recorded"
WITHOUT_HANDS = ", without hands"  # ends the name of a source of negatives


@dataclass(frozen=True)
class Photograph:
    """A picture of a folder.

    Attributes:
        source: its folder below the one that was named, or that one.
        licence: SPDX expression.
    """

    file: Path
    source: str = ""
    licence: str = NOT_RECORDED


class _Annotation(BaseModel):
    """What REUSE.toml says of some files; `*` is any name, `**` any path."""

    path: str | tuple[str, ...]
    licence: str | tuple[str, ...] = Field(alias="SPDX-License-Identifier", default=())

    def names(self, path: str) -> bool:
        wanted = (self.path,) if isinstance(self.path, str) else self.path
        patterns = (re.escape(each).replace(r"\*\*", ".*").replace(r"\*", "[^/]*") for each in wanted)
        return any(re.fullmatch(pattern, path) for pattern in patterns)

    @property
    def expression(self) -> str:
        return self.licence if isinstance(self.licence, str) else " AND ".join(self.licence)


class _Licences(BaseModel):
    annotations: tuple[_Annotation, ...] = ()


def photographs_of(folder: Path, kind: str = "") -> list[Photograph]:
    """The pictures of a folder and of those below, in order.

    Args:
        kind: ends the names of their sources.

    Raises:
        InputError: there are none, or its REUSE.toml is wrong.
    """
    files = sorted(file for file in folder.rglob("*") if file.suffix.lower() in PICTURES)
    if not files:
        raise InputError(f"{folder}: holds no photographs; legal are {', '.join(PICTURES)}")
    annotations, found = _licences(folder / LICENCES), list[Photograph]()
    for file in files:
        path = file.relative_to(folder)
        said = [each.expression for each in annotations if each.licence and each.names(path.as_posix())]
        source = path.parts[0] if len(path.parts) > 1 else folder.resolve().name
        found.append(Photograph(file, f"{source}{kind}", [NOT_RECORDED, *said][-1]))  # of several the last counts
    return found


def _licences(file: Path) -> tuple[_Annotation, ...]:
    if not file.exists():
        return ()
    try:
        return _Licences.model_validate(tomllib.loads(read_text(file))).annotations
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{file}: is no TOML: {error}") from None
    except ValidationError as error:
        legal = 'legal: [[annotations]] with path = "FOLDER/**" and SPDX-License-Identifier = "CC-BY-4.0"'
        raise InputError(*(f"{file}: {mistake}; {legal}" for mistake in mistakes(error))) from None


def by_source(photographs: Iterable[tuple[str, str]]) -> dict[str, str]:
    """How many photographs under which licence, by source; of each its source and licence are given."""
    counts: Mapping[tuple[str, str], int] = Counter(photographs)
    told = dict[str, str]()
    for (source, licence), count in sorted(counts.items()):
        told[source] = ", ".join(filter(None, (told.get(source), f"{count} ({licence})")))
    return told
