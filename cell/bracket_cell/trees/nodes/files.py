"""Files that nodes read and write: tables and saved values, in the working folder and nowhere else.

What is read stands in the log, so that a replay reads the same and touches no file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from bracket_ground.errors import words_of
from bracket_ground.interfaces.notes import Journal
from btxml.engine.errors import NodeError

SIZE_LIMIT = 100_000  # characters: it goes into the log


class Files(Protocol):
    """Text files by their path in the working folder."""

    def read(self, path: str, journal: Journal) -> str | None:
        """The text of a file; None where there is none."""
        ...

    def write(self, path: str, text: str, journal: Journal) -> None:
        """Replace a file atomically."""
        ...


class WorkingFolder:
    """Files below the folder that `cell run` was started in."""

    def read(self, path: str, journal: Journal) -> str | None:
        """The text of a file; None where there is none.

        Raises:
            NodeError: it lies elsewhere, is too large, or cannot be read.
        """
        file = _inside(path)
        try:
            _ordinary(file, path)
            if file.exists() and file.stat().st_size > SIZE_LIMIT:
                raise NodeError(f"{path} is larger than {SIZE_LIMIT} bytes")
            text = file.read_text(encoding="utf-8") if file.exists() else None
        except (OSError, UnicodeDecodeError) as error:
            raise NodeError(f"{path} cannot be read: {words_of(error)}") from None
        _note_read(path, text, journal)
        return text

    def write(self, path: str, text: str, journal: Journal) -> None:
        """Replace a file atomically.

        Raises:
            NodeError: it lies elsewhere, would be too large, or cannot be written.
        """
        file = _inside(path)
        if len(text) > SIZE_LIMIT:
            raise NodeError(f"{path} would be larger than {SIZE_LIMIT} characters")
        partial, content = file.with_name(file.name + ".partial"), _encoded(path, text)
        try:
            _ordinary(file, path)
            file.parent.mkdir(parents=True, exist_ok=True)
            partial.unlink(missing_ok=True)  # whatever it is: to open a pipe could take for ever
            with partial.open("xb") as stream:
                stream.write(content)
            partial.replace(file)
        except OSError as error:
            raise NodeError(f"{path} cannot be written: {words_of(error)}") from None
        journal.note("file", path=path, done="written", text=text)


class LoggedFiles:
    """What a run read, in order, for its replay; nothing is written."""

    def __init__(self, notes: list[dict[str, object]]) -> None:
        """Args:
        notes: of the topic `file`, in order.
        """
        self._read = [note for note in notes if note.get("done") == "read"]

    def read(self, path: str, journal: Journal) -> str | None:
        """The text that was read then; None where there was none, or nothing was read."""
        place = next((place for place, note in enumerate(self._read) if note["path"] == path), None)
        found = None if place is None else self._read.pop(place).get("text")
        text = None if found is None else str(found)
        _note_read(path, text, journal)
        return text

    def write(self, path: str, text: str, journal: Journal) -> None:
        """Note it, and no more."""
        _encoded(path, text)
        journal.note("file", path=path, done="written", text=text)


def _note_read(path: str, text: str | None, journal: Journal) -> None:
    """What was read, for a replay; a log has no word for nothing, so that a file that is not there has no text."""
    journal.note("file", path=path, done="read", **({} if text is None else {"text": text}))


def _encoded(path: str, text: str) -> bytes:
    """The text as a file holds it; half a character, as JSON can spell one, is none."""
    try:
        return text.encode()
    except UnicodeEncodeError as error:
        raise NodeError(f"{path} cannot be written: {error}") from None


def _ordinary(file: Path, path: str) -> None:
    """A pipe or a device would hold up the tick.

    Raises:
        NodeError: it is one, or a folder.
    """
    if file.exists() and not file.is_file():
        raise NodeError(f"{path} is not a regular file")


def _inside(path: str) -> Path:
    """A file below the working folder."""
    folder = Path.cwd()
    try:
        file = (folder / path).resolve()
    except (OSError, ValueError, RuntimeError) as error:
        raise NodeError(f"'{path}' is not a path: {words_of(error)}") from None
    if not path or Path(path).is_absolute() or not file.is_relative_to(folder.resolve()) or file == folder.resolve():
        raise NodeError(f"'{path}' leads out of the working folder; name a file below it")
    return file
