"""Children that are never ticked, because what stands before them never lets the parent go on.

For every node the set of results that it can end with is worked out from the bottom up; leaves but AlwaysSuccess and
AlwaysFailure can succeed and fail. A set without SUCCESS, FAILURE and SKIPPED is that of a node that never ends.
"""

from __future__ import annotations

from collections.abc import Iterator

from py_trees.common import Status

from cell.interfaces.errors import Problem
from trees.engine.node import FAILURE, SKIPPED, SUCCESS
from trees.files.library import Library, bottom_up, called
from trees.files.registry import BUILT_IN, tag_of
from trees.files.xml_file import Element, node_tag

Results = frozenset[Status]

NEVER: Results = frozenset()
BOTH: Results = frozenset((SUCCESS, FAILURE))
SEQUENCES = ("Sequence", "AsyncSequence", "SequenceWithMemory", "ReactiveSequence")
FALLBACKS = ("Fallback", "AsyncFallback", "ReactiveFallback")
BRANCHES = ("IfThenElse", "WhileDoElse")
PARALLELS = ("Parallel", "ParallelAll")
_ADDED = {"_failureIf": FAILURE, "_successIf": SUCCESS, "_skipIf": SKIPPED, "_while": SKIPPED}
_ANY_END = ("Precondition", "LoopInt", "LoopBool", "LoopDouble", "LoopString", "RunOnce", "SkipUnlessUpdated")
_KNOWN = {tag_of(node) for node in BUILT_IN}
_WORDS = {SUCCESS: "succeeds", FAILURE: "fails", SKIPPED: "is skipped"}


def check_reach(library: Library) -> list[Problem]:
    """The first child that is never ticked, of every node; for a library without other problems."""
    reach = _Reach()
    for element in bottom_up(library):
        reach.take(element, called(library, element))
    return reach.problems


class _Reach:
    """The results of all nodes taken so far."""

    def __init__(self) -> None:
        self._ends: dict[int, Results] = {}
        self.problems: list[Problem] = []

    def take(self, element: Element, children: list[Element]) -> None:
        """Work out a node's results from those of its children."""
        ends = self._results(element, [self._ends[id(child)] for child in children])
        added = {status for name, status in _ADDED.items() if name in element.attributes}
        self._ends[id(element)] = ends | added

    def _results(self, element: Element, below: list[Results]) -> Results:
        tag = node_tag(element)
        if element.broken:
            return BOTH | {SKIPPED}
        if element.tag == "SubTree":
            return below[0] if len(below) == 1 else BOTH | {SKIPPED}
        if tag in SEQUENCES or tag in FALLBACKS:
            return self._in_order(element, below, SUCCESS if tag in SEQUENCES else FAILURE)
        if tag in BRANCHES:
            return self._branches(element, below)
        if tag in PARALLELS:
            return BOTH | {SKIPPED} if any(below) else NEVER
        if not below:
            return {"AlwaysSuccess": frozenset((SUCCESS,)), "AlwaysFailure": frozenset((FAILURE,))}.get(tag, BOTH)
        if tag not in _KNOWN:
            return BOTH | {SKIPPED}  # an own control or decorator may do anything with its children's results
        if len(below) == 1:
            unset = {FAILURE} if any("{" in attribute.value for attribute in element.attributes.values()) else set()
            return frozenset({*_decorated(element, tag, below[0]), *unset})
        return frozenset((FAILURE, SKIPPED)).union(*below)

    def _in_order(self, element: Element, below: list[Results], continue_on: Status) -> Results:
        results = set[Status]()
        for index, (child, ends) in enumerate(zip(element.children, below, strict=True)):
            results |= ends - {continue_on, SKIPPED}
            if not ends & {continue_on, SKIPPED}:
                if index + 1 < len(below):
                    self._unreachable(element.children[index + 1], child, ends)
                return frozenset(results)
        if all(SKIPPED in ends for ends in below):
            results.add(SKIPPED)
        if any(continue_on in ends for ends in below):
            results.add(continue_on)
        return frozenset(results)

    def _branches(self, element: Element, below: list[Results]) -> Results:
        results = set(below[0] & {SKIPPED})
        for index, status in ((1, SUCCESS), (2, FAILURE)):
            if status in below[0]:
                results |= below[index] if index < len(below) else {FAILURE}
            elif index < len(below):
                self._unreachable(element.children[index], element.children[0], below[0])
        return frozenset(results)

    def _unreachable(self, child: Element, before: Element, ends: Results) -> None:
        does = "always " + " or ".join(_WORDS[status] for status in BOTH if status in ends) if ends else "never ends"
        what = f"{node_tag(child)} is never ticked: {node_tag(before)} at line {before.place.line} before it {does}"
        self.problems.append(Problem(child.place, what, "remove it, or let the node before it end otherwise"))


def _decorated(element: Element, tag: str, child: Results) -> Iterator[Status]:
    """What a decorator makes of its child's results."""
    forced = {"ForceSuccess": SUCCESS, "ForceFailure": FAILURE}
    turned = {SUCCESS: FAILURE, FAILURE: SUCCESS}
    for status in child:
        if tag in forced and status is not SKIPPED:
            yield forced[tag]
        elif tag == "Inverter":
            yield turned.get(status, status)
        elif not (status is SUCCESS and _only_failure_ends(element, tag)) and not (
            status is FAILURE and _endless(element, tag, "RetryUntilSuccessful", "num_attempts")
        ):
            yield status
    if tag == "Timeout":
        yield FAILURE
    if tag in _ANY_END:
        yield from (SUCCESS, FAILURE, SKIPPED)


def _only_failure_ends(element: Element, tag: str) -> bool:
    return tag == "KeepRunningUntilFailure" or _endless(element, tag, "Repeat", "num_cycles")


def _endless(element: Element, tag: str, wanted: str, port: str) -> bool:
    return tag == wanted and (element.get(port) or "").strip() == "-1"
