"""Several hands at one bench: who acts where, what the cameras tell of each, and what they see of the bench."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration
from bracket_cell.learned.classical.bench_evidence import _towards
from bracket_cell.skills.motion.known_bench import KnownBench
from bracket_cell.skills.motion.person_space import PersonSpace
from bracket_ground.interfaces.perception import Action, BenchView, HandSample
from bracket_ground.interfaces.pose import Array
from bracket_sim.scene.person import load_person
from bracket_sim.worker.hands import Hands
from tests.integration.cell_rig import CAN, PRODUCT
from tests.sim.worker_bench import bench, product

HOLES_M: dict[str, Array] = {name: np.array([*at, 0.0]) for name, at in product().bracket.holes_m.items()}


def test_two_hands_keep_to_holes_with_room_between_and_to_bins_of_their_own() -> None:
    hands = Hands()
    hands.takes(0, "p1", "o1")
    assert [at for at in HOLES_M if hands.free(1, at, "o2", HOLES_M)] == ["p3", "p4", "p5", "p6"]
    assert not hands.free(1, "p6", "o1", HOLES_M)
    assert hands.free(0, "p1", "o1", HOLES_M)
    hands.leaves(0)
    assert hands.free(1, "p1", "o1", HOLES_M)


def sample(tips_m: tuple[float, float], palm_m: tuple[float, float]) -> HandSample:
    return HandSample(1.0, (200, 100, 240, 140), tips_m, palm_m, height_m=0.1, fingertips_height_m=0.05)


@pytest.mark.parametrize(("people", "seen", "more"), [(1, 1, True), (1, 2, False), (2, 2, True), (2, 4, False)])
def test_as_long_as_hands_are_out_of_the_view_they_may_come_over_the_persons_edge(
    people: int, seen: int, more: bool
) -> None:
    configuration = load_configuration()
    settings = configuration.motion.separation.model_copy(update={"people": people, "open_edges": ()})
    space = PersonSpace(configuration.bench, settings)
    hands = [sample((0.8, 0.1 * number), (0.9, 0.1 * number)) for number in range(seen)]
    view = BenchView(1, 1.0, hands[0], {}, Action("idle", 1.0), "", other_hands=tuple(hands[1:]))
    found = space.of(KnownBench(space.view_range, view, 1.0))
    assert sum(person.body is space.beyond[space.edge] for person in found) == more
    alone = [space.of(KnownBench(space.view_range, replace(view, hand=hand, other_hands=()), 1.0)) for hand in hands]
    assert len(found) - more == sum(len(bodies) - 1 for bodies in alone)  # each with its elbow and head


def test_an_arm_from_the_side_hides_nothing_on_the_persons_side() -> None:
    """Else landmarks are hidden for as long as somebody stands there, and the bench is not seen."""
    hand, shape = sample((0.7, 0.4), (0.7, 0.5)), (90, 120)
    aside, below = _towards("right", hand, shape), _towards("bottom", hand, shape)
    assert aside[30, -1]
    assert not aside[-1, 55]
    assert below[-1, 55]


@pytest.mark.slow
def test_both_hands_of_a_person_fill_holes_and_each_is_seen_by_itself() -> None:
    from bracket_sim.cell import SimCell
    from bracket_sim.scene.settings import SimSettings

    settings = SimSettings(person=load_person("both_hands"))
    cell = SimCell(PRODUCT, bench(), settings, *CAN, 5, "g0", rendered=False)
    try:
        assert cell.worker is not None
        assert cell.sight is not None
        while cell.devices.clock.now_s() < 12.0:
            cell.devices.clock.sleep_until(cell.devices.clock.now_s() + 0.1)
        frame = cell.devices.overhead.latest()
        assert frame is not None
        first, (second,) = cell.sight.track(frame), cell.sight.others
        assert first is not None
        assert np.allclose(first.palm_m, cell.worker.hand.palm_m[:2], atol=0.05)
        assert np.allclose(second.palm_m, cell.other_hands[0].hand.palm_m[:2], atol=0.05)
        placed = [
            act.fields["position"]
            for hand in (cell.worker, *cell.other_hands)
            for act in hand.acts
            if act.fields["act"] == "release"
        ]
        assert len(placed) == len(set(placed)) >= 2
        assert cell.report()["human_placements"] == len(placed)
    finally:
        cell.close()
