"""CPU time of a tick: this engine, stock py_trees and BehaviorTree.CPP on the same trees, in one process.

Two kinds of trees are ticked. In the waiting ones all leaves are written in Python and RUNNING, so that every node is
ticked and nothing changes. In the mixed one all nodes are the language's own, in BehaviorTree.CPP native code: scripts,
conditions, values and a SubTree, whose statuses change in every tick. Each round times every engine once, in turn; the
medians over rounds are printed as JSON, with their ratios and the limits that they have to keep.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import behaviortreepy
import py_trees
from py_trees.common import ParallelPolicy
from py_trees.common import Status as StockStatus

from bracket_cell.recording.schemas import tick_json
from bracket_cell.trees.loading import load_tree
from bracket_ground.interfaces.clock import ManualClock
from btxml.engine.node import RUNNING, Node
from btxml.engine.status import Status
from btxml.engine.tree import Tree
from btxml.files.compile.registry import Registry

ROUNDS = 25
ROUND_S = 0.02
BRANCHES = 4
# A run of the assembly tree changes 12 statuses in a tick; each of these pairs changes two.
CHANGING = 6
PAIR = "<KeepRunningUntilFailure><AlwaysSuccess/></KeepRunningUntilFailure>"
BLOCKS = 5
BLOCK = """
<Fallback>
  <Sequence>
    <ScriptCondition code="ready &amp;&amp; n &gt; 100"/>
    <AlwaysSuccess/>
  </Sequence>
  <Sequence _onSuccess="n += 1">
    <Script code="x := n * 2 + 1"/>
    <SetBlackboard value="{x}" output_key="last"/>
    <Inverter><ScriptCondition code="last == 0"/></Inverter>
    <AlwaysSuccess _skipIf="mode == 'idle'" _post="total := x - n"/>
    <Switch2 variable="{mode}" case_1="idle" case_2="work">
      <AlwaysFailure/>
      <AlwaysSuccess/>
      <AlwaysFailure/>
    </Switch2>
  </Sequence>
</Fallback>"""
MIXED = f"""
<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <KeepRunningUntilFailure>
      <Sequence>
        <Script code="n := 0; mode := 'work'; ready := true"/>
        {BLOCKS * BLOCK}
        <SubTree ID="Count" from="{{n}}" limit="7"/>
      </Sequence>
    </KeepRunningUntilFailure>
  </BehaviorTree>
  <BehaviorTree ID="Count">
    <Sequence>
      <ScriptCondition code="from &lt; limit"/>
      <ForceSuccess><Script code="from += 1; left := from * 2"/></ForceSuccess>
    </Sequence>
  </BehaviorTree>
</root>"""
LIMITS = (
    ("ours, 50", "BehaviorTree.CPP, 50", 1.0),
    ("ours, mixed", "BehaviorTree.CPP, mixed", 2.5),
    ("ours, 50", "py_trees, 50", 0.2),
    ("ours, 1000", "ours, 100", 12.0),
    ("ours, chain of 900", "ours, 900", 3.0),
    ("log on", "log off", 1.3),  # 12 changes, told and encoded, beside a tick in which 26 leaves wait
)

Shape = list["Shape"]
Tick = Callable[[], object]
STOCK_RUNNING = StockStatus.RUNNING  # as all three: to ask an enum costs more than a leaf's call


class Busy(Node):
    """Runs for ever."""

    def update(self) -> Status:
        return RUNNING


class StockBusy(py_trees.behaviour.Behaviour):
    """Runs for ever."""

    def update(self) -> StockStatus:
        return STOCK_RUNNING


def balanced(nodes: int) -> Shape:
    """A tree of so many nodes, filled level by level, `BRANCHES` children below each."""
    root: Shape = []
    level, count = [root], 1
    while True:
        below: list[Shape] = []
        for parent in level:
            for _ in range(BRANCHES):
                if count == nodes:
                    return root
                parent.append([])
                below.append(parent[-1])
                count += 1
        level = below


def chain(nodes: int) -> Shape:
    """One node below the other."""
    root: Shape = []
    for _ in range(nodes - 1):
        root = [root]
    return root


def xml(shape: Shape) -> str:
    """The shape as a tree file of Parallels, of Sequences where there is one child."""
    opened: list[str] = []
    waiting: list[Shape | str] = [shape]
    while waiting:
        part = waiting.pop()
        if isinstance(part, str):
            opened.append(part)
        elif not part:
            opened.append("<Busy/>")
        else:
            tag = "Parallel" if len(part) > 1 else "Sequence"
            opened.append(f"<{tag}>")
            waiting += [f"</{tag}>", *reversed(part)]
    return f'<root BTCPP_format="4"><BehaviorTree ID="Main">{"".join(opened)}</BehaviorTree></root>'


def ours(text: str) -> Tree:
    """This engine."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tree.xml"
        path.write_text(text)
        tree = load_tree(path, Registry([Busy]))
    tree.setup(None, ManualClock())
    return tree


def original(text: str) -> Tick:
    """BehaviorTree.CPP; the closure keeps its factory alive."""
    running = behaviortreepy.NodeStatus.RUNNING
    factory = behaviortreepy.BehaviorTreeFactory()
    factory.register_simple_stateful_action("Busy", lambda _: running, lambda _: running, lambda _: None)
    factory.register_behavior_tree_from_text(text)
    tree = factory.create_tree("Main")
    return lambda _factory=factory: tree.tick_exactly_once()  # type: ignore[misc]


def stock(shape: Shape) -> Tick:
    """py_trees as it comes."""

    def node(part: Shape) -> py_trees.behaviour.Behaviour:
        if not part:
            return StockBusy("Busy")
        children = [node(child) for child in part]
        if len(children) == 1:
            return py_trees.composites.Sequence("Sequence", memory=True, children=children)
        policy = ParallelPolicy.SuccessOnAll(synchronise=False)
        return py_trees.composites.Parallel("Parallel", policy=policy, children=children)

    tree = py_trees.trees.BehaviourTree(node(shape))
    return lambda: tree.tick()


def restless(nodes: int) -> str:
    """A balanced tree of which 12 nodes do not stand still."""
    text = xml(balanced(nodes - 2 * CHANGING))
    return text.replace("<Parallel>", "<Parallel>" + CHANGING * PAIR, 1)


def recorded(tree: Tree) -> Tick:
    """A tick with the status log on: its changes are told and encoded as the recorder writes them."""

    def tick() -> None:
        status = tree.tick()
        tick_json(1, status.name, tree.status_changes)

    return tick


def medians(ticks: Sequence[Tick]) -> list[float]:
    """CPU time a tick [us] of each, as medians over rounds in which all take turns."""
    counts = []
    for tick in ticks:
        tick()
        begun_s, count = time.process_time(), 0
        while time.process_time() - begun_s < ROUND_S:
            tick()
            count += 1
        counts.append(count)
    rounds: list[list[float]] = [[] for _ in ticks]
    for _ in range(ROUNDS):
        for times, tick, count in zip(rounds, ticks, counts, strict=True):
            begun_s = time.process_time()
            for _ in range(count):
                tick()
            times.append((time.process_time() - begun_s) / count * 1e6)
    return [statistics.median(times) for times in rounds]


def main() -> None:
    """Time everything and print one JSON document."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    fifty = balanced(50)
    times_us: dict[str, float] = {}
    groups: list[dict[str, Tick]] = [
        {"ours, 50": ours(xml(fifty)).tick, "BehaviorTree.CPP, 50": original(xml(fifty)), "py_trees, 50": stock(fifty)},
        {"ours, mixed": ours(MIXED).tick, "BehaviorTree.CPP, mixed": original(MIXED)},
        {"ours, 100": ours(xml(balanced(100))).tick, "ours, 1000": ours(xml(balanced(1_000))).tick},
        {"ours, chain of 900": ours(xml(chain(900))).tick, "ours, 900": ours(xml(balanced(900))).tick},
        {
            "log off": ours(restless(50)).tick,
            "log on": recorded(ours(restless(50))),
        },
    ]
    for group in groups:
        times_us |= dict(zip(group, medians(list(group.values())), strict=True))
    ratios = [
        {"of": one, "to": other, "ratio": round(times_us[one] / times_us[other], 2), "limit": limit}
        for one, other, limit in LIMITS
    ]
    print(
        json.dumps({"tick_us": {name: round(value, 1) for name, value in times_us.items()}, "ratios": ratios}, indent=2)
    )


if __name__ == "__main__":
    main()
