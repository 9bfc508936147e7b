"""Typed errors of the cell: one root, one class for each way a user must act."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

ERRNO = re.compile(r"(^.* Detail: )?\[[Ee]rrno -?\d+\] | \(while attempting to bind .*")  # of pyarrow, of Python
ENDLESS = re.compile(r"(\w{40})\w{216,}")  # a word that is longer than any name of a file

MAPPING, LIST = "keys with values", "a list"
KINDS = {  # what a value should be, by pydantic's names of errors, where its words are Python's or its own
    **dict.fromkeys(("model_type", "model_attributes_type", "dict_type", "mapping_type"), MAPPING),
    **dict.fromkeys(("list_type", "tuple_type", "set_type", "frozen_set_type"), LIST),
    **dict.fromkeys(("float_type", "float_parsing", "number"), "a number"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "a whole number"),
    **dict.fromkeys(("bool_type", "bool_parsing"), "true or false"),
    "string_type": "text",
    "path_type": "a path",
}
SHOULD = "input should be "


class CellError(Exception):
    """Root of all errors that this project raises on purpose; one that goes to another process stays what it is."""

    def __reduce__(self) -> tuple[Callable[..., CellError], tuple[object, ...]]:
        return _rebuilt, (type(self), self.args, self.__dict__)


def _rebuilt(kind: type[CellError], arguments: tuple[object, ...], fields: dict[str, object]) -> CellError:
    """An error as it was pickled; its own __init__ may want other arguments than its text."""
    error = kind.__new__(kind, *arguments)
    error.args = arguments
    error.__dict__.update(fields)
    return error


def words_of(error: BaseException) -> str:
    """What the operating system says of an error, or of the one that a library wrapped or quotes, without numbers."""
    behind = error.__cause__ if isinstance(error.__cause__, OSError) else error
    words = behind.args[1] if len(behind.args) == 2 and isinstance(behind.args[0], int) else behind
    return ERRNO.sub("", str(getattr(behind, "strerror", None) or words)) or type(error).__name__


def mistakes(error: BaseException) -> list[str]:
    """What is wrong in data that somebody wrote, by what they raise; of a model's refusal each, with its key."""
    match error:
        case ValidationError():
            each = error.errors(include_url=False, include_input=False)
            told = [(".".join(map(str, one["loc"])), wanted(one["type"], one["msg"])) for one in each]
            return [f"{key}: {what}" if key else what for key, what in told]
        case json.JSONDecodeError():
            rest = error.doc[error.pos :].strip()[:9]
            return [f"is no JSON from character {error.pos + 1} on, where {repr(rest) if rest else 'nothing'} stands"]
        case UnicodeDecodeError():
            return [f"is not UTF-8 text (byte {error.start})"]
        case KeyError():
            return [f"has no {' '.join(map(str, error.args)):.99}"]
        case IndexError() | StopIteration():
            return ["has too few values"]
        case TypeError() | AttributeError() | RecursionError():
            return ["has a value of another kind than it should"]
    return [str(error)]


def counted(count: int, noun: str) -> str:
    """Like "1 tick" and "2 ticks"."""
    return f"{count} {noun}{'s' * (count != 1)}"


def wanted(kind: str, words: str) -> str:
    """What a value should be, by pydantic's name of the error and its words."""
    return f"{SHOULD}{KINDS[kind]}" if kind in KINDS else words.removeprefix("Value error, ")


@dataclass(frozen=True)
class Place:
    """Where in a file something stands; lines and columns count from 1."""

    file: Path
    line: int | None = None
    column: int | None = None

    def __str__(self) -> str:
        return ":".join(str(part) for part in (self.file, self.line, self.column) if part is not None)


@dataclass(frozen=True)
class Problem:
    """One mistake in an input file: where it is, what is wrong and what would be legal."""

    place: Place
    what: str
    legal: str = ""

    def __str__(self) -> str:
        return f"{self.place}: {self.what}" + (f"; {self.legal}" if self.legal else "")


class InputError(CellError):
    """A file, option or path given by the user is wrong; nothing has moved (exit status 2).

    Examples: an unknown key in a YAML file, an unknown node in a tree, a log path that cannot be written.
    """

    def __init__(self, *problems: Problem | str) -> None:
        self.problems = problems
        super().__init__(ENDLESS.sub(r"\1...", "\n".join(str(problem) for problem in problems)))


class SettingError(InputError):
    """Settings that are legal one by one do not fit together or this machine; found after the files were read.

    Examples: no room for the parts in the tray, holes that overlap, weights that are missing, no such CAN interface.

    Attributes:
        places: (location, what is wrong there); a location begins with a key of the configuration, or with "product"
            and goes on with keys of the product file.
    """

    def __init__(self, *places: tuple[tuple[str | int, ...], str]) -> None:
        self.places = places
        super().__init__(*(f"{'.'.join(map(str, location))}: {what}" for location, what in places))


class DeviceFault(CellError):
    """A device stopped answering or reported a fault; the controller stops safely (exit status 3).

    Examples: no gripper heartbeat for 1.5 periods, an arm that left its commanded trajectory.
    """

    def __init__(self, device: str, reason: str) -> None:
        self.device = device
        self.reason = reason
        super().__init__(f"{device}: {reason}")


class LatchedFault(DeviceFault):
    """A device reports a fault that only a reset takes away; short losses of its link are plain DeviceFaults.

    Examples: overcurrent of a gripper, a simulated world whose process is gone.
    """


class ModelError(CellError):
    """A learned model file is missing, damaged, or does not fit the product (exit status 2)."""


class LogError(CellError):
    """A log cannot be read, is damaged, or is not what was asked for (exit status 2).

    Examples: no MCAP file, a chunk that does not match its checksum, a message that is missing in mid-log.
    """

    def __init__(self, log: Path, reason: str) -> None:
        self.log = log
        self.reason = reason
        super().__init__(f"{log}: {reason}")
