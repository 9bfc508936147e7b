"""Catalogues of words, one gettext file (.po) a language, whose message ids are the English texts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from string import Formatter

import polib

from bracket_ground.errors import InputError, Place, Problem
from bracket_ground.files.words.message import Message

FOLDER = Path(__file__).parent
SOURCE = "en"  # the ids are this language's texts


@dataclass(frozen=True)
class Catalogue:
    """One language.

    Attributes:
        texts: by message id; what is not there is shown in English.
    """

    language: str
    texts: Mapping[str, str]

    def __call__(self, text: str) -> str:
        """What is to be shown for a message."""
        if not isinstance(text, Message):
            return self.texts.get(text, text)
        values = {name: self(value) if isinstance(value, str) else value for name, value in text.values.items()}
        template = self.texts.get(text.id, text.id)
        return template.format(**values) if values else template


def languages() -> list[str]:
    """Names of the languages that there are."""
    return sorted({SOURCE, *(path.stem for path in FOLDER.glob("*.po"))})


@cache
def catalogue(language: str) -> Catalogue:
    """The words of a language.

    Raises:
        InputError: there is no such file, or it says what cannot be filled in.
    """
    path = FOLDER / f"{language}.po"
    if language == SOURCE:
        return Catalogue(language, {})
    if not path.is_file():
        raise InputError(f"no language {language!r}; there are: {', '.join(languages())}")
    entries = [entry for entry in polib.pofile(str(path)) if entry.msgstr and not entry.obsolete]
    wrong = [
        Problem(Place(path, entry.linenum), f"{entry.msgstr!r} does not fill in {sorted(_names(entry.msgid))}")
        for entry in entries
        if _names(entry.msgid) != _names(entry.msgstr)
    ]
    if wrong:
        raise InputError(*wrong)
    return Catalogue(language, {entry.msgid: entry.msgstr for entry in entries})


def _names(text: str) -> set[str]:
    try:
        return {name for _, name, _, _ in Formatter().parse(text) if name is not None}
    except ValueError:
        return {"{}"}
