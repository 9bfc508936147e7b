"""Training data from logs: what was seen comes back, and what is not known is left out with a reason."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import pytest

from bracket_cell.commands.main import main
from bracket_cell.learned.actions.settings import Classes
from bracket_cell.learned.semantic.records import load_demonstrations
from bracket_cell.log.read.reader import Log
from bracket_cell.log.replay.logged_tree import logged_bench, logged_product
from bracket_cell.log.report.demonstrations import demonstration_of
from bracket_ground.errors import InputError, LogError
from bracket_ground.interfaces.hand_window import window_px
from bracket_ground.interfaces.perception import Action, BenchView, HandSample, HoleView, PartDetection, PartsView
from bracket_ground.interfaces.pose import Pose
from bracket_lab.learned.actions.data import load_segments
from bracket_lab.learned.grasp.data import read_scenes
from bracket_lab.recorded.manifest import logs_by_hash, write_training_data
from bracket_lab.recorded.segments import bench_views, carried_parts, segments
from bracket_lab.recorded.tray_scenes import attempts, scene_records
from tests import ROOT

COMMAND = "cell log export x --to training --out y"


@pytest.fixture(scope="module")
def folder(tray_log: Log, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("data") / "out"
    write_training_data([tray_log], out, COMMAND)
    return out


def rows(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()][1:]


@pytest.mark.long
def test_segments_hold_the_track_and_the_label_of_the_log(tray_log: Log, folder: Path) -> None:
    by_frame = {view.sequence: view for view in bench_views(tray_log)}
    found = rows(folder / "segments.jsonl")
    assert {row["detected"]["kind"] for row in found} >= {"assembly", "screw"}
    for row in found:
        frames = range(row["frame"] - 44, row["frame"] + 1)
        assert row["detected"]["kind"] == by_frame[row["frame"]].action.kind
        for hand, frame in zip(row["hands"], frames, strict=True):
            seen = by_frame[frame].hand
            assert (hand is None) == (seen is None)
            if seen is not None:
                assert tuple(hand["fingertips_m"]) == seen.fingertips_m


def test_detectors_of_actions_learn_from_segments_of_a_log(tray_log: Log, folder: Path) -> None:
    product, bench = logged_product(tray_log), logged_bench(tray_log)
    learned = load_segments([folder], Classes.of(product))
    assert len(learned) >= 3
    shown = [row for row in rows(folder / "segments.jsonl") if row["hand_crop"]]
    assert shown
    assert any(row["hole_crop"] for row in shown)
    for row in shown:
        window = cv2.imread(str(folder / row["hand_crop"]))
        assert window is not None
        assert window.shape == (window_px(bench.overhead), window_px(bench.overhead), 3)


def test_a_confirmed_placement_is_told(folder: Path) -> None:
    truths = [row["confirmed"] for row in rows(folder / "segments.jsonl") if row["confirmed"]]
    assert truths
    assert all((truth["part"], truth["position"], truth["agrees"]) == ("o3", "p6", True) for truth in truths)


def test_crops_are_what_the_boxes_cut_out(folder: Path) -> None:
    found = rows(folder / "crops.jsonl")
    assert {row["kind"] for row in found} == {"hand", "part"}
    assert any(row["confirmed"] == "o3" for row in found if row["kind"] == "hand")
    for row in found:
        crop = cv2.imread(str(folder / row["file"]))
        left, top, right, bottom = row["box_px"]
        assert crop is not None
        assert crop.shape[0] <= bottom - top
        assert crop.shape[1] <= right - left


def test_scenes_are_read_back_for_training(tray_log: Log, folder: Path) -> None:
    product = logged_product(tray_log)
    [scene] = read_scenes(folder / "scenes.jsonl", product)
    view = next(tick.observation.parts for tick in tray_log.ticks if tick.observation.parts is not None)
    assert [part.part for part in scene.parts] == [part.part for part in view.detections]
    assert cv2.imread(str(folder / "scenes" / "000001.png")) is not None


def test_grasps_are_told_with_their_scene_and_end(tray_log: Log) -> None:
    plan = ("plan", {"required": 1, "graspable": 0.8, "solution": "grasp"})
    moved = ("plan", {"required": 0, "graspable": 0.1, "solution": "move b"})
    ended = [
        ("skill", {"node": "PickPart", "status": s, "reason": r}) for s, r in (("failure", "missed"), ("success", ""))
    ]
    begin = next(place for place, tick in enumerate(tray_log.ticks) if tick.observation.parts is not None)
    log = replace(tray_log, ticks=tray_log.ticks[begin:])
    [one, other] = attempts(changed(log, plan, ended[0], plan, ended[1], moved, ended[0]))
    assert (one.number, one.succeeded, one.reason, one.graspable) == (1, False, "missed", 0.8)
    assert other.succeeded
    assert one.row("x", 4)["part"] == one.view.detections[1].part
    assert not list(attempts(changed(log, ended[0]))), "a grasp of which no plan told"


def test_the_manifest_counts_and_says_whose_labels(tray_log: Log, folder: Path) -> None:
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["counts"]["segments"] == len(rows(folder / "segments.jsonl"))
    assert manifest["counts"]["crops_of_hands"] + manifest["counts"]["crops_of_parts"] == len(
        rows(folder / "crops.jsonl")
    )
    [log] = manifest["logs"]
    assert log["files"] == {str(tray_log.path): hashlib.sha256(tray_log.path.read_bytes()).hexdigest()}
    assert (log["goal"], log["goal_known_by"]) == ("g0", "belief"), "o3 at p6 is g0 alone"
    assert manifest["counts"]["placements"] == 1
    assert all(told.startswith("machine") for told in manifest["labels"].values())


def changed(log: Log, *notes: tuple[str, dict[str, Any]]) -> Log:
    """The log with other notes, one in each tick from the first on."""
    ticks = [replace(tick, notes=()) for tick in log.ticks]
    for number, note in enumerate(notes):
        ticks[number] = replace(ticks[number], notes=(note,))
    return replace(log, ticks=tuple(ticks))


def edge(part: str | None, position: str, source: str = "action") -> tuple[str, dict[str, Any]]:
    return "belief", {"edge": [part, position], "source": source}


def test_a_whole_assembly_is_a_demonstration_of_its_goal(tray_log: Log, tmp_path: Path) -> None:
    product = logged_product(tray_log)
    goal = list(product.goal_placements("g2").items())
    edges = [edge(part, position, "robot" if position == "p3" else "action") for position, part in goal]
    taken = demonstration_of(changed(tray_log, *edges), product)
    assert taken.goal_known_by == "all holes"
    assert taken.demonstration is not None
    assert taken.demonstration.goal == "g2"
    assert [(placement.position, placement.part) for placement in taken.demonstration.placements] == goal
    assert [placement.position for placement in taken.demonstration.placements if placement.by == "robot"] == ["p3"]
    write_training_data([changed(tray_log, *edges)], tmp_path / "out", COMMAND)
    assert load_demonstrations(tmp_path / "out" / "demonstrations.jsonl", product) == [taken.demonstration]


def test_corrections_are_left_out_and_an_unsure_goal_gives_nothing(tray_log: Log) -> None:
    product = logged_product(tray_log)
    sure = ("belief", {"goals": {"g0": 0.95, "g1": 0.05}, "placed": {}})
    notes = (edge("o2", "p1"), edge(None, "p1", "seen hole"), edge("o1", "p1", "seen hole"), edge("o1", "p2"), sure)
    taken = demonstration_of(changed(tray_log, *notes), product)
    assert taken.goal_known_by == "belief"
    assert taken.demonstration is not None
    assert [(placement.part, placement.position) for placement in taken.demonstration.placements] == [
        ("o1", "p1"),
        ("o1", "p2"),
    ]
    assert demonstration_of(changed(tray_log, *notes[:-1]), product).demonstration is None
    assert "g0 wants" in demonstration_of(changed(tray_log, edge("o3", "p1"), sure), product).why_not
    assert demonstration_of(changed(tray_log), product).why_not == "nothing was placed"
    later = changed(tray_log, *notes)
    assert "ticks are missing" in demonstration_of(replace(later, ticks=later.ticks[1:]), product).why_not


def test_what_was_there_at_first_has_no_order(tray_log: Log) -> None:
    product = logged_product(tray_log)
    sure = ("belief", {"goals": {"g0": 0.95}, "placed": {}})
    notes = (edge("o1", "p1", "seen hole"), edge("o1", "p2", "seen hole"), edge("o3", "p6"), sure)
    demonstration = demonstration_of(changed(tray_log, *notes), product).demonstration
    assert demonstration is not None
    assert demonstration.unordered_n == 2


def views(count: int, placed_at: int, seen: str | None, missing: int | None = None) -> list[BenchView]:
    """A hand that carries o1 and puts it into p2 at a frame; the hole is read from the next frame on."""
    found = []
    for number in range(count):
        time_s = number / 15
        hand = HandSample(time_s, (0, 0, 9, 9), (0.7, 0.1), (0.8, 0.1), "o1" if number < placed_at else None)
        after = number > placed_at
        action = Action("assembly", 0.9, "o1", "p2", True) if number >= placed_at else Action("transit", 0.9)
        holes = {"p2": HoleView(seen if after else None, 1.0, time_s)}
        if number != missing:
            found.append(BenchView(number, time_s, hand, holes, action))
    return found


def test_a_contradicted_action_is_told_as_one() -> None:
    right = [segment.confirmed for segment in segments(views(80, 60, "o1"))]
    wrong = [segment.confirmed for segment in segments(views(80, 60, "o3"))]
    assert {truth["agrees"] for truth in right if truth} == {True}
    assert {(truth["part"], truth["agrees"]) for truth in wrong if truth} == {("o3", False)}
    assert set(carried_parts(views(80, 60, "o3")).values()) == {"o3"}
    assert max(carried_parts(views(80, 60, "o3"))) == 59


def test_no_segment_spans_a_lost_frame() -> None:
    assert list(segments(views(60, 70, None)))
    assert not list(segments(views(60, 70, None, missing=30)))


def test_looks_at_a_part_that_nobody_moved_are_averaged() -> None:
    def look(number: int, x: float) -> PartsView:
        part = PartDetection("o1", 0.9, Pose.from_yaw((x, 0.0, 0.016), 0.1), (0.045, 0.028, 0.02), (0, 0, 9, 9))
        return PartsView(number, float(number), (part,))

    records = list(scene_records([look(0, 0.500), look(1, 0.504), look(2, 0.550)]))
    assert [record.truth[0].position_m[0] for record in records if record.truth] == pytest.approx([0.502, 0.502, 0.55])


def test_other_products_and_full_folders_are_refused(tray_log: Log, folder: Path, tmp_path: Path) -> None:
    product = tray_log.attachments["product.yaml"].replace(b"mass_kg: 0.08", b"mass_kg: 0.09")
    other = replace(tray_log, attachments={**tray_log.attachments, "product.yaml": product})
    with pytest.raises(LogError, match="another product"):
        write_training_data([tray_log, other], tmp_path / "out", COMMAND)
    with pytest.raises(LogError, match="is named twice"):
        write_training_data([tray_log, tray_log], tmp_path / "out", COMMAND)
    assert not (tmp_path / "out").exists(), "nothing is in the way of the next try"
    with pytest.raises(InputError, match="not an empty folder"):
        write_training_data([tray_log], folder, COMMAND)


def test_command_writes_and_asks_for_what_is_missing(
    tray_log: Log, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    export = ["log", "export", "--to", "training"]
    assert main([*export, str(tray_log.path), "--out", str(tmp_path / "log")]) == 0
    assert (tmp_path / "log" / "manifest.json").exists()
    capsys.readouterr()
    bad, copied = tmp_path / "bad.mcap", tmp_path / "copied.mcap"
    bad.write_bytes(b"bad")
    copied.write_bytes(tray_log.path.read_bytes())
    for other, why in (
        (tmp_path / "none.mcap", "none.mcap: cannot be read"),
        (bad, "bad.mcap: is not an MCAP file"),
        (tray_log.path, f"{tray_log.path.name}: is named twice"),
        (copied, "copied.mcap: is named twice, or is a copy of another"),
    ):
        assert main([*export, str(tray_log.path), str(other), "--out", str(tmp_path / "other")]) == 2
        assert why in capsys.readouterr().err
        assert not (tmp_path / "other").exists()


def test_logs_that_are_not_there_are_told_before_any_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bracket_cell.commands.log_export.read", lambda _: pytest.fail("a log is read"))
    (tmp_path / "some.mcap").write_bytes(b"some")
    for other in ("none.mcap", "./some.mcap"):
        logs = [str(tmp_path / "some.mcap"), f"{tmp_path}/{other}"]
        assert main(["log", "export", *logs, "--to", "training", "--out", "new"]) == 2


def test_the_logs_of_a_folder_are_known_by_their_content(tray_log: Log, folder: Path, tmp_path: Path) -> None:
    assert list(logs_by_hash(folder).values()) == [str(tray_log.path)]
    assert logs_by_hash(tmp_path) == {}
    (tmp_path / "manifest.json").write_text("{")
    with pytest.raises(InputError, match=r"manifest\.json: is not a manifest of training data"):
        logs_by_hash(tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("planner", ["semantic", "grasp"])
def test_planners_are_trained_on_it(planner: str, tray_log: Log, tmp_path: Path) -> None:
    """In a process of its own: torch and the software OpenGL of this one crash together."""
    product = logged_product(tray_log)
    logs = []
    for goal in product.goals:
        path = tmp_path / f"{goal}.mcap"
        path.write_bytes(tray_log.path.read_bytes() + goal.encode())  # no copy of the others
        edges = (edge(part, position) for position, part in product.goal_placements(goal).items())
        logs.append(replace(changed(tray_log, *edges), path=path, parts=()))
    write_training_data(logs, tmp_path / "out", COMMAND)
    data = {"semantic": "demonstrations.jsonl", "grasp": "scenes.jsonl"}[planner]
    command = [sys.executable, "-m", "bracket_cell", "lab", "train", planner, "--data", str(tmp_path / "out" / data)]
    command += ["--out", str(tmp_path / "weights.onnx"), "--json"]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert told.returncode == 0, told.stderr
    assert (tmp_path / "weights.onnx").stat().st_size > 1000
