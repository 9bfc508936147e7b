"""Behaviour trees in Python: BehaviorTree.CPP 4 XML files and trees written in Python, and the engine that runs them.

Example:
    A node of your own, and its test:

        from btxml import Bench, InputPort, Node, Sequence, Status

        class Greet(Node):
            \"\"\"Say hello.\"\"\"

            name_of = InputPort(str)

            def update(self) -> Status:
                return Status.SUCCESS

        bench = Bench(Sequence("greet", [Greet(name_of="Ann")]), real=[Greet])
        assert bench.tick() == "S"
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from btxml.engine.choices import IfThenElse, TryCatch, WhileDoElse
    from btxml.engine.controls import (
        AsyncFallback,
        AsyncSequence,
        Fallback,
        ReactiveFallback,
        ReactiveSequence,
        Sequence,
        SequenceWithMemory,
    )
    from btxml.engine.decorators import (
        Delay,
        ForceFailure,
        ForceSuccess,
        Inverter,
        KeepRunningUntilFailure,
        Precondition,
        RunOnce,
        SkipUnlessUpdated,
        SubTree,
        Timeout,
        WaitValueUpdate,
    )
    from btxml.engine.errors import NodeError
    from btxml.engine.leaves import (
        AlwaysFailure,
        AlwaysSuccess,
        Script,
        ScriptCondition,
        SetBlackboard,
        Sleep,
        UnsetBlackboard,
        WasEntryUpdated,
    )
    from btxml.engine.loops import LoopBool, LoopDouble, LoopInt, LoopString, Repeat, RetryUntilSuccessful
    from btxml.engine.node import Control, Decorator, Node
    from btxml.engine.outside import Outside
    from btxml.engine.parallel import Parallel, ParallelAll
    from btxml.engine.ports import InOutPort, InputPort, OutputPort
    from btxml.engine.py_trees_adapter import PyTreesLeaf, as_py_trees
    from btxml.engine.status import Status
    from btxml.engine.traits import Traits
    from btxml.engine.tree import Tree
    from btxml.files.loader import load_tree, tree
    from btxml.testing import TreeBench as Bench

    Switch2 = Switch3 = Switch4 = Switch5 = Switch6 = Control

_ENGINE = {
    "choices": "IfThenElse Switch2 Switch3 Switch4 Switch5 Switch6 TryCatch WhileDoElse",
    "controls": "AsyncFallback AsyncSequence Fallback ReactiveFallback ReactiveSequence Sequence SequenceWithMemory",
    "decorators": "Delay ForceFailure ForceSuccess Inverter KeepRunningUntilFailure Precondition RunOnce "
    "SkipUnlessUpdated SubTree Timeout WaitValueUpdate",
    "leaves": "AlwaysFailure AlwaysSuccess Script ScriptCondition SetBlackboard Sleep UnsetBlackboard WasEntryUpdated",
    "loops": "LoopBool LoopDouble LoopInt LoopString Repeat RetryUntilSuccessful",
    "errors": "NodeError",
    "node": "Control Decorator Node",
    "outside": "Outside",
    "parallel": "Parallel ParallelAll",
    "ports": "InOutPort InputPort OutputPort",
    "py_trees_adapter": "PyTreesLeaf as_py_trees",
    "status": "Status",
    "traits": "Traits",
    "tree": "Tree",
}
_HOME = {name: (f"btxml.engine.{module}", name) for module, names in _ENGINE.items() for name in names.split()} | {
    "Bench": ("btxml.testing", "TreeBench"),
    "load_tree": ("btxml.files.loader", "load_tree"),
    "tree": ("btxml.files.loader", "tree"),
}
# fmt: off
__all__ = [
    "AlwaysFailure", "AlwaysSuccess", "AsyncFallback", "AsyncSequence", "Bench", "Control", "Decorator", "Delay",
    "Fallback", "ForceFailure", "ForceSuccess", "IfThenElse", "InOutPort", "InputPort", "Inverter",
    "KeepRunningUntilFailure", "LoopBool", "LoopDouble", "LoopInt", "LoopString", "Node", "NodeError", "OutputPort",
    "Outside", "Parallel", "ParallelAll", "Precondition", "PyTreesLeaf", "ReactiveFallback", "ReactiveSequence",
    "Repeat", "RetryUntilSuccessful", "RunOnce", "Script", "ScriptCondition", "Sequence", "SequenceWithMemory",
    "SetBlackboard", "SkipUnlessUpdated", "Sleep", "Status", "SubTree", "Switch2", "Switch3", "Switch4", "Switch5",
    "Switch6", "Timeout", "Traits", "Tree", "TryCatch", "UnsetBlackboard", "WaitValueUpdate", "WasEntryUpdated",
    "WhileDoElse", "as_py_trees", "load_tree", "tree",
]
# fmt: on


def __getattr__(name: str) -> object:
    """Load a promised name when it is first asked for."""
    if name not in _HOME:
        raise AttributeError(f"module 'btxml' has no attribute '{name}'; it offers {', '.join(__all__)}")
    module, attribute = _HOME[name]
    return getattr(import_module(module), attribute)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
