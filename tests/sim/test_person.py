"""Persons: their settings, where they keep parts, and their lapses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bracket_ground.errors import InputError
from bracket_ground.interfaces.pose import Array, Pose
from bracket_sim.scene.clutter import gap, rectangle
from bracket_sim.scene.jobs import Job
from bracket_sim.scene.person import PERSONS, Lapses, Person, ScrewHabits, Storage, load_person
from bracket_sim.scene.storage import COMMON_BIN_M, begun, lay_out, person_set
from bracket_sim.scene.world import build_world
from bracket_sim.truth.score import Score
from bracket_sim.worker.hand_primitives import Script
from tests.sim.worker_bench import Shift, bench, product, world_of

MIXED = Storage(bins="permuted", mixed=1.0)
BRISK = ScrewHabits(probability=0.0, unscrewed_limit=9)


def test_a_careful_person_takes_nothing_from_the_generator() -> None:
    rng = np.random.default_rng(3)
    layout = lay_out(product(), bench(), PERSONS["careful"].storage, rng)
    assert layout.parts == person_set(product(), bench())
    assert rng.random() == np.random.default_rng(3).random()


@pytest.mark.parametrize("seed", range(20))
def test_permuted_bins_hold_the_whole_set_apart_from_each_other(seed: int) -> None:
    layout = lay_out(product(), bench(), MIXED, np.random.default_rng(seed))
    assert sorted(part.part for part in layout.parts) == sorted(part.part for part in person_set(product(), bench()))
    bodies: list[Array] = []
    for part in layout.parts:
        pose = part.world_from_part
        body = rectangle(product().parts[part.part].size_m, np.array(pose.position_m[:2]), pose.yaw_rad)
        off = min(float(np.abs(body - np.array(bin_.centre_m[:2])).max()) for bin_ in layout.bins)
        assert off <= max(COMMON_BIN_M) / 2 + 0.02
        assert all(gap(body, other) > 0.02 for other in bodies)
        bodies.append(body)


def test_bins_are_permuted_by_the_generator_alone() -> None:
    first, again, other = (lay_out(product(), bench(), MIXED, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first == again
    assert first != other


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_an_ordinary_person_assembles(seed: int) -> None:
    person = PERSONS["ordinary"]
    shift = Shift("g1", seed, person, world_of(person, seed))
    assert shift.until(lambda: shift.worker.done, 200.0)
    assert shift.placed() == product().goal_placements("g1")


@pytest.mark.parametrize("seed", range(5))
def test_a_begun_bracket_has_right_parts_of_the_set_in_some_holes(seed: int) -> None:
    wanted, holds = product().goal_placements("g1"), Storage(begun=2)
    parts = begun(product(), bench(), person_set(product(), bench()), wanted, holds, np.random.default_rng(seed))
    assert sorted(part.part for part in parts) == sorted(part.part for part in person_set(product(), bench()))
    world = build_world(product(), bench(), parts)
    world.settle()
    placed = Score(world, Job("g1", wanted)).placements()
    assert len(placed) == 2
    assert all(one.seated and one.part == wanted[at] and one.by is None for at, one in placed.items())


def lapsing(lapses: Lapses, seed: int = 0) -> Shift:
    person = Person(lapses=lapses, screw=BRISK)
    return Shift("g0", seed, person, world_of(person, seed))


def play(shift: Shift, script: Script) -> None:
    """Let the hand do this and nothing else."""
    for _ in script:
        shift.worker._work.send()
        shift.world.step_period()


@pytest.mark.parametrize(
    ("lapses", "act"),
    [
        (Lapses(regrips=1.0), "regrip"),
        (Lapses(holds=1.0), "hold"),
        (Lapses(hesitates=1.0), "hesitate"),
    ],
)
def test_lapses_are_told_and_the_part_comes_home_all_the_same(lapses: Lapses, act: str) -> None:
    shift = lapsing(lapses)
    assert shift.until(lambda: len(shift.placed()) == 1, 30.0)
    assert [event.fields["act"] for event in shift.worker.acts].count(act) >= 1


def test_a_wrong_part_is_placed_and_taken_away_again() -> None:
    shift = lapsing(Lapses(wrong_part=1.0))
    assert shift.until(lambda: len(shift.placed()) == 1, 30.0)
    [(position, part)] = shift.placed().items()
    assert part != product().goal_placements("g0")[position]
    assert shift.until(lambda: not shift.placed(), 30.0)
    acts = [event.fields["act"] for event in shift.worker.acts]
    assert acts.index("wrong part") < acts.index("release") < acts.index("take away")


@pytest.mark.slow
def test_no_wrong_part_stays_even_where_the_person_gives_up() -> None:
    shift = lapsing(Lapses(wrong_part=1.0))
    assert shift.until(lambda: shift.worker.done, 600.0)
    assert shift.placed() == {}


def test_a_wrong_part_that_is_overlooked_stays_until_somebody_tells() -> None:
    shift = lapsing(Lapses(wrong_part=1.0, overlooks=1.0))
    assert shift.until(lambda: len(shift.placed()) == 1, 30.0)
    [(position, part)] = shift.placed().items()
    shift.until(lambda: False, 8.0)
    assert shift.placed()[position] == part
    play(shift, shift.worker._job.placing.mend(position))
    assert position not in shift.placed()


def test_a_part_of_the_robot_is_taken_out_and_put_before_the_bracket() -> None:
    shift = lapsing(Lapses())
    body = shift.world.bodies[0]
    x, y = product().bracket.holes_m["p3"]
    shift.world.place(body, bench().bracket.pose @ Pose((x, y, 0.0)))
    shift.world.settle()
    shift.period()
    play(shift, shift.worker._job.placing.take_away("p3"))
    assert "p3" not in shift.placed()


def test_a_part_that_sits_is_taken_away_again() -> None:
    shift = lapsing(Lapses(takes_away=1.0))
    assert shift.until(lambda: len(shift.placed()) == 1, 30.0)
    assert shift.until(lambda: not shift.placed(), 30.0)


@pytest.mark.parametrize(
    "text", ["pace: [2, 1]", "pace: [-1, 1]", "robot: {waits: 1.5}", "pace: [.nan, 1]", "hat: red"]
)
def test_a_bad_person_is_refused_with_its_line(tmp_path: Path, text: str) -> None:
    file = tmp_path / "person.yaml"
    file.write_text(f"# somebody\n{text}\n")
    with pytest.raises(InputError, match=r"person\.yaml:2"):
        load_person(str(file))


@pytest.mark.parametrize("name", ["nobody", ""])
def test_an_unknown_person_is_refused_with_the_known_ones(name: str) -> None:
    with pytest.raises(InputError, match="careful, careful_brisk, absent, ordinary, ordinary_brisk, varied, careless"):
        load_person(name)
