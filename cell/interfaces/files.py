"""Where files are: those that come with the program, and the user's own in the working folder."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

INSTALLED = Path(str(resources.files("cell"))).parent  # all packages stand side by side, in a clone and when installed


def shipped(package: str, *names: str) -> Path:
    """A file or folder that is installed with a package, as in `shipped("config", "gripper.dbc")`.

    The package is not imported for it: the user's own folders `config` and `trees` may come first where Python looks.
    """
    return INSTALLED.joinpath(*package.split("."), *names)


def own_or_shipped(package: str, *names: str) -> Path:
    """The first file of these names in the working folder's `package`, else the first that comes with the program."""
    own = (Path.cwd() / package / name for name in names)
    return next((file for file in own if file.is_file()), shipped(package, names[0]))
