"""CPU time of a node in a tick, kind by kind: this engine beside BehaviorTree.CPP's native code (4.8, by its binding).

    python -m tests.benchmarks.node_ticks

Each kind, with the leaves that stand in it, is there `COPIES` times in a Sequence that is ticked again and again; what
the same tree costs without them is taken away. Medians over rounds in which both are timed in turn.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import behaviortreepy

from bracket_cell.trees.loading import load_tree
from bracket_ground.interfaces.clock import ManualClock
from btxml.files.compile.registry import Registry

COPIES, ROUNDS, ROUND_S = 40, 15, 0.02
LEAF = "<AlwaysSuccess/>"
KINDS = {
    "AlwaysSuccess": LEAF,
    "Sequence": f"<Sequence>{LEAF}</Sequence>",
    "Fallback": f"<Fallback>{LEAF}</Fallback>",
    "ReactiveSequence with a guard": f'<ReactiveSequence><ScriptCondition code="n == 1"/>{LEAF}</ReactiveSequence>',
    "Inverter": "<Inverter><AlwaysFailure/></Inverter>",
    "ForceSuccess": f"<ForceSuccess>{LEAF}</ForceSuccess>",
    "IfThenElse": f"<IfThenElse>{LEAF}{LEAF}</IfThenElse>",
    "Script": '<Script code="m := n + 1"/>',
    "ScriptCondition": '<ScriptCondition code="n == 1"/>',
    "SetBlackboard": '<SetBlackboard value="{n}" output_key="m"/>',
    "Switch2 on a text": f'<Switch2 variable="{{w}}" case_1="b" case_2="a">{LEAF * 3}</Switch2>',
    "SubTree with remaps": '<SubTree ID="Inner" x="{n}" y="{m}"/>',
    "a leaf with _skipIf": '<AlwaysSuccess _skipIf="n == 2"/>',
}
FILE = """<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main"><KeepRunningUntilFailure><Sequence>
<Script code="n := 1; m := 0; w := 'a'"/>{}<Script code="k := m"/></Sequence></KeepRunningUntilFailure></BehaviorTree>
<BehaviorTree ID="Inner"><AlwaysSuccess/></BehaviorTree></root>"""

Tick = Callable[[], object]


def ticks(body: str) -> tuple[Tick, Tick]:
    """A tick of a tree with this many nodes, here and there."""
    text = FILE.format(body * COPIES)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tree.xml"
        path.write_text(text)
        tree = load_tree(path, Registry())
    tree.setup(None, ManualClock())
    factory = behaviortreepy.BehaviorTreeFactory()
    factory.register_behavior_tree_from_text(text)
    return tree.tick, factory.create_tree("Main").tick_exactly_once


def spent_us(tick: Tick) -> float:
    """Processor time of a tick [us]."""
    count, began_s = 0, time.process_time()
    while (spent_s := time.process_time() - began_s) < ROUND_S:
        tick()
        count += 1
    return 1e6 * spent_s / count


def main() -> None:
    """Print microseconds of a node here and there, and their ratio, by kind."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    pairs = {kind: ticks(body) for kind, body in KINDS.items()} | {"": ticks("")}
    rounds = [{kind: tuple(map(spent_us, pair)) for kind, pair in pairs.items()} for _ in range(ROUNDS)]
    medians = {kind: [statistics.median(one[kind][side] for one in rounds) for side in (0, 1)] for kind in pairs}
    table = {}
    for kind in KINDS:
        here, there = ((medians[kind][side] - medians[""][side]) / COPIES for side in (0, 1))
        table[kind] = {"here_us": round(here, 3), "there_us": round(there, 3), "ratio": round(here / there, 1)}
    print(json.dumps({"rounds": ROUNDS, "copies": COPIES, "nodes": table}, indent=2))


if __name__ == "__main__":
    main()
