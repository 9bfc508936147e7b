"""Packages that only sweeps and tables need: imported when they are, with a clear word where they are missing."""

from __future__ import annotations

import importlib
from typing import Any

from cell.interfaces.errors import InputError

INSTALL = 'pip install "cell[fleet]", in a clone: .venv/bin/pip install -e ".[fleet]"'


def needed(module: str, why: str) -> Any:
    """The module.

    Raises:
        InputError: its package is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise InputError(f"{why} needs the package {package}, which is not installed: {INSTALL}") from None
