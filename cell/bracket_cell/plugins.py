"""Classes of others that a configuration names: by MODULE:CLASS or by entry point, with settings of their own."""

from __future__ import annotations

import importlib
import inspect
import sys
from collections.abc import Callable, Iterable, Mapping
from functools import reduce
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, PrivateAttr, ValidationError

from bracket_ground.errors import SettingError
from bracket_ground.files.model import Model
from bracket_ground.files.yaml_file import suggestion

Location = tuple[str, ...]  # of a section in the configuration, as ("devices", "arm")


class Chosen(Model):
    """What a section of a configuration chooses, with the settings of its class next to `kind`."""

    model_config = ConfigDict(extra="allow")
    kind: str
    _folder: Path = PrivateAttr(Path())

    def model_post_init(self, context: Any) -> None:
        """Keep where the file stands."""
        self._folder = Path((context or {}).get("folder", ".")).resolve()

    @property
    def folder(self) -> Path:
        """Where the file stands that names the class."""
        return self._folder

    @property
    def settings(self) -> dict[str, Any]:
        """What stands next to the known keys, as it was read."""
        return dict(self.model_extra or {})


class NoSettings(BaseModel):
    """Of a class that names no model of its settings."""


def offered_by_packages(group: str) -> dict[str, str]:
    """MODULE:NAME by the names of the entry points that installed packages have in a group."""
    return {point.name: point.value for point in entry_points(group=group)}


def attribute(name: str) -> Any:
    """What MODULE:NAME names; NAME may have dots."""
    module, _, path = name.partition(":")
    return reduce(getattr, path.split("."), importlib.import_module(module))


def found_by(
    kind: str,
    installed: Mapping[str, str],
    section: Location,
    folder: Path,
    shipped: Iterable[str],
    wanted: tuple[type, ...] = (type,),
) -> Any:
    """What a kind names: a class in a module, or what an installed package offers by that name.

    Args:
        installed: MODULE:NAME by the names of entry points.
        folder: of the configuration: modules are looked for there first.
        shipped: kinds of the project, for the message.
        wanted: what it may be.

    Raises:
        SettingError: there is none, or it cannot be loaded.
    """
    module, _, name = (kind if ":" in kind else installed.get(kind, "")).partition(":")
    if not module:
        legal = ", ".join((*shipped, *sorted(installed)))
        what = f"no kind {kind!r} of {section[-1]}; legal: {legal}, or MODULE:CLASS"
        raise SettingError(((*section, "kind"), what))
    found = getattr(_imported(module, section, folder), name, None)
    if not isinstance(found, wanted):
        raise SettingError(((*section, "kind"), f"{module} has no class {name!r}"))
    return found


def _imported(module: str, section: Location, folder: Path) -> Any:
    """A module in the folder of the configuration, in the working folder, or installed.

    Raises:
        SettingError: there is none, or it cannot be loaded.
    """
    folders = [str(folder), str(Path.cwd())]
    before = sys.path[:]
    sys.path[:0] = folders
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        where = f"; looked for in {' and '.join(dict.fromkeys(folders))}" if error.name == module else ""
        raise SettingError(((*section, "kind"), f"no module {error.name!r}{where}")) from None
    except (Exception, SystemExit) as error:  # a user's module may raise anything, or end the program
        what = f"{module} cannot be loaded: {type(error).__name__}: {error}"
        raise SettingError(((*section, "kind"), what)) from error
    finally:
        sys.path[:] = [*before, *(path for path in folders if path not in before)]  # for what it imports later on


def settings_of(
    make: Callable[..., Any], kind: str, given: Mapping[str, Any], section: Location, folder: Path
) -> BaseModel:
    """What stands next to `kind`, as the class's own model `Settings`; paths are relative to the folder.

    Raises:
        SettingError: with every problem.
    """
    model = getattr(make, "Settings", NoSettings)
    if not (isinstance(model, type) and issubclass(model, BaseModel)):
        raise SettingError(((*section, "kind"), f"{kind}.Settings is not a pydantic model"))
    legal = ("kind", *model.model_fields)
    problems: list[tuple[Location, str]] = [
        ((*section, name), f"unknown key {name!r}; {suggestion(name, legal)}") for name in given if name not in legal
    ]
    try:
        read = model.model_validate({name: value for name, value in given.items() if name in legal})
    except ValidationError as error:
        for details in error.errors():
            places = tuple(map(str, details["loc"]))
            missing = details["type"] == "missing"
            said = (
                f"key {places[-1]!r} is missing" if missing else f"{'.'.join((section[-1], *places))}: {details['msg']}"
            )
            problems.append(((*section, *places), said))
    if problems:
        raise SettingError(*problems)
    paths = {name: folder / value for name, value in read if isinstance(value, Path)}
    return read.model_copy(update=paths)


def asked(make: Callable[..., Any], offered: Iterable[str], section: Location, noun: str) -> tuple[str, ...]:
    """What a class or function wants, by the names of its parameters.

    Args:
        noun: what it is, for the message.

    Raises:
        SettingError: it wants something that there is not.
    """
    offered = tuple(offered)
    parameters = inspect.signature(make).parameters.values()
    named = [each for each in parameters if each.kind not in (each.VAR_POSITIONAL, each.VAR_KEYWORD)]
    unknown = [each.name for each in named if each.name not in offered and each.default is each.empty]
    if unknown:
        what = f"the {noun} asks for {', '.join(unknown)}; there is: {', '.join(offered)}"
        raise SettingError(((*section, "kind"), what))
    return tuple(each.name for each in named if each.name in offered)


def lacking(found: object, protocol: type, *more: str) -> list[str]:
    """Names of a protocol that a class lacks, or an object, which must have the attributes as well as the methods."""
    members = {name: value for name, value in vars(protocol).items() if not name.startswith("_")}
    methods = [*(name for name, value in members.items() if callable(value)), *more]
    others = [] if isinstance(found, type) else [name for name in members if name not in methods]
    missing = [name for name in methods if not callable(getattr(found, name, None))]
    return list(dict.fromkeys((*missing, *(name for name in others if not hasattr(found, name)))))
