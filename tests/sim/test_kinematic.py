"""The person without physics: the same assemblies, the same bits for the same seed."""

from __future__ import annotations

import numpy as np
import pytest

from bracket_ground.interfaces.devices import TruthEvent
from bracket_lab.drawing.without_physics import KinematicBench, Recording
from bracket_sim.scene.person import PERSONS, Lapses, Person, Storage
from bracket_sim.truth.labels import guarded, labels
from bracket_sim.worker.event_log import ActionEvent
from tests.sim.worker_bench import bench, product


@pytest.fixture(scope="module")
def varied() -> KinematicBench:
    return KinematicBench(product(), bench(), PERSONS["varied"])


def standing(world: KinematicBench) -> dict[str, str]:
    """Type of the part in each hole."""
    found = {}
    for position, (x, y) in product().bracket.holes_m.items():
        hole = bench().bracket.pose.transform(np.array([x, y, 0.0]))
        for part in world.world.bodies:
            pose = world.world.part_pose(part)
            if np.linalg.norm(np.array(pose.position_m) - hole) < 0.005 and pose.rotation[2, 2] > 0.999:
                found[position] = part.part
    return found


def equal(first: Recording, second: Recording) -> bool:
    return np.array_equal(first.fingertips_m, second.fingertips_m) and first.acts == second.acts


@pytest.mark.long
@pytest.mark.parametrize("seed", range(9))
def test_every_goal_is_assembled(varied: KinematicBench, seed: int) -> None:
    goal = sorted(product().goals)[seed % 3]
    varied.record(goal, seed)
    assert standing(varied) == product().goal_placements(goal)


def test_the_same_seed_gives_the_same_bits_whatever_came_before(varied: KinematicBench) -> None:
    first = varied.record("g0", 5)
    other = varied.record("g0", 6)
    assert equal(first, varied.record("g0", 5))
    assert equal(first, KinematicBench(product(), bench(), PERSONS["varied"]).record("g0", 5))
    assert not equal(first, other)


def test_samples_come_at_the_rate_and_the_hand_keeps_to_a_human_pace(varied: KinematicBench) -> None:
    recording = varied.record("g2", 3)
    steps_s = np.diff(recording.times_s)
    assert np.allclose(steps_s, 1 / 15)
    speeds_m_s = np.linalg.norm(np.diff(recording.fingertips_m, axis=0), axis=1) / steps_s
    assert 0.4 < speeds_m_s.max() < 2.0


def test_frames_are_asked_for_while_the_world_is_as_it_was(varied: KinematicBench) -> None:
    seen: list[tuple[float, float]] = []
    body = varied.world.model.body("hand").id
    recording = varied.record("g0", 2, frame=lambda at_s: seen.append((at_s, float(varied.world.data.xpos[body][0]))))
    assert [at_s for at_s, _ in seen] == list(recording.times_s)
    assert np.allclose([x for _, x in seen], recording.fingertips_m[:, 0])


def test_labels_follow_the_rule() -> None:
    person = Person(lapses=Lapses(takes_away=0.6, hesitates=0.3, holds=0.3))
    recording = KinematicBench(product(), bench(), person).record("g1", 4)
    found = labels(recording.actions, recording.acts, recording.times_s)
    releases = [act for act in recording.acts if act.fields["act"] == "release"]
    assert any(act.fields["position"] is None for act in releases)
    for at_s, label in zip(recording.times_s, found, strict=True):
        near = [act for act in releases if act.time_s - 0.5 <= at_s <= act.time_s + 0.4 and act.fields["position"]]
        assert (label.kind == "assembly") == bool(near)
        if near:
            assert (label.part, label.position) == (near[-1].fields["part"], near[-1].fields["position"])
    kinds = [label.kind for label in found]
    assert set(kinds) == {"assembly", "screw", "transit", "idle"}


def test_a_hand_that_reaches_into_the_arm_s_way_is_in_transit_until_it_is_back() -> None:
    """Whatever it did before and does after, so that two such reaches are called the same."""
    idle = [ActionEvent(0.0, "idle", "start")]

    def kinds(*acts: tuple[float, str]) -> list[str]:
        told = [TruthEvent(time_s, "act", {"act": act}) for time_s, act in acts]
        return [label.kind for label in labels(idle, told, np.linspace(0.0, 5.0, 6))]

    there = ["transit"] * 3
    assert kinds((1.0, "intrude"), (2.0, "freeze"), (3.0, "back")) == ["idle", *there, "idle", "idle"]
    assert kinds((3.0, "intrude"), (4.0, "pull")) == ["idle", "idle", "idle", *there]
    assert kinds((3.0, "hold")) == ["idle"] * 6


def test_the_guard_band_lies_about_changes(varied: KinematicBench) -> None:
    recording = varied.record("g1", 4)
    found = labels(recording.actions, recording.acts, recording.times_s)
    near = guarded(found, recording.times_s)
    changes = [index for index in range(1, len(found)) if found[index] != found[index - 1]]
    assert all(near[index] and near[index - 1] for index in changes)
    far = [index for index in range(5, len(found) - 5) if len(set(found[index - 4 : index + 5])) == 1]
    assert not any(near[index] for index in far)


def test_what_the_robot_holds_out_is_taken_and_assembled() -> None:
    person = Person(storage=Storage(handed_over=1.0))
    table = KinematicBench(product(), bench(), person)
    recording = table.record("g0", 4)
    assert standing(table) == product().goal_placements("g0")
    handed = [act for act in recording.acts if act.fields["act"] == "handed over"]
    assert len(handed) == 6
    assert len([act for act in recording.acts if act.fields["act"] == "release"]) == 6


def test_nothing_is_handed_over_where_nobody_asks_for_it() -> None:
    table = KinematicBench(product(), bench(), Person())
    recording = table.record("g0", 4)
    assert not any(act.fields["act"] == "handed over" for act in recording.acts)
