"""py_trees in both directions: any behaviour of it is a leaf here, and any tree of ours is a behaviour there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from py_trees import behaviour, common, composites, decorators

from btxml.engine.choices import TryCatch
from btxml.engine.controls import ReactiveFallback, ReactiveSequence, Sequence
from btxml.engine.node import Control, Decorator, TreeNode
from btxml.engine.outside import Answer, Asked, Outside, as_text
from btxml.engine.parallel import Parallel, ParallelAll
from btxml.engine.ports import InputPort
from btxml.engine.status import STATUSES, Status
from btxml.engine.tree import Tree

Stock = behaviour.Behaviour


class PyTreesLeaf(Outside):
    """Base of leaves that run a behaviour of py_trees, or a whole tree of them: `make` makes it.

    What a behaviour does to the world it does in a run, and not again in a replay: the log has how it ended.
    """

    abstract = True

    limit_s = InputPort(float, "wall time in [s] after which it is stopped", default=600.0)
    _behaviour: Any = None

    def make(self) -> Stock:
        """The behaviour; called once, before the first tick."""
        raise NotImplementedError

    def read(self, made: Stock) -> Any:  # noqa: ARG002 - who overrides it reads it
        """What the behaviour found out, when it has ended: plain data, which goes to the port `result`."""
        return None

    def prepare(self) -> None:
        if self.runtime.answers is None:
            self._behaviour = self.make()
            for below in self._behaviour.iterate():
                below.setup()

    def question(self) -> Any:
        return self.tag or type(self).__name__

    def call(self, question: Any) -> Asked:  # noqa: ARG002 - the behaviour knows what it does
        return _Ticked(self._behaviour, self.read)

    def take(self, answer: Any) -> Status:
        self.result.set(answer["result"])
        self.feedback_message = answer["feedback"]
        return STATUSES[answer["status"]]


class _Ticked:
    """A behaviour that is ticked whenever somebody asks for its answer."""

    def __init__(self, made: Stock, read: Callable[[Stock], Any]) -> None:
        self._made, self._read = made, read

    def poll(self, polls: int) -> Answer | None:  # noqa: ARG002 - a log counts them
        made = self._made
        try:
            made.tick_once()
            if made.status is common.Status.RUNNING:
                return None
            ended = {"status": made.status.name, "feedback": made.feedback_message, "result": self._read(made)}
            return Answer(as_text(ended))
        except Exception as error:  # a behaviour may raise anything; the leaf fails with it
            return Answer(error=f"{type(error).__name__}: {error}")

    def cancel(self) -> None:
        self._made.stop(common.Status.INVALID)

    @property
    def begun(self) -> bool:
        return True


def as_py_trees(tree: Tree) -> Stock:
    """A tree that was set up, as py_trees' behaviours: its displays, visitors and trees take them.

    One behaviour stands for every node, with its name, children and status; to tick or stop the topmost one ticks or
    halts the tree.
    """
    shown: dict[TreeNode, Any] = {}
    for node in reversed(tree.nodes):  # children come after their parents
        shown[node] = _shown(node, [shown[child] for child in node.children])
    root = shown[tree.root]
    root.tree, root.shown = tree, shown
    return root  # type: ignore[no-any-return]


class _Shown:
    """A node as py_trees sees it; the topmost one knows the tree."""

    tree: Tree
    shown: dict[TreeNode, Any]
    status: common.Status

    def tick(self) -> Iterator[Stock]:
        """Tick the tree; yields the nodes that were ticked, children first."""
        answered = _tick(self.tree)
        self._follow()
        for node, status in answered:
            self.shown[node].status = _stock(status)
        yield from (self.shown[node] for node, _ in answered)

    def stop(self, new_status: common.Status = common.Status.INVALID) -> None:
        """Halt the tree."""
        if new_status is common.Status.INVALID:
            self.tree.halt()
            self._follow()
        self.status = new_status

    def tip(self) -> Stock | None:
        """The deepest node that runs."""
        running = [node for node in self.tree.nodes if node.status is Status.RUNNING]
        return self.shown[running[-1]] if running else None

    def update(self) -> common.Status:
        """Asked by nobody: the tree decides."""
        return self.status

    def _follow(self) -> None:
        for node, shown in self.shown.items():
            shown.status, shown.feedback_message = _stock(node.status), node.feedback_message


class _Leaf(_Shown, behaviour.Behaviour):
    pass


class _Sequence(_Shown, composites.Sequence):
    pass


class _Selector(_Shown, composites.Selector):
    pass


class _Parallel(_Shown, composites.Parallel):
    pass


class _Decorator(_Shown, decorators.Decorator):
    pass


def _shown(node: TreeNode, children: list[Stock]) -> Stock:
    if isinstance(node, Sequence | ReactiveSequence | TryCatch):
        return _Sequence(node.name, isinstance(node, Sequence), children)
    if isinstance(node, Parallel | ParallelAll):
        return _Parallel(node.name, common.ParallelPolicy.SuccessOnAll(synchronise=False), children)
    if isinstance(node, Control):
        return _Selector(node.name, not isinstance(node, ReactiveFallback), children)
    return _Decorator(node.name, children[0]) if isinstance(node, Decorator) else _Leaf(node.name)


def _tick(tree: Tree) -> list[tuple[TreeNode, Status]]:
    """Tick a tree; what each node that was ticked answered, in the order of their answers."""
    answered: list[tuple[TreeNode, Status]] = []
    before = [vars(node).get("execute") for node in tree.nodes]  # a monitor's hook, where there is one
    for node in tree.nodes:
        vars(node)["execute"] = _noting(node, answered)
    try:
        tree.tick()
    finally:
        for node, own in zip(tree.nodes, before, strict=True):
            if own is None:
                del vars(node)["execute"]
            else:
                vars(node)["execute"] = own
    return answered


def _noting(node: TreeNode, answered: list[tuple[TreeNode, Status]]) -> Callable[[], Status]:
    execute = node.execute

    def noted() -> Status:
        status = execute()
        answered.append((node, status))
        return status

    return noted


def _stock(status: Status) -> common.Status:
    """py_trees has no word for SKIPPED."""
    return common.Status.INVALID if status is Status.SKIPPED else common.Status[status.name]
