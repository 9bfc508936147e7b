"""Tree files in BehaviorTree.CPP v4 XML, the engine that runs them, and the node library.

Example:
    A node of your own:

        from trees import InputPort, Node, Status

        class Greet(Node):
            \"\"\"Say hello.\"\"\"

            name_of = InputPort(str)

            def update(self) -> Status:
                return Status.SUCCESS
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from trees.engine.node import Node
    from trees.engine.ports import InputPort, OutputPort
    from trees.engine.status import Status
    from trees.engine.traits import Traits
    from trees.files.loader import load_tree
    from trees.testing import TreeBench as Bench

_HOME = {
    "Bench": ("trees.testing", "TreeBench"),
    "InputPort": ("trees.engine.ports", "InputPort"),
    "Node": ("trees.engine.node", "Node"),
    "OutputPort": ("trees.engine.ports", "OutputPort"),
    "Traits": ("trees.engine.traits", "Traits"),
    "Status": ("trees.engine.status", "Status"),
    "load_tree": ("trees.files.loader", "load_tree"),
}
__all__ = ["Bench", "InputPort", "Node", "OutputPort", "Status", "Traits", "load_tree"]


def __getattr__(name: str) -> object:
    """Load a promised name when it is first asked for."""
    if name not in _HOME:
        raise AttributeError(f"module 'trees' has no attribute '{name}'; it offers {', '.join(__all__)}")
    module, attribute = _HOME[name]
    return getattr(import_module(module), attribute)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
