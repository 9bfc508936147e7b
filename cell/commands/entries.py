"""Entries of the main tree that the command line gives: `--set part=o2`, `--set order.yaml`."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from cell.errors import InputError

_NAME = re.compile(r"[^\W\d][\w./-]*\Z")


def entries_of(given: Iterable[str] | None) -> dict[str, Any]:
    """Values by entry; a number where it reads as one, else a text.

    Raises:
        InputError: one is neither NAME=VALUE nor a YAML file of such.
    """
    entries: dict[str, Any] = {}
    for one in given or ():
        name, sign, value = one.partition("=")
        if sign:
            entries[_checked(name, one)] = _value(value)
        else:
            entries |= {_checked(str(key), one): _plain(value, one) for key, value in _file(Path(one)).items()}
    return entries


def _value(text: str) -> Any:
    from trees.engine.literals import constant

    return constant(text)


def _checked(name: str, given: str) -> str:
    if not _NAME.match(name):
        raise InputError(f"--set {given}: {name!r} is no name of an entry; like part=o2")
    return name


def _plain(value: object, given: str) -> object:
    if isinstance(value, list) and all(isinstance(one, bool | int | float | str) for one in value):
        return value
    if isinstance(value, bool | int | float | str):
        return value
    raise InputError(f"--set {given}: entries are numbers, texts, true, false and lists of these, not {value!r}")


def _file(path: Path) -> dict[Any, Any]:
    import yaml

    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(f"--set {path}: neither NAME=VALUE nor a YAML file that can be read: {error}") from None
    if not isinstance(content, dict):
        raise InputError(f"--set {path}: the file must hold names and values, like part: o2")
    return content
