"""Both algorithm trees against the simulated cell, from camera pixels to friction grasps."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence

import numpy as np
import pytest

from bracket_cell.skills.motion.grasp_pose import hole_pose
from bracket_cell.trees.nodes.people import WaitForHandClearOfPart
from bracket_ground.interfaces.pose import Pose
from bracket_sim.cell import SimCell
from bracket_sim.scene.clutter import standing
from bracket_sim.scene.parts import ScenePart
from btxml.engine.status import Status
from tests import ROOT
from tests.integration.cell_rig import (
    ASSEMBLE,
    BENCH,
    COMMISSION,
    PRODUCT,
    lifted,
    robot_alone,
    run_tree,
    with_person,
)
from tests.processes import SLOW_MACHINE_S, started


def standing_in_tray(spots: Sequence[tuple[str, tuple[float, float], float]]) -> list[ScenePart]:
    """Parts by type, (x, y) and yaw."""
    return [standing(PRODUCT, BENCH.tray, name, xy_m, yaw_rad) for name, xy_m, yaw_rad in spots]


WHOLE = [pytest.param(goal, seed, 0, marks=pytest.mark.slow) for goal, seed in (("g1", 2), ("g2", 3))]


def fill(cell: SimCell, goal: str, count: int) -> None:
    """So many holes hold already what the goal wants there, from the person's bins."""
    bodies = [body for body in cell.world.bodies if body.owner == "person"]
    for position, part in list(PRODUCT.goal_placements(goal).items())[:count]:
        body = next(body for body in bodies if body.part == part)
        bodies.remove(body)
        cell.world.place(body, hole_pose(PRODUCT, BENCH, position))


@pytest.mark.long
@pytest.mark.parametrize(("goal", "seed", "filled"), [("g1", 2, 3), *WHOLE])
def test_a_bracket_is_assembled_together(goal: str, seed: int, filled: int) -> None:
    with with_person(goal, seed) as cell:
        fill(cell, goal, filled)
        outcome, recorded = run_tree(cell, ASSEMBLE)
        report = cell.report()
    assert outcome.end == "finished", outcome.reason
    assert report["correct"]
    assert report["contacts"] == 0
    assert report["wrong_placements"] == 0
    assert isinstance(report["robot_placements"], int)
    assert report["robot_placements"] >= 1
    assert [fields["goal"] for _, topic, fields in recorded.notes if topic == "belief" and "goal" in fields][-1] == goal
    refused = [fields["subject"] for _, _, fields in recorded.notes if fields.get("decision") == "refused"]
    assert "assembly plan" not in refused


@pytest.mark.slow
def test_the_same_seed_decides_the_same_in_two_processes() -> None:
    """To the end of an assembly; the begin of one is compared in tests/sim/process/test_same_run.py."""
    command = [sys.executable, "-m", "tests.integration.digest", "g0", "1"]
    with started(command, ROOT, {"PYTHONHASHSEED": "1"}) as one, started(command, ROOT, {"PYTHONHASHSEED": "2"}) as two:
        first, second = (json.loads(run.communicate(timeout=SLOW_MACHINE_S)[0]) for run in (one, two))
    assert first == second
    assert first["correct"]
    assert first["ticks"] > 500


@pytest.mark.long
def test_a_blocked_part_is_fetched_out_of_clutter() -> None:
    spots = [("o2", (0.55, -0.40), 0.0), ("o3", (0.55, -0.356), 0.0), ("o3", (0.61, -0.43), math.pi / 2)]
    with robot_alone(standing_in_tray(spots), seed=1) as cell:
        outcome, recorded = run_tree(cell, COMMISSION, "FetchPart", {"part": "o2"})
        held = lifted(cell, "o2")
    assert outcome.end == "finished", outcome.reason
    assert held
    assert "o3 moved aside" in recorded.reasons()
    solutions = [str(fields["solution"]) for _, _, fields in recorded.notes if "solution" in fields]
    assert any(solution.startswith("move") for solution in solutions)


@pytest.mark.long
@pytest.mark.parametrize(
    ("part", "width_m", "position"), [("o1", 0.028, "p2"), pytest.param("o2", 0.034, "p6", marks=pytest.mark.slow)]
)
def test_of_two_parts_side_by_side_one_is_fetched_and_placed(part: str, width_m: float, position: str) -> None:
    spots = [(part, (0.55, -0.40), 0.0), (part, (0.55, -0.40 + width_m + 0.006), 0.0)]
    with robot_alone(standing_in_tray(spots), seed=1) as cell:
        outcome, recorded = run_tree(cell, COMMISSION, "PickAndPlaceOne", {"part": part, "position": position})
        placement = cell.score.placements().get(position)
    assert outcome.end == "finished", outcome.reason
    assert placement is not None
    assert (placement.part, placement.seated) == (part, True)
    assert not any("aside" in reason for reason in recorded.reasons())


def lying_beside(*offsets_m: tuple[float, float]) -> list[ScenePart]:
    """A gate valve that stands, and globe valves on their sides around it."""
    height_m = BENCH.tray.centre_m[2] + PRODUCT.parts["o2"].size_m[1] / 2
    on_its_side = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
    lying = [ScenePart("o2", Pose((0.55 + x, -0.40 + y, height_m), on_its_side)) for x, y in offsets_m]
    return [*standing_in_tray([("o1", (0.55, -0.40), 0.0)]), *lying]


def test_a_part_lying_where_the_fingers_go_is_avoided() -> None:
    with robot_alone(lying_beside((0.0, 0.05)), seed=1) as cell:
        outcome, recorded = run_tree(cell, COMMISSION, "FetchPart", {"part": "o1"})
        held = lifted(cell, "o1")
    assert outcome.end == "finished", outcome.reason
    assert held
    assert not any("met something" in reason for reason in recorded.reasons())


@pytest.mark.long
def test_where_parts_lie_on_all_sides_one_of_them_is_set_upright_first() -> None:
    with robot_alone(lying_beside((0.0, 0.05), (0.0, -0.075), (0.065, 0.0), (-0.065, 0.0)), seed=1) as cell:
        outcome, recorded = run_tree(cell, COMMISSION, "FetchPart", {"part": "o1"})
        held = lifted(cell, "o1")
    assert outcome.end == "finished", outcome.reason
    assert held
    reasons = recorded.reasons()
    assert reasons.index("o2 was let go upright") < reasons.index("grasping o1")
    assert not any("met something" in reason for reason in reasons)


def test_a_hand_near_the_part_stops_the_arm_which_goes_on_afterwards(monkeypatch: pytest.MonkeyPatch) -> None:
    """The hand is there for a second while the fingers go down; the cell here has no person, so it is told."""
    near_s, tell = (3.0, 4.0), WaitForHandClearOfPart.update

    def update(node: WaitForHandClearOfPart) -> Status:
        near = near_s[0] <= node.services.now.observation.time_s < near_s[1]
        return Status.RUNNING if near else tell(node)

    monkeypatch.setattr(WaitForHandClearOfPart, "update", update)
    with robot_alone(standing_in_tray([("o2", (0.55, -0.40), 0.4)]), seed=1) as cell:
        outcome, recorded = run_tree(cell, COMMISSION, "FetchPart", {"part": "o2"})
        held = lifted(cell, "o2")
    assert outcome.end == "finished", outcome.reason
    assert held
    assert "halted" in recorded.reasons()
    ticks = np.array(recorded.joints)[round((near_s[0] + 0.6) * 25) : round(near_s[1] * 25)]
    assert np.ptp(ticks, axis=0).max() < 1e-3, "the arm stands while the hand is near"
