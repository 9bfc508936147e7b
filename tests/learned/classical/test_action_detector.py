"""Actions are named from tracks of the hand and from holes that change; robot's placements are not the hand's."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from bracket_cell.learned.classical.action_detector import ClassicalActionDetector, turning_points
from bracket_cell.learned.classical.settings import PerceptionSettings
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import SEGMENT_FRAMES, Action, HandSample, HoleView, Segment
from bracket_ground.interfaces.pose import Pose
from tests.learned.classical.scenes import BENCH, PRODUCT, hole_m

RATE_HZ = 15.0
IMAGE = np.zeros((4, 4, 3), np.uint8)
REST = (1.0, 0.44)
HOLE = (float(hole_m("p2")[0]), float(hole_m("p2")[1]))

Track = Callable[[float], tuple[tuple[float, float] | None, str | None]]


def still(place: tuple[float, float] | None, held: str | None = None) -> Track:
    return lambda _: (place, held)


def screwing(hz: float, radius_m: float) -> Track:
    def track(time_s: float) -> tuple[tuple[float, float], None]:
        phase = 2 * math.pi * hz * time_s
        return (HOLE[0] + radius_m * math.cos(phase), HOLE[1] + radius_m * math.sin(phase)), None

    return track


class Film:
    """Plays tracks and holes to a detector, frame by frame."""

    def __init__(self) -> None:
        self._detector = ClassicalActionDetector(BENCH, PRODUCT, PerceptionSettings())
        self._frames: list[Frame] = []
        self._hands: list[HandSample | None] = []
        self.holes = {name: HoleView(None, 1.0, 0.0) for name in PRODUCT.positions}

    def play(self, track: Track, duration_s: float, covered: tuple[str, ...] = ()) -> list[Action]:
        actions = []
        for _ in range(round(duration_s * RATE_HZ)):
            time_s = len(self._frames) / RATE_HZ
            place, held = track(time_s)
            self._frames.append(Frame("overhead", len(self._frames), time_s, IMAGE, Pose((0, 0, 1))))
            self._hands.append(None if place is None else sample(time_s, place, held))
            self.holes = {
                name: view if name in covered else HoleView(view.part, 1.0, time_s, view.upright)
                for name, view in self.holes.items()
            }
            segment = Segment(tuple(self._frames[-SEGMENT_FRAMES:]), tuple(self._hands[-SEGMENT_FRAMES:]))
            actions.append(self._detector.detect(segment, self.holes))
        return actions

    def put(self, part: str, position: str, upright: bool = True) -> None:
        self.holes[position] = HoleView(part, 1.0, len(self._frames) / RATE_HZ, upright)


def sample(time_s: float, place: tuple[float, float], held: str | None) -> HandSample:
    return HandSample(time_s, (0, 0, 2, 2), place, (place[0] + 0.12, place[1]), held)


def finished(actions: list[Action]) -> list[str]:
    names = [str(action) for action in actions if action.finished]
    return list(dict.fromkeys(names))


def test_a_part_brought_by_the_hand_is_an_assembly() -> None:
    film = Film()
    film.play(still(REST), 1.0)
    before = film.play(still(HOLE, "o2"), 1.0, covered=("p2",))
    film.put("o2", "p2")
    after = film.play(still((0.9, 0.3)), 2.5)
    assert finished(before) == []
    assert (before[-1].kind, str(before[-1])) == ("assembly", "o2 at p2")
    assert finished(after) == ["o2 at p2"]
    assert sum(action.finished for action in after) >= 5
    assert not after[-1].finished


def test_two_assemblies_seen_at_once_are_reported_one_after_the_other() -> None:
    film = Film()
    other = (float(hole_m("p5")[0]), float(hole_m("p5")[1]))
    film.play(still(REST), 0.5)
    film.play(still(HOLE, "o2"), 0.5, covered=("p2", "p5"))
    film.play(still(other, "o1"), 0.5, covered=("p2", "p5"))
    film.put("o2", "p2")
    film.put("o1", "p5")
    assert finished(film.play(still(REST), 4.0)) == ["o2 at p2", "o1 at p5"]


@pytest.mark.parametrize("hand", [None, REST, (0.75, 0.02)])
def test_a_part_that_comes_without_the_hand_is_not_an_assembly(hand: tuple[float, float] | None) -> None:
    film = Film()
    film.play(still(hand), 1.0)
    film.put("o2", "p2")
    assert finished(film.play(still(hand), 2.0)) == []


def test_a_crooked_part_is_finished_once_it_stands_straight() -> None:
    film = Film()
    film.play(still(HOLE, "o2"), 1.0, covered=("p2",))
    film.put("o2", "p2", upright=False)
    assert finished(film.play(still(REST), 2.0)) == []
    film.play(still(HOLE), 0.5, covered=("p2",))
    film.put("o2", "p2")
    assert finished(film.play(still(REST), 2.0)) == ["o2 at p2"]


@pytest.mark.parametrize("hz", [1.2, 1.75, 2.2])
def test_circling_fingers_over_a_part_screw(hz: float) -> None:
    film = Film()
    film.put("o2", "p2")
    actions = film.play(screwing(hz, 0.008), 3.0, covered=("p2",))
    first = next(index for index, action in enumerate(actions) if action.kind == "screw")
    assert first / RATE_HZ < 1.2
    assert all(action.kind == "screw" for action in actions[first:])
    assert film.play(still(REST), 1.0)[-1].kind != "screw"


def test_neither_trembling_nor_an_empty_hole_is_a_screw() -> None:
    film = Film()
    assert all(action.kind != "screw" for action in film.play(screwing(1.75, 0.008), 3.0, covered=("p2",)))
    film.put("o2", "p2")
    film.play(still(REST), 1.5)
    assert all(action.kind != "screw" for action in film.play(screwing(2.0, 0.0025), 3.0, covered=("p2",)))


@pytest.mark.parametrize("place", [None, REST])
def test_a_resting_or_absent_hand_is_idle(place: tuple[float, float] | None) -> None:
    assert Film().play(still(place), 1.0)[-1].kind == "idle"


def test_a_hand_that_rests_over_a_bin_is_idle_but_not_while_it_takes_a_part() -> None:
    film = Film()
    film.play(still((0.9, 0.3)), 1.0)
    actions = film.play(still(REST, "o1"), 4.0)
    assert {action.kind for action in actions[: round(0.9 * RATE_HZ)]} == {"transit"}
    assert {action.kind for action in actions[round(1.6 * RATE_HZ) :]} == {"idle"}
    carried = film.play(lambda time_s: ((1.5 - 0.1 * time_s, 0.44), "o1"), 2.0)
    assert {action.kind for action in carried[round(RATE_HZ) :]} == {"transit"}


@pytest.mark.parametrize(("y_m", "kind"), [(0.53, "idle"), (0.25, "transit")])
def test_a_hand_that_lies_still_beside_its_resting_place_is_idle(y_m: float, kind: str) -> None:
    actions = Film().play(still((1.0, y_m)), 3.0)
    assert actions[round(0.6 * RATE_HZ)].kind == "transit"
    assert actions[-1].kind == kind


def test_a_moving_hand_is_in_transit() -> None:
    actions = Film().play(lambda time_s: ((1.0 - 0.2 * time_s, 0.5), None), 1.0)
    assert {action.kind for action in actions} == {"transit"}


def test_turning_points_need_a_swing() -> None:
    wave = np.sin(np.linspace(0.0, 4 * np.pi, 60))
    assert turning_points(wave, 0.5) == 4
    assert turning_points(wave, 2.5) == 0
    assert turning_points(np.linspace(0.0, 9.0, 30), 0.5) == 0
