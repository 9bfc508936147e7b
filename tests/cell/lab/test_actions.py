"""How action detectors and whole assemblies are counted; and one short watch of a real recording."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.commands.main import main
from bracket_cell.configuration import Configuration, load_configuration, load_product, simulated
from bracket_cell.learned.actions.settings import Classes
from bracket_ground.errors import InputError
from bracket_ground.interfaces.devices import TruthEvent
from bracket_ground.interfaces.perception import Action
from bracket_lab.drawing.hands import visible_shares
from bracket_lab.drawing.placed import placed, releases, slipped, with_slips
from bracket_lab.drawing.recording import Assembly, Source
from bracket_lab.drawing.recording import record as recorded
from bracket_lab.drawing.tracks import hands_of
from bracket_lab.evaluations.actions import Tally, evaluate_actions, matched
from bracket_lab.evaluations.system import Listener, table_1, with_goals
from bracket_lab.learned.scores import share
from bracket_sim.scene.settings import settings_of
from tests.cell.fakes import frame, idle_view
from tests.cell.recording.test_recorder import record

CONFIGURATION = load_configuration()
PRODUCT = load_product(CONFIGURATION)
CLASSES = Classes.of(PRODUCT)


def test_a_placement_is_right_in_time_with_part_and_hole_and_once() -> None:
    placed = [(1.0, "o1", "p1"), (5.0, "o2", "p2"), (9.0, "o1", "p3")]
    assert matched(placed, [(1.4, "o1", "p1"), (1.8, "o1", "p1")]) == pytest.approx([0.4])
    assert matched(placed, [(6.2, "o2", "p2"), (9.2, "o1", "p4"), (9.2, "o2", "p3")]) == []
    assert matched(placed, []) == []


@cache
def slipping() -> Assembly:
    return recorded(PRODUCT, CONFIGURATION.bench, settings_of(CONFIGURATION.devices.simulation), 820400)


def test_a_part_that_slipped_into_its_hole_was_placed() -> None:
    assembly = slipping()
    number, part, position = releases(assembly)[1]
    assert slipped(Source(assembly, PRODUCT, CONFIGURATION.bench)) == []
    forgotten = tuple(
        replace(label, released=False) if (label.part, label.position) == (part, position) else label
        for label in assembly.labels
    )
    found = slipped(Source(replace(assembly, labels=forgotten), PRODUCT, CONFIGURATION.bench))
    assert [one[1:] for one in found] == [(part, position)]
    assert abs(found[0][0] - number) <= CONFIGURATION.bench.overhead.rate_hz
    came = found[0][0]
    leant = [replace(moment, upright=-np.ones_like(moment.upright)) for moment in assembly.moments[came : came + 8]]
    leaning = replace(assembly, moments=(*assembly.moments[:came], *leant, *assembly.moments[came + 8 :]))
    pressed = slipped(Source(replace(leaning, labels=forgotten), PRODUCT, CONFIGURATION.bench))
    assert pressed == [(came + 8, part, position)]
    assert slipped(Source(leaning, PRODUCT, CONFIGURATION.bench)) == []
    held = tuple(part if came <= at < came + 6 else one for at, one in enumerate(assembly.held))
    let_go = slipped(Source(replace(assembly, labels=forgotten, held=held), PRODUCT, CONFIGURATION.bench))
    assert let_go == [(came + 6, part, position)]  # it stood in its hole, and was held yet
    tipped = replace(assembly.moments[number + 40], upright=-np.ones_like(assembly.moments[number + 40].upright))
    moments = (*assembly.moments[: number + 40], tipped, *assembly.moments[number + 41 :])
    assert slipped(Source(replace(assembly, moments=moments), PRODUCT, CONFIGURATION.bench)) == []


def test_fingers_that_open_after_a_part_slipped_into_its_hole_placed_it_when_both_was_so() -> None:
    assembly = slipping()
    number, part, position = releases(assembly)[1]
    forgotten = tuple(
        replace(label, released=False) if (label.part, label.position) == (part, position) else label
        for label in assembly.labels
    )
    source = Source(replace(assembly, labels=forgotten), PRODUCT, CONFIGURATION.bench)
    ((came, *_),) = slipped(source)

    def told(after_s: float, **fields: str | None) -> TruthEvent:
        what = {"act": "release", "part": None, "position": None} | fields
        return TruthEvent(assembly.moments[came].time_s + after_s, "act", what)

    late, early, other = told(0.4), told(-0.6), told(0.0, part="o9", position="p9")
    named, *rest = with_slips([late, early, other, told(1.5)], source)
    assert named == told(0.4, part=part, position=position)
    assert rest == [early, other, told(1.5)]
    assert with_slips([told(1.5)], source) == [told(1.5)]
    assert placed(source) == sorted([*releases(source.assembly), (came, part, position)])
    moments = assembly.moments
    leant = [replace(moment, upright=-np.ones_like(moment.upright)) for moment in moments[number : number + 8]]
    leaning = replace(assembly, moments=(*moments[:number], *leant, *moments[number + 8 :]))
    assert (number + 8, part, position) in placed(Source(leaning, PRODUCT, CONFIGURATION.bench))


def test_by_physics_what_slips_out_of_the_fingers_is_labelled_as_what_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """The hand opens over p1 half a second before o1, which fell from it, stands there; no more is recorded."""
    monkeypatch.setattr("bracket_lab.drawing.recording.LONGEST_S", 7.0)
    nominal = simulated(CONFIGURATION, "nominal", "varied")
    assembly = recorded(PRODUCT, nominal.bench, settings_of(nominal.devices.simulation), 824104, physics=True)
    first = next(label for label in assembly.labels if label.kind == "assembly")
    assert (first.part, first.position) == ("o1", "p1")
    number, *what = releases(assembly)[0]
    assert what == ["o1", "p1"]
    assert assembly.moments[number].time_s == pytest.approx(4.9, abs=0.15)
    source = Source(assembly, PRODUCT, nominal.bench)
    assert assembly.moments[placed(source)[0][0]].time_s == pytest.approx(5.4, abs=0.1)


def test_segments_in_the_guard_band_count_apart() -> None:
    tally = Tally(rows=[(0, 0, False), (0, 1, True), (19, 19, False), (18, 19, False)], placed=4, told=3, right=2)
    tally.latency_s, tally.told_by_hand, tally.right_by_hand = [0.01, 0.02], 2, 1
    found = tally.summary(CLASSES)
    assert found["all_segments"]["share"] == 0.5
    assert found["outside_guard"] == share(2, 3)
    assert found["placements"]["share"] == 0.5
    assert found["false_per_100"] == found["false_per_100_by_hand"] == 25.0
    assert found["placements_by_hand"]["share"] == 0.25
    assert found["confusions"] == {"screw > transit": 1}
    assert tally.reports(CLASSES) == [(("o1", "p1"), ("o1", "p1"))]


def test_an_observer_keeps_each_told_placement_once() -> None:
    listener = Listener()
    for number in range(6):
        view = idle_view(frame(number))
        finished = Action("assembly", 0.9, "o1", "p2", finished=True)
        shown = replace(view, action=finished) if number in (2, 3, 4) else view
        made = record(number)
        listener.tick(replace(made, observation=replace(made.observation, bench=shown)))
    assert [one[1:] for one in listener.told] == [("o1", "p2")]
    assert listener.by_hand == listener.told


def test_a_placement_that_its_hole_told_is_counted_but_not_as_told_by_the_hand() -> None:
    listener, made = Listener(), record(0)
    shown = replace(idle_view(frame(0)), action=Action("assembly", 0.9, "o1", "p2", finished=True, shown=True))
    listener.tick(replace(made, observation=replace(made.observation, bench=shown)))
    assert (len(listener.told), listener.by_hand) == (1, [])


def test_table_1_has_a_row_for_each_number_of_goals() -> None:
    row = {
        "told_right": 5,
        "placed": 6,
        "told": 6,
        "allowed_right": 2,
        "allowed": 2,
        "correct": True,
        "end": "finished",
    }
    by_hand = {**row, "told_right_by_hand": 4, "goals": 3, "contradictions": 1}
    found = table_1([{**row, "goals": 1, "contradictions": 0}, by_hand])
    assert found["3"]["AD_by_hand"] == share(4, 6)
    assert "AD_by_hand" not in found["1"]  # rows from before it was counted
    assert list(found) == ["1", "3"]
    assert found["3"]["AD"]["share"] == pytest.approx(0.8333)
    assert list(with_goals(PRODUCT, 2).goals) == ["g0", "g1"]
    with pytest.raises(InputError, match="4 goals"):
        with_goals(PRODUCT, 4)


def test_an_evaluation_goes_on_where_it_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[int] = []

    def watch(_: object, __: object, kinds: list[str], seeds: list[int], **___: object) -> dict[str, Tally]:
        if len(asked) == 2:
            raise KeyboardInterrupt
        asked.extend(seeds)
        tally = Tally(rows=[(0, 0, False), (19, 18, seeds[0] % 2 == 0)], placed=2, told=1, right=1, latency_s=[0.01])
        return dict.fromkeys(kinds, tally)

    monkeypatch.setattr("bracket_lab.evaluations.actions.evaluate_actions", watch)
    out = str(tmp_path / "rows.jsonl")
    words = ["lab", "eval", "actions", "--look", "nominal", "--seeds", "900000:900003", "--out", out, "--json"]
    assert main(words) == 1
    stopped = capsys.readouterr()
    assert "interrupted after 2 of 3" in stopped.err
    assert json.loads(stopped.out.splitlines()[-1])["kinds"]["slim"]["all_segments"]["n"] == 4
    asked.clear()
    assert main(words) == 0
    assert asked == [900_002]
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert found["recordings"] == 3
    assert found["kinds"]["slim"]["outside_guard"] == share(3, 4)
    assert found["kinds"]["slim"]["placements"] == share(3, 6)
    assert main([*words, "--look", "varied"]) == 2


@pytest.mark.long
def test_detectors_watch_with_the_camera_where_its_calibration_finds_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """As for hands, holes, parts and whole assemblies; crops of `varied` were cut where the camera did not hang."""
    seen: list[object] = []

    class Stop(Exception):
        pass

    def watcher(configuration: Configuration, *_: object) -> None:
        seen.append(configuration.bench.overhead.mount)
        raise Stop

    monkeypatch.setattr("bracket_lab.evaluations.actions._Watcher", watcher)
    looks = simulated(CONFIGURATION, "varied", "varied")
    for calibrated in (True, False):
        with pytest.raises(Stop):
            evaluate_actions(looks, PRODUCT, ["slim"], [800_003], calibrated=calibrated)
    assert seen[0] != seen[1] == looks.bench.overhead.mount


def test_what_is_done_under_the_robot_is_counted_apart() -> None:
    rows = [(0, 19, False), (0, 0, False), (19, 19, False), (18, 19, True)]
    tally = Tally(rows=rows, hidden=[True, False, False, True], placed=5, placed_hidden=2, right=4, right_hidden=1)
    found = replace(tally, latency_s=[0.01]).summary(CLASSES)
    assert found["outside_guard"] == share(2, 3)
    assert found["outside_guard_seen"] == share(2, 2)
    assert found["placements"] == share(4, 5)
    assert found["placements_seen"] == share(3, 3)


def test_a_hand_under_the_arm_is_hidden() -> None:
    """Seed 820002 of `varied`: the arm that hands a part over hangs over the hand while it is placed (6 s)."""
    looks = simulated(CONFIGURATION, "varied", "varied")
    recording = recorded(PRODUCT, looks.bench, settings_of(looks.devices.simulation), 820_002)
    source = Source(recording, PRODUCT, looks.bench)
    shares = visible_shares(source, [45, 90])
    assert shares[0] > 0.9
    assert shares[1] < 0.1
    hands = hands_of(source)
    assert hands[45] is not None
    assert hands[90] is None  # nobody could tell it


@pytest.mark.slow
def test_the_shipped_detector_names_what_the_person_does() -> None:
    looks = simulated(CONFIGURATION, "nominal", "varied")
    tally = evaluate_actions(looks, PRODUCT, ["slim"], [900_100])["slim"]
    found = tally.summary(CLASSES)
    assert found["outside_guard"]["share"] > 0.9
    assert found["placements"]["share"] > 0.8
    assert np.median(tally.latency_s) < 0.1
