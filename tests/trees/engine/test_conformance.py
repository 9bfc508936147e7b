"""Random trees behave here as in BehaviorTree.CPP: leaves, all statuses and the blackboard, tick by tick.

Every mode compares, after each tick and halt, the order of what leaves did, the root's answer, the status of every
node and the values of the main tree; the modes in `IN_ORDER` compare every single status change, in order.
"""

from __future__ import annotations

import math
import os
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from bracket_ground.interfaces.clock import ManualClock
from tests.trees.engine.agreement import (
    JUDGED_ALONE,
    MODES,
    PROGRAM,
    SIZE,
    UNLISTED,
    VERSIONS,
    WORDS,
    differences,
    shown,
    stored,
    verdicts,
)
from tests.trees.engine.differential import (
    Judge,
    Original,
    Ours,
    both,
    compare,
    read_changes,
    standard_output,
)
from tests.trees.engine.differential import (
    differences as differing,
)
from tests.trees.engine.random_trees import SHORT_MS, Case, Features, Generator

PUSHED, MANY = range(40), range(10_000, 12_000)  # seeds of every run of the tests, and of the slow ones
# Cases that run side by side, so that all share the waits that the library's own clock needs. The ticks between two
# jumps of the clock take less than the short times of the trees, and a jump takes more.
BATCH, JUMPS, TICKS_A_JUMP = 100, 4, 4
SEGMENT_S, JUMP_S = 0.8 * SHORT_MS / 1000, 1.4 * SHORT_MS / 1000
TRIES = 5


@pytest.fixture(scope="module")
def judge() -> Iterator[Judge]:
    if not PROGRAM.is_file():
        pytest.skip("nobody has built the judge, so nothing was compared: make judge BTCPP_SOURCE=FOLDER")
    made = Judge(PROGRAM)
    yield made
    made.end()


@pytest.fixture(scope="module", params=VERSIONS)
def version(request: pytest.FixtureRequest) -> str:
    """A version whose judge is there."""
    if request.param == VERSIONS[1]:
        request.getfixturevalue("judge")
    return str(request.param)


def assert_agrees(version: str, mode: str, seeds: range, request: pytest.FixtureRequest) -> None:
    if mode in JUDGED_ALONE and version != VERSIONS[1]:
        pytest.skip("its leaves are the judge's own")
    counts: Counter[str] = Counter()
    judge = request.getfixturevalue("judge") if version == VERSIONS[1] else None
    for kind, words in verdicts(version, mode, seeds, judge):
        assert kind != UNLISTED, words
        counts[kind] += 1
    assert counts["equal"] >= len(seeds) / 2, counts
    most = len(seeds) if mode in JUDGED_ALONE else math.ceil(len(seeds) / 100)
    assert counts["refused by both"] <= most, "trees that both sides refuse prove nothing"


@pytest.mark.long
@pytest.mark.parametrize("mode", MODES)
def test_random_trees_run_as_in_behaviortree_cpp(mode: str, version: str, request: pytest.FixtureRequest) -> None:
    assert_agrees(version, mode, PUSHED, request)


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
def test_many_random_trees_run_as_in_behaviortree_cpp(mode: str, version: str, request: pytest.FixtureRequest) -> None:
    assert_agrees(version, mode, MANY, request)


@pytest.mark.parametrize("number", range(len(differences())))
def test_each_listed_difference_is_there(number: int, version: str, request: pytest.FixtureRequest) -> None:
    """And the page says of each version what it does with the tree that shows it."""
    row, column = differences()[number], VERSIONS.index(version)
    found = stored()["differences"][number]
    judge = request.getfixturevalue("judge") if version == VERSIONS[1] else None
    assert shown(row, version, judge) == found[column], row
    assert "tree" not in row or set(found) - {"", WORDS["equal"]}, "no version differs"


def test_the_page_counts_many_trees_of_each_mode_and_no_difference_beyond_its_list() -> None:
    data = stored()["random"]
    assert set(data) == set(MODES)
    for mode, beside in data.items():
        assert set(beside) == set(VERSIONS[1:] if mode in JUDGED_ALONE else VERSIONS)
        for counts in beside.values():
            kinds = {kind: number for kind, number in counts.items() if kind != "seeds"}
            assert sum(kinds.values()) >= len(MANY)
            assert UNLISTED not in kinds, mode


def assert_same_in_time(seeds: range, path: Path) -> None:
    for first in range(seeds.start, seeds.stop, BATCH):
        batch = range(first, min(first + BATCH, seeds.stop))
        tries: list[list[str]] = []
        while [] not in tries and len(tries) < TRIES:
            tries.append(side_by_side(batch, path))
        # What is no accident of the library's threads is found by every try, unless they hardly get a processor.
        if [] not in tries and os.getloadavg()[0] > 2 * (os.cpu_count() or 1):
            pytest.skip("the machine is too busy for the library's own clock")
        assert [] in tries, [found[:3] for found in tries]


def side_by_side(seeds: range, path: Path) -> list[str]:
    """Differences of a batch of cases with times, the first of every case."""
    clock = ManualClock()
    found: dict[int, list[str]] = {}
    with ExitStack() as stack:
        output = stack.enter_context(standard_output())
        pairs = {}
        for seed in seeds:
            case = Generator(seed, SIZE, Features(times=True)).case(JUMPS * TICKS_A_JUMP)
            ours, theirs, refusals = both(case, path, clock, output)
            if len(refusals) == 1:
                found[seed] = [f"seed {seed}", *refusals]
            elif ours is not None and theirs is not None:
                pairs[seed] = Pair(case, ours, theirs)
                stack.callback(theirs.close)
        for segment in range(JUMPS):
            began_s = time.monotonic()
            for seed, pair in pairs.items():
                if seed not in found and (differs := pair.ticks(segment * TICKS_A_JUMP, TICKS_A_JUMP)):
                    found[seed] = [f"seed {seed}", *differs]
            if time.monotonic() - began_s > SEGMENT_S:
                return [f"the machine was too slow: {time.monotonic() - began_s:.2f} s"]
            time.sleep(JUMP_S)
            clock.sleep_until(clock.now_s() + JUMP_S)
            for change in read_changes(output):
                pairs[int(change[0].rsplit(".", 1)[1])].theirs.late.append(change)
    return [str(differs) for differs in found.values()]


@dataclass
class Pair:
    """A case in both engines, and the statuses of its nodes in both."""

    case: Case
    ours: Ours
    theirs: Original
    here: dict[str, str] = field(default_factory=dict)
    there: dict[str, str] = field(default_factory=dict)

    def ticks(self, first: int, count: int) -> list[str]:
        """Differences in ticks after a jump; in the first one the library's timers have halted leaves beforehand."""
        for turn in range(first, first + count):
            if turn > first and turn in self.case.halts:
                halts = self.ours.halt(), self.theirs.halt()
                if differs := differing(*halts, self.here, self.there, in_order=False):
                    return [f"halt before tick {turn}", *differs]
            one, other = self.ours.tick(), self.theirs.tick()
            if turn == first:
                one.events.sort()
                other.events.sort()
            if differs := differing(one, other, self.here, self.there, in_order=False):
                return [f"tick {turn}", *differs]
        return []


def test_random_trees_with_times_run_as_in_behaviortree_cpp(tmp_path: Path) -> None:
    assert_same_in_time(PUSHED, tmp_path / "tree.xml")


@pytest.mark.slow
def test_many_random_trees_with_times_run_as_in_behaviortree_cpp(tmp_path: Path) -> None:
    assert_same_in_time(range(40, 2300), tmp_path / "tree.xml")


def of(body: str, **answers: str) -> Case:
    """A case of a tree with an entry x of 1, in which every node has a name."""
    start = '<RunOnce name="once"><Script name="start" code="x := 1"/></RunOnce>'
    tree = f'<BehaviorTree ID="Main"><Sequence name="main">{start}{body}</Sequence></BehaviorTree>'
    xml = f'<root BTCPP_format="4" main_tree_to_execute="Main">{tree}</root>'
    return Case(xml, xml, answers, frozenset(), 8)


@pytest.mark.parametrize(("number", "after"), [(1, 3), (5, 1), (3, 3)])
def test_a_retry_reads_its_number_again_after_each_failure(number: int, after: int, tmp_path: Path) -> None:
    before = f'<RunOnce name="twice"><Script name="number" code="x := {number}"/></RunOnce>'
    leaf = f'<Leaf name="leaf" _onFailure="x = {after}"/>'
    case = of(f'{before}<RetryUntilSuccessful name="r" num_attempts="{{x}}">{leaf}</RetryUntilSuccessful>', leaf="RF")
    assert compare(case, tmp_path / "tree.xml", True) == []


@pytest.mark.parametrize(
    ("control", "children", "ends"),
    [
        ('Parallel success_count="1" failure_count="-1"', "{runs}{ends}", "S"),
        ("ReactiveFallback", "{ends}{runs}", "FS"),
        ("ReactiveSequence", "{ends}{runs}", "SF"),
    ],
)
def test_what_follows_an_end_sees_what_halted_children_wrote(
    control: str, children: str, ends: str, tmp_path: Path
) -> None:
    leaves = children.format(runs='<Leaf name="runs" _onHalted="x := 3"/>', ends='<Leaf name="ends"/>')
    case = of(f'<{control} name="control" _post="x := x * 2">{leaves}</{control.split()[0]}>', runs="R", ends=ends)
    assert compare(case, tmp_path / "tree.xml", True) == []


def test_the_library_leaves_the_child_of_a_retry_running_whose_number_falls(tmp_path: Path) -> None:
    """A difference that is wanted, and stands in docs/conformance.md."""
    retry = '<RetryUntilSuccessful name="r" num_attempts="{x}"><Leaf name="leaf"/></RetryUntilSuccessful>'
    lowers = '<Sequence name="s"><Leaf name="late"/><Script name="lower" code="x = 0"/><Leaf name="more"/></Sequence>'
    case = of(f'<Parallel name="p">{lowers}<Fallback name="f">{retry}<Leaf name="next"/></Fallback></Parallel>',
              leaf="R", late="RS", more="R", next="R")  # fmt: skip
    found = compare(case, tmp_path / "tree.xml", False)
    assert found is not None
    assert "leaf is IDLE here, RUNNING there" in found
