"""Controls that tick all their children in every tick."""

from __future__ import annotations

from collections.abc import Mapping

from btxml.engine.errors import NodeError
from btxml.engine.literals import number_in
from btxml.engine.node import FAILURE, RUNNING, SKIPPED, SUCCESS, Control, TreeNode
from btxml.engine.ports import InputPort
from btxml.engine.status import ANY, NEVER, Status
from btxml.engine.traits import Traits
from btxml.engine.why import VERBS, Decision, History


def _too_many(children: int, values: Mapping[str, str]) -> tuple[str, str] | None:
    """A count that is spelt out and that so few children never reach."""
    for name in ("success_count", "failure_count", "max_failures"):
        count = number_in(values.get(name, ""))
        if count is not None and count > children:
            does = "succeed" if name == "success_count" else "fail"
            return name, f"{children} {'child' if children == 1 else 'children'} can never {does} {count:g} times"
    return None


class _AtOnce(Control):
    """All children in every tick."""

    traits = Traits(at_once=True, results=lambda below, _: ANY if any(below) else NEVER, impossible=_too_many)

    _finished: set[TreeNode]
    _succeeded = 0
    _failed = 0

    def _begin(self) -> None:
        self._finished = set()
        self._succeeded = self._failed = 0
        self.set_status(RUNNING)

    def decision(self, answer: Status, history: History) -> Decision:
        """Those that ended so, in the order of time; of those that run, whoever commands a device counts most."""
        same = history.those(self, answer)
        if answer is RUNNING:
            return Decision(sorted(same, key=_commands))
        same.sort(key=lambda child: history.of(child).answered)
        words = f"{len(same)} of {len(self.children)} {VERBS[answer]}"
        if not same:
            return Decision((), f"{words}: {self.limits()}", "if its counts were other ones")
        return Decision(same, f"{words}: {self.limits()}")

    def limits(self) -> str:
        """How many of its children may do what."""
        raise NotImplementedError


class Parallel(_AtOnce):
    """Ticks all children in every tick until enough have succeeded or failed; those that finished wait."""

    success_count = InputPort(int, "children that must succeed; negative counts from all (-1: all)", default=-1)
    failure_count = InputPort(int, "children that must fail; negative counts from all (-1: all)", default=1)

    _fixed: tuple[int, int, int] | None = None

    def run(self) -> Status:
        count = len(self.children)
        asked, needed, fatal = self._fixed or self._thresholds()
        if self.status is not RUNNING:
            self._begin()
        finished, skipped = self._finished, 0
        first = True  # counted even if it runs: the ports may ask for less than in the last tick
        for child in self.children:
            if not finished or child not in finished:
                status = child.execute()
                if status is RUNNING:
                    if not first:
                        continue  # nothing new to count
                elif status is SKIPPED:
                    skipped += 1
                else:
                    finished.add(child)
                    self._succeeded += status is SUCCESS
                    self._failed += status is FAILURE
            first = False
            if self._succeeded >= needed or (asked < 0 and self._succeeded + skipped >= needed):
                return SUCCESS
            if count - self._failed < needed or self._failed == fatal:
                return FAILURE
        return SKIPPED if skipped == count else RUNNING

    def limits(self) -> str:
        _, needed, fatal = self._fixed or self._thresholds()
        return f"{needed} must succeed, {fatal} may not fail"

    def _thresholds(self) -> tuple[int, int, int]:
        """`success_count` as asked for, and both thresholds; worked out once where the file spells both out."""
        count = len(self.children)
        asked = self.success_count.get()
        needed, fatal = _threshold(asked, count), _threshold(self.failure_count.get(), count)
        if needed > count or fatal > count:
            raise NodeError(f"{count} children can neither succeed {needed} times nor fail {fatal} times")
        if self.success_count.constant and self.failure_count.constant:
            self._fixed = asked, needed, fatal
        return asked, needed, fatal


class ParallelAll(_AtOnce):
    """Ticks all children until every one has finished; fails where too many of them failed."""

    max_failures = InputPort(int, "failures from which this node fails; negative counts from all", default=1)

    def run(self) -> Status:
        count = len(self.children)
        fatal = _threshold(self.max_failures.get(), count)
        if fatal > count:
            raise NodeError(f"{count} children cannot fail {fatal} times")
        if self.status is not RUNNING:
            self._begin()
        skipped = 0
        for child in self.children:
            if child in self._finished:
                continue
            status = child.execute()
            if status is SKIPPED:
                skipped += 1
            elif status is not RUNNING:
                self._finished.add(child)
                self._failed += status is FAILURE
        if skipped == count:
            return SKIPPED
        if skipped + len(self._finished) < count:
            return RUNNING
        return FAILURE if self._failed >= fatal else SUCCESS

    def limits(self) -> str:
        return f"{_threshold(self.max_failures.get(), len(self.children))} may not fail"


def _commands(node: TreeNode) -> bool:
    """Whether it, or a node below it, commands a device."""
    return bool(node.traits.claims) or any(map(_commands, node.children))


def _threshold(asked: int, count: int) -> int:
    """Negative thresholds count from the number of children: -1 is all of them."""
    if asked >= 0:
        return asked
    return max(count + asked + 1, 0)
