"""Faults in what detectors answer: what they change, and whether the answers themselves show it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from bracket_cell.running.inference import Executor
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import Action, BenchView, HandSample, HoleView, PartDetection, PartsView
from bracket_ground.interfaces.pose import Pose
from bracket_lab.evaluations.answer_evidence import AnswerEvidence
from bracket_sim.faults.injection import Injection, Injections
from bracket_sim.faults.signal_faults import DETECTED, SignalFault
from tests.cell.running.test_supervisor import sound

PERIOD_S = 1 / 15


class Detector(Executor[Frame, BenchView]):
    """A sound one: a hand goes along the bench, holes stay as they are."""

    def __init__(self) -> None:
        self.number = 0

    def submit(self, _: Frame) -> bool:
        return True

    def poll(self) -> BenchView:
        self.number += 1
        time_s, palm_m = self.number * PERIOD_S, (0.6 - 0.01 * self.number, 0.1)
        hand = HandSample(
            time_s, (100, 100, 160, 160), (palm_m[0] - 0.1, 0.1), palm_m, None, (-0.15, 0.0), (0.0, 0.0), 0.05, 0.02
        )
        holes = {"p1": HoleView("o1", 1.0, time_s), "p2": HoleView(None, 0.9, time_s)}
        return BenchView(self.number, time_s, hand, holes, Action("idle", 1.0))

    def close(self) -> None:
        """Nothing to end."""


class Finder(Detector):
    """Two parts in the tray."""

    def poll(self) -> PartsView:  # type: ignore[override]
        self.number += 1
        parts = [
            PartDetection(name, 1.0, Pose((x_m, 0.4, 0.02)), (0.04, 0.04, 0.03), (9, 9, 20, 20))
            for name, x_m in (("o1", 0.3), ("o2", 0.4))
        ]
        return PartsView(self.number, self.number * PERIOD_S, tuple(parts))


def answers(fault: str, before: int = 4, after: int = 12) -> list[BenchView | None]:
    """What comes from the detector: sound answers, then some with the fault."""
    injection, source = Injection(fault, "carry"), Finder() if fault.startswith("part") else Detector()
    injection.now_s = lambda: source.number * PERIOD_S
    pair: tuple[Executor[Frame, BenchView], Executor[Frame, PartsView]] = (source, source)  # type: ignore[assignment]
    proxy = injection.detectors(*pair)[int(fault.startswith("part"))]
    told = [proxy.poll() for _ in range(before)]
    injection.begin(fault, injection.now_s())
    return told + [proxy.poll() for _ in range(after)]  # type: ignore[return-value]


def shows(views: Sequence[BenchView | PartsView | None]) -> list[int]:
    """Numbers of the answers that show that something is wrong."""
    evidence, found, last = AnswerEvidence(), [], None
    for number, view in enumerate(views):
        last = view if view is not None else last
        bench, parts = (last, None) if isinstance(last, BenchView) else (None, last)
        at = replace(sound(0), time_s=(number + 1) * PERIOD_S + 0.05, bench=bench, parts=parts)
        if next(evidence.found(at), ""):
            found.append(number)
    return found


@pytest.mark.parametrize("fault", ["bench.hand:lost", "part.position_m:nan"])
def test_sound_answers_show_nothing(fault: str) -> None:
    assert shows(answers(fault)[:4]) == []


@pytest.mark.parametrize(
    "fault",
    [
        "bench.hand:lost",
        "bench.hand:stuck",
        "bench.view:stuck",
        "bench.holes:lost",
        "bench.time_s:stuck",
        "bench.time_s:nan",
        "hand.palm_m:nan",
        "hand.palm_m:infinite",
        "hand.fingertips_m:foreign:1e9",
        "hand.palm_m:jumps:3",
        "hand.palm_m:flipped",
        "hand.palm_m:swapped",
        "hand.velocity_m_s:nan",
        "hand.acceleration_m_s2:infinite",
        "hand.height_m:foreign:-5",
        "hand.fingertips_height_m:nan",
        "hand.time_s:offset:-0.3",
        "hole.confidence:nan",
        "hole.seen_s:infinite",
        "parts.time_s:stuck",
        "part.position_m:nan",
        "part.position_m:foreign:1e9",
    ],
)
def test_the_answers_show_it_at_once(fault: str) -> None:
    assert shows(answers(fault))[0] in (4, 5)


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ("bench.answer:lost", [None] * 3),
        ("bench.answer:stuck", [5, 5, 5]),
        ("bench.answer:repeated", [5, 6, 6]),
        ("bench.view:stuck", [5, 6, 7]),
    ],
)
def test_answers_are_missing_frozen_or_come_again(fault: str, told: list[int | None]) -> None:
    assert [None if view is None else view.sequence for view in answers(fault)[4:7]] == told


def test_a_late_answer_keeps_its_stamp() -> None:
    views = answers("bench.answer:late:0.3")
    assert views[-1] is not None
    assert views[-1].time_s == pytest.approx(len(views) * PERIOD_S - 0.3, abs=PERIOD_S)


def test_holes_and_parts_change_places() -> None:
    view = answers("bench.holes:swapped")[-1]
    assert view is not None
    assert [hole.part for hole in view.holes.values()] == [None, "o1"]
    parts: PartsView = answers("parts.detections:swapped")[-1]  # type: ignore[assignment]
    assert [detection.part for detection in parts.detections] == ["o2", "o1"]
    assert parts.detections[0].world_from_part.position_m[0] == 0.3


def test_a_value_that_is_not_told_stays_so() -> None:
    fault = SignalFault.parse("hand.height_m:offset:0.1")
    assert fault.apply(None, 1.0) is None
    assert math.isclose(fault.apply(0.2, 2.0), 0.3)


def test_depths_are_changed_as_images_are() -> None:
    depth_mm = np.full((4, 6), 900, np.uint16)
    for kind in ("lost", "scaled:2", "flipped:2", "foreign"):
        fault = SignalFault.parse(f"overhead.depth_mm:{kind}")
        fault.apply(depth_mm, 0.0)
        changed = fault.apply(depth_mm, 1.0)
        assert (changed.dtype, changed.shape) == (depth_mm.dtype, depth_mm.shape)


def test_several_faults_spoil_one_answer() -> None:
    source = Detector()
    both = Injections([Injection("hand.palm_m:nan", "carry"), Injection("hole.confidence:nan", "carry")])
    watcher, _ = both.detectors(source, Finder())  # type: ignore[arg-type]
    for injection in both.injections:
        injection.begin(injection.fault, 0.0)
    view = watcher.poll()
    view = watcher.poll()
    assert view is not None
    assert view.hand is not None
    assert math.isnan(view.hand.palm_m[0])
    assert math.isnan(view.holes["p1"].confidence)


@pytest.mark.parametrize("name", DETECTED)
def test_every_kind_can_be_put_into_an_answer(name: str) -> None:
    if name == "overhead.depth_mm":
        return
    for kind in DETECTED[name].kinds:
        assert len(answers(f"{name}:{kind}")) == 16


def test_a_run_tells_when_its_faults_came() -> None:
    both = Injections([Injection("part_falls", "lift"), Injection("arm_nan", "carry")])
    both.injections[1].begin("arm_nan", 3.0)
    assert both.told == (
        "part_falls never came: the work was not, or too briefly, in state lift; arm_nan came at 3.00 s"
    )
