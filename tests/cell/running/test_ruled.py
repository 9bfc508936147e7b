"""Rules in a run: what is broken is judged, with the commands of the same tick, by its row of the table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from bracket_cell.running.fault_checks import CHECKS
from bracket_cell.running.supervisor import OF_COMMANDS, Supervisor, make_supervisor
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.rules import Rule
from bracket_cell.wiring.ruled import RuledTree
from bracket_ground.interfaces.clock import ManualClock
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.faults import Action, SafetyDecision, shipped_table
from btxml.files.compile.registry import Registry
from tests.cell.fakes import FakeServices, Rig
from tests.integration.cell_rig import motion_planner

TREE = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
  <Script code="n := 0"/><AsyncSequence><AlwaysSuccess/><Script code="n := 1"/></AsyncSequence>
</Sequence></BehaviorTree></root>"""


def judged(path: Path, action: str, ticks: int) -> list[SafetyDecision]:
    """What the supervisor says of each tick, where `n` must never be 1."""
    path.write_text(TREE)
    rule = Rule(name="n stays 0", never="n == 1", action=action)  # type: ignore[arg-type]
    ruled = RuledTree(load_tree(path, Registry()), [rule], Kinematics())
    services = FakeServices(Rig().services.now)
    ruled.setup(services, ManualClock())  # type: ignore[arg-type]
    supervisor = Supervisor([row for row in shipped_table().faults if row.signal in OF_COMMANDS], CHECKS)
    found = []
    for _ in range(ticks):
        services.now.command = Command()
        supervisor.judge(services.now.observation)
        ruled.tick()
        found.append(supervisor.judge_command(services.now.observation, services.now.command))
    return found


@pytest.mark.parametrize("action", ["warn", "hold", "stop"])
def test_a_broken_rule_does_what_its_row_says_in_the_tick_that_breaks_it(action: str, tmp_path: Path) -> None:
    first, second = judged(tmp_path / "tree.xml", action, 2)
    assert first.action is Action.RUN
    assert second.action is Action[action.upper()]
    assert second.reasons == ((f"rule_{action}s", "rule 'n stays 0' is broken: n = 1"),)


@pytest.mark.parametrize(("action", "held"), [("warn", []), ("hold", [2, 3]), ("stop", [2, 3])])
def test_a_rule_that_matters_and_is_unknown_holds_after_its_time(action: str, held: list[int], tmp_path: Path) -> None:
    (tmp_path / "tree.xml").write_text(TREE)
    rule = Rule(name="m", never="nothing == 1", action=action, unknown_after_s=0.08)  # type: ignore[arg-type]
    ruled = RuledTree(load_tree(tmp_path / "tree.xml", Registry()), [rule], Kinematics())
    services = FakeServices(Rig().services.now)
    ruled.setup(services, ManualClock())  # type: ignore[arg-type]
    found = []
    for number in range(4):
        services.now.command = Command()
        services.now.observation = replace(services.now.observation, time_s=0.04 * number)
        ruled.tick()
        told = services.now.command.broken
        assert not told or told == (("hold", "rule 'm' is unknown for 0.08 s or more: nothing = unknown"),)
        found += [number] if told else []
    assert found == held


def test_the_supervisor_of_a_cell_knows_rules() -> None:
    told = Command(broken=(("stop", "a rule is broken"),))
    supervisor = make_supervisor(shipped_table(), motion_planner())
    seen = Rig().services.now.observation
    assert supervisor.judge_command(seen, told).action is Action.STOP
