"""Where weights are shipped, and what training them needs."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from cell.interfaces.errors import InputError
from cell.interfaces.files import shipped
from cell.interfaces.planning import weights_file


def shipped_weights(planner: str, kind: str) -> Path:
    """File of the weights that come with the program."""
    return shipped("learned", "weights", weights_file(planner, kind))


def need_torch() -> None:
    """Check that training can run here.

    Raises:
        InputError: packages are missing; the message says how to get them.
    """
    missing = [name for name in ("torch", "torch_geometric", "onnx", "onnxscript") if find_spec(name) is None]
    if missing:
        raise InputError(f"training needs {', '.join(missing)}; install with: make train-deps")
