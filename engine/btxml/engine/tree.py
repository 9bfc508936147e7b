"""A loaded tree: set up once, ticked at a fixed rate, halted at any time."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from traceback import walk_tb
from typing import Any, NamedTuple, Protocol, runtime_checkable

from btxml.engine.blackboard import Scope
from btxml.engine.clock import Clock, Journal
from btxml.engine.errors import Place
from btxml.engine.node import FAILURE, IDLE, RUNNING, SUCCESS, Runtime, StatusChange, TreeNode
from btxml.engine.outside import LoggedAnswers
from btxml.engine.status import Status
from btxml.engine.why import Reason, explain

CACHE_LIMIT = 10_000  # changes kept for the next time that they are reported


class Origin(NamedTuple):
    """What a node was made of: its tag and its attributes as the file writes them."""

    tag: str
    attributes: Mapping[str, str]


@runtime_checkable
class OnBlackboard(Protocol):
    """Services that hold something which nodes and scripts read as entries."""

    def stand_on(self, blackboard: Scope) -> None:
        """Write it to entries of the main tree, now and as it changes."""
        ...


@runtime_checkable
class Journalled(Protocol):
    """Services with a log."""

    @property
    def journal(self) -> Journal:
        """Takes notes."""
        ...

    @property
    def answers(self) -> LoggedAnswers | None:
        """What leaves were answered in the run that is replayed; None in a run."""
        ...


class Tree:
    """The nodes of one tree and their blackboard.

    Attributes:
        name: ID of the BehaviorTree that runs.
        root: topmost node.
        nodes: all nodes, by uid - 1.
        blackboard: entries of the main tree.
        origins: what each node was made of, by uid - 1.
        places: where each node and its attributes stand, by uid - 1 and name; the node itself by an empty one.
        texts: text of every file that the tree was loaded from, for the log.
        scopes: the main tree's blackboard and those of all SubTrees, outer ones first.
        unused: entries that were set from outside, and that nothing in the tree names.
    """

    def __init__(
        self,
        name: str,
        root: TreeNode,
        nodes: tuple[TreeNode, ...],
        blackboard: Scope,
        texts: Mapping[Path, str],
        runtime: Runtime,
        origins: Sequence[Origin] = (),
        scopes: Sequence[Scope] = (),
        unused: Iterable[str] = (),
        places: Sequence[Mapping[str, Place]] = (),
    ) -> None:
        self.name = name
        self.root = root
        self.nodes = nodes
        self.blackboard = blackboard
        self.texts = texts
        self.origins = tuple(origins)
        self.places = tuple(places)
        self._names: dict[Path, str] = {}
        self.scopes = tuple(scopes) or (blackboard,)
        self.unused = frozenset(unused)
        self._runtime = runtime
        runtime.place_of = self.place_of
        self._change_cache: dict[tuple[int, str, str, str], StatusChange] = {}

    def setup(self, services: Any, clock: Clock) -> None:
        """Give the leaves their services and all nodes the clock; before the first tick."""
        self._runtime.clock = clock
        if isinstance(services, Journalled):
            self._runtime.journal, self._runtime.answers = services.journal, services.answers
        if isinstance(services, OnBlackboard):
            services.stand_on(self.blackboard)
        try:
            for node in self.nodes:
                node.setup(services=services)
        except Exception as error:
            self._place(error)
            raise

    def tick(self) -> Status:
        """Tick once; Status.INVALID means that everything was skipped.

        An exception of a leaf halts the whole tree, so that nothing is left RUNNING, and is raised again.
        """
        runtime = self._runtime
        runtime.changes.clear()
        runtime.ticks += 1
        try:
            status = self.root.execute()
            if status is SUCCESS or status is FAILURE:
                self.root.set_status(IDLE)
            runtime.history.follow(runtime.changes, runtime.ticks)
        except BaseException as error:  # a second Ctrl-C in mid-tick, too: nothing may stay RUNNING; it is raised again
            self._place(error)
            self._halt_all()
            raise
        return status

    def halt(self) -> None:
        """Terminate every RUNNING node exactly once; harmless where nothing runs.

        Raises:
            ExceptionGroup: nodes failed to terminate; all others were terminated all the same.
        """
        self._runtime.changes.clear()
        self._runtime.ticks += 1  # what a halt still ticks, such as a TryCatch, has no guard of the last tick
        errors = self._halt_all()
        if errors:
            raise ExceptionGroup("nodes failed to terminate", errors)

    def why(self) -> Reason | None:
        """Why the root ended in the last tick, or why it goes on; None before the first one."""
        root, history = self.root, self._runtime.history
        answer = root.status if root.status is not IDLE else history.of(root).answer
        return None if answer is None else explain(root, answer, history, self.place_of)

    def place_of(self, node: TreeNode, attribute: str = "") -> tuple[str, int]:
        """File, named from the folder that holds all files of the tree, and line of a node or one of its attributes."""
        places = self.places[node.uid - 1] if node.uid <= len(self.places) else {}
        place = places.get(attribute) or places.get("")
        return ("", 0) if place is None else (self.short_name(place.file), place.line or 0)

    def _place(self, error: BaseException) -> None:
        """Note which node raised an error, and the line of its own code."""
        for frame, line in reversed([*walk_tb(error.__traceback__)]):
            node, code = frame.f_locals.get("self"), Path(frame.f_code.co_filename)
            if isinstance(node, TreeNode):
                own = "" if code.parent == Path(__file__).parent else f", {code.name}:{line}"
                error.add_note(f"in {node.name} ({':'.join(map(str, self.place_of(node)))}){own}")
                return

    def short_name(self, file: Path) -> str:
        """A file of the tree, as its log names it: from the folder that holds all of them."""
        if file not in self._names:
            whole, folder = file.resolve(), self.folder
            self._names[file] = whole.relative_to(folder).as_posix() if whole.is_relative_to(folder) else file.name
        return self._names[file]

    @cached_property
    def folder(self) -> Path:
        """The folder that holds all files of the tree."""
        return Path(os.path.commonpath([path.resolve().parent for path in self.texts]))

    @property
    def xml(self) -> str:
        """The text of its file, also of a tree that was written in Python."""
        return next(iter(self.texts.values()))

    @property
    def status_changes(self) -> list[StatusChange]:
        """What changed in the last tick or halt, in order."""
        cache = self._change_cache
        try:  # `_value_` because `value` and the hash of an enum member run Python code
            return [cache[node.uid, old._value_, new._value_, text] for node, old, new, text in self._runtime.changes]
        except KeyError:  # rare: a tree does the same over and over
            self._fill_cache()
            return self.status_changes

    def _fill_cache(self) -> None:
        """Make the changes that were never told before; forget the others where feedback is new in every tick."""
        changes = self._runtime.changes
        if len(self._change_cache) > CACHE_LIMIT:
            self._change_cache.clear()
        for node, old, new, feedback in changes:
            key = node.uid, old._value_, new._value_, feedback
            if key not in self._change_cache:
                self._change_cache[key] = StatusChange(node.full_path, node.uid, old, new, feedback)

    @property
    def status(self) -> Status:
        """The root's status."""
        return self.root.status

    def _halt_all(self) -> list[Exception]:
        """Halt from the root down; where a node raises, go on with what still runs."""
        errors: list[Exception] = []
        for node in self.nodes:
            if node.status is RUNNING:
                try:
                    node.halt()
                except Exception as error:  # a leaf of the user's own may raise anything; the others are halted, too
                    self._place(error)
                    errors.append(error)
        for node in self.nodes:
            node.set_status(IDLE)
        return errors
