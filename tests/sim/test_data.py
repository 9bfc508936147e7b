"""Data from the simulated world: labels follow the written rule, splits never meet, same call, same files."""

from __future__ import annotations

import json
import math
import pickle
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product, simulated
from bracket_cell.learned.actions.settings import Classes
from bracket_cell.learned.holes.model import hole_crops, squares_m
from bracket_ground.errors import InputError
from bracket_ground.files.data_folder import DataFolder, DataPiece
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.hand_window import last_at_hole, window_px
from bracket_ground.interfaces.perception import SEGMENT_FRAMES, HandSample
from bracket_lab.drawing.actions import MOST_OF, write_holes, write_segments
from bracket_lab.drawing.fallen import FallenParts
from bracket_lab.drawing.hands import FRAMES, every_frame, hand_frames, shares_by_height, visible_shares, write_hands
from bracket_lab.drawing.objects import write_objects
from bracket_lab.drawing.placed import holes_of
from bracket_lab.drawing.plates import Plate, write_plates
from bracket_lab.drawing.recording import Assembly, Source, record
from bracket_lab.drawing.sight import GEOM_POSITIONS, SPLITS, mixed_clutter, seeds, sometimes_steel
from bracket_lab.drawing.tracks import as_tracked, hands_of
from bracket_lab.learned.actions.data import load_segments
from bracket_lab.learned.holes.evaluate import load_plates
from bracket_lab.learned.parts.data import load_scenes
from bracket_sim.scene.person import Storage
from bracket_sim.scene.settings import settings_of
from bracket_sim.worker.worker_sight import NEAR_HOLE_M, SEATED_TILT_RAD

CONFIGURATION = simulated(load_configuration(), "nominal", "careful")
BENCH, PRODUCT = CONFIGURATION.bench, load_product(CONFIGURATION)
SIMULATION = settings_of(CONFIGURATION.devices.simulation)
SEED = 7


@cache
def assembly(physics: bool = False) -> Assembly:
    return record(PRODUCT, BENCH, SIMULATION, SEED, physics=physics)


def source(physics: bool = False) -> Source:
    return Source(assembly(physics), PRODUCT, BENCH)


def rows(path: Path) -> list[dict[str, Any]]:
    header, *found = [json.loads(line) for line in path.read_text().splitlines()]
    assert set(header) == {"format", "version", "source"}
    return found


def image(path: Path) -> np.ndarray[Any, Any]:
    found = cv2.imread(str(path))
    assert found is not None, path
    return found


def test_no_seed_is_in_two_splits() -> None:
    splits = list(SPLITS.values())
    for index, split in enumerate(splits):
        for other in splits[:index]:
            assert not set(split) & set(other)
    assert seeds(900_000, 10) == ("test", range(900_000, 900_010))
    assert seeds(799_999, 1)[0] == "train"
    for first, count in ((799_999, 2), (899_995, 10), (0, 900_000), (999_999, 2), (1_000_000, 1)):
        with pytest.raises(InputError, match="not of one split"):
            seeds(first, count)


@pytest.mark.parametrize("physics", [False, True])
def test_the_hand_holds_the_part_until_it_is_let_go(physics: bool) -> None:
    taken = assembly(physics)
    classes = {label.kind for label in taken.labels}
    assert classes == {"assembly", "screw", "transit", "idle"}
    placed = {(label.part, label.position) for label in taken.labels if label.kind == "assembly"}
    assert placed == {(part, position) for position, part in PRODUCT.goal_placements(taken.goal).items()}
    before = [index for index, label in enumerate(taken.labels) if label.kind == "assembly"]
    firsts = [index for index in before if taken.labels[index - 1].kind != "assembly"]
    assert len(firsts) == len(placed)
    for index in firsts:
        assert [taken.held[at] for at in range(index - 3, index + 4)] == [taken.labels[index].part] * 7
    held_idle = [held for held, label in zip(taken.held, taken.labels, strict=True) if label.kind == "idle" and held]
    assert not held_idle


def test_the_holes_are_empty_at_first_and_hold_the_goal_at_last() -> None:
    taken = assembly()
    first, last = (holes_of(source(), taken.moments[index]) for index in (0, -1))
    assert set(first.values()) == {(None, True)}
    assert {position: part for position, (part, upright) in last.items() if upright} == dict(
        PRODUCT.goal_placements(taken.goal)
    )


def test_segments_end_with_their_class_and_have_all_their_frames(tmp_path: Path) -> None:
    write_segments(source(), DataFolder(tmp_path / "new", "test"))
    found = rows(tmp_path / "new" / "segments.jsonl")
    side_px = window_px(BENCH.overhead)
    labels = {
        moment.exposure.sequence: label for moment, label in zip(assembly().moments, assembly().labels, strict=True)
    }
    assert {row["truth"]["kind"] for row in found} == {"assembly", "screw", "transit", "idle"}
    assert 0 < sum(row["guarded"] for row in found) < len(found) / 2
    for row in found:
        label = labels[row["frame"]]
        assert row["truth"] == asdict(label)
        assert len(row["hands"]) == SEGMENT_FRAMES
        assert row["end_s"] - row["begin_s"] == pytest.approx((SEGMENT_FRAMES - 1) / 15, abs=0.01)
        last = row["hands"][-1]
        assert (last is None) == (row["hand_crop"] is None)
        if last is not None:
            assert image(tmp_path / "new" / row["hand_crop"]).shape == (side_px, side_px, 3)
        tips_m = [(np.nan, np.nan) if hand is None else hand["fingertips_m"] for hand in row["hands"]]
        assert (last_at_hole(np.array(tips_m), source().holes_m) is None) == (row["hole_crop"] is None)


def test_a_tracker_loses_the_hand_and_takes_it_to_be_elsewhere(tmp_path: Path) -> None:
    write_segments(source(), DataFolder(tmp_path / "new", "test"), gaps=True)
    for row in rows(tmp_path / "new" / "segments.jsonl"):
        assert (row["hands"][-1] is None) == (row["hand_crop"] is None)
    visible = visible_shares(source(), range(len(assembly().moments)))
    perfect = hands_of(source(), visible)
    told = [as_tracked(source(), perfect, visible, np.random.default_rng(seed)) for seed in (0, 1, 2, 0)]
    assert told[3] == told[0] != told[1]
    seen = np.array([one is not None for one in perfect])
    lost = np.array([[one is None for one in track] for track in told[:3]])[:, seen].mean()
    assert 0.005 < lost < 0.2
    away_m = [
        np.linalg.norm(np.array(one["fingertips_m"]) - was["fingertips_m"])
        for track in told[:3]
        for one, was in zip(track, perfect, strict=True)
        if one is not None and was is not None
    ]
    assert 0.002 < np.mean(np.array(away_m) > 0.05) < 0.2
    assert np.median(away_m) == 0


class SeesEverySecond:
    """Sees the hand in every second frame, at a place of its own; it knows no height (HandTracker)."""

    others: tuple[HandSample, ...] = ()

    def __init__(self) -> None:
        self.shown: list[Frame] = []

    def track(self, frame: Frame) -> HandSample | None:
        self.shown.append(frame)
        x_m = 0.001 * frame.sequence
        sample = HandSample(frame.time_s, (1, 2, 3, 4), (x_m, 0.4), (x_m, 0.3), held_part="o2", thumb_m=(x_m, 0.41))
        return sample if frame.sequence % 2 else None


@pytest.mark.long
def test_segments_tell_the_hand_as_a_given_tracker_sees_it(tmp_path: Path) -> None:
    tracker = SeesEverySecond()
    write_segments(source(), DataFolder(tmp_path / "new", "test"), thin=True, gaps=True, tracker=tracker)
    exposures = [moment.exposure.sequence for moment in assembly().moments]
    assert [frame.sequence for frame in tracker.shown] == exposures
    for row in rows(tmp_path / "new" / "segments.jsonl"):
        seen = [one for one in row["hands"] if one is not None]
        assert 15 < len(seen) < 30
        assert {one["held_part"] for one in seen} == {"o2"}
        assert all(one["palm_m"][1] == 0.3 and one["fingertips_height_m"] is None for one in seen)
        assert (row["frame"] % 2 == 0) == (row["hand_crop"] is None)
    assert load_segments([tmp_path / "new"], Classes.of(PRODUCT)).tracks_m.shape[1:] == (1 + SEGMENT_FRAMES, 6)


def test_fingers_open_once_in_each_assembly() -> None:
    taken = assembly()
    for before, now in pairwise(taken.labels):
        assert not (before.released and not now.released and before == now)
    opened = [now for before, now in pairwise(taken.labels) if now.released and not before.released]
    assert len(opened) == len(PRODUCT.positions)


def test_thinned_segments_are_all_assemblies_and_few_of_the_rest(tmp_path: Path) -> None:
    write_segments(source(), DataFolder(tmp_path / "all", "test"))
    write_segments(source(), DataFolder(tmp_path / "thin", "test"), thin=True)
    counts = [
        Counter(row["truth"]["kind"] for row in rows(tmp_path / name / "segments.jsonl")) for name in ("all", "thin")
    ]
    assert counts[1]["assembly"] == counts[0]["assembly"] > 10
    assert all(0 < counts[1][kind] <= most for kind, most in MOST_OF.items())


def test_hands_in_frames_are_where_the_rows_say(tmp_path: Path) -> None:
    looks = settings_of(simulated(CONFIGURATION, "nominal").devices.simulation).look
    person = looks.low.person.model_copy(update={"second_hand": True, "left_hand": True})
    look = looks.model_copy(update={"low": looks.low.model_copy(update={"person": person})})
    look = look.model_copy(update={"high": look.low})
    taken = record(PRODUCT, BENCH, SIMULATION.model_copy(update={"look": look}), SEED)
    write_hands(Source(taken, PRODUCT, BENCH), DataFolder(tmp_path / "new", "test"))
    found = rows(tmp_path / "new" / "hands.jsonl")
    skin = np.array(person.hand_rgb)[::-1]
    checked = 0
    for row in found:
        picture = image(tmp_path / "new" / row["file"])
        for hand in row["hands"]:
            assert hand["side"] == ("left" if hand["acting"] else "right")
            assert (hand["held_part"] is None) == ("held" not in hand["points_px"])
            left, top, right, bottom = hand["box_px"]
            column, line = (round(value) for value in hand["points_px"]["palm"])
            if not (5 < column < 475 and 5 < line < 355 and hand["visible"] > 0.7):
                continue
            assert left <= column < right
            assert top <= line < bottom
            colours = picture[line - 2 : line + 3, column - 2 : column + 3].reshape(-1, 3).mean(axis=0)
            assert colours @ skin / np.linalg.norm(colours) / np.linalg.norm(skin) > 0.98
            checked += 1
    assert checked > len(found)  # both hands, in most frames


def test_the_arm_stands_elsewhere_in_each_stretch_and_keeps_away_from_the_fingers() -> None:
    stretches = [range(start, start + 2) for start in range(100, 220, 10)]
    seen = list(hand_frames(source(), stretches))
    tool = assembly().world.model.body("tool").id
    geom = int(np.flatnonzero(assembly().world.model.geom_bodyid == tool)[0])
    places = np.array([frame.poses[GEOM_POSITIONS][geom] for frame in seen])
    assert np.allclose(places[::2], places[1::2])
    assert len(np.unique(places.round(4), axis=0)) > len(stretches) / 2
    for frame, place in zip(seen, places, strict=True):
        acting = next((hand for hand in frame.hands if hand.acting), None)
        if acting is not None:
            assert np.linalg.norm(place - np.array(acting.points_m["pinch"])) > 0.1


def test_hands_to_learn_from_come_from_every_side_and_their_fingertips_stay() -> None:
    stretches = [range(index, index + 1) for index in range(20, 320, 5)]
    plain, turned = (list(hand_frames(source(), stretches, turned=turns)) for turns in (False, True))
    angles = []
    for before, after in zip(plain, turned, strict=True):
        both = [next((hand for hand in frame.hands if hand.acting), None) for frame in (before, after)]
        if both[0] is None or both[1] is None:
            continue
        first, then = both[0].points_m, both[1].points_m
        assert np.allclose(first["pinch"], then["pinch"])
        (x, y), (u, v) = (np.subtract(one["pinch"], one["wrist"])[:2] for one in (first, then))
        angles.append(np.arctan2(x * v - y * u, x * u + y * v))
        assert np.isclose(first["wrist"][2], then["wrist"][2])
        if both[0].held_part is not None:
            away_m = [np.linalg.norm(np.subtract(one["held"], one["pinch"])) for one in (first, then)]
            assert np.isclose(away_m[0], away_m[1], atol=1e-4)
    share = np.mean(np.abs(angles) > 0.01)
    assert 0.1 < share < 0.4
    assert min(angles) < -1.0 < 1.0 < max(angles)


def test_shadows_of_hands_and_gripper_are_told_where_it_is_darker() -> None:
    stretches = [range(index, index + 1) for index in range(60, 260, 10)]
    low_lamps = settings_of(simulated(load_configuration(), "hard", "careful").devices.simulation)
    shown = {}
    for shadows in (False, True):
        settings = low_lamps.model_copy(update={"look": low_lamps.look.fixed("light.shadows", shadows)})
        lit = Source(record(PRODUCT, BENCH, settings, SEED, physics=False), PRODUCT, BENCH)
        shown[shadows] = list(hand_frames(lit, stretches))
    darker = []
    for plain, dark in zip(shown[False], shown[True], strict=True):
        assert plain.shadows_px == ()
        assert len(dark.shadows_px) == 1 + len(dark.hands)
        for hand, place in zip(dark.hands, dark.shadows_px[1:], strict=True):
            column, row = np.array(place).round().astype(int)
            clear = min(np.linalg.norm(np.array(place) - hand.points_px[name]) for name in ("palm", "pinch")) > 20
            if clear and 2 < column < BENCH.overhead.width_px - 3 and 2 < row < BENCH.overhead.height_px - 3:
                here = np.s_[row - 2 : row + 3, column - 2 : column + 3]
                darker.append(dark.frame.image[here].mean() < 0.9 * plain.frame.image[here].mean())
    assert len(darker) > 10
    assert np.mean(darker) > 0.9


def test_what_hides_a_hole_is_told(tmp_path: Path) -> None:
    write_holes(source(), DataFolder(tmp_path / "new", "test"))
    found = rows(tmp_path / "new" / "holes.jsonl")
    assert {row["position"] for row in found} == set(PRODUCT.positions)
    covered = [row["covered"] for row in found]
    assert min(covered) == 0.0
    assert max(covered) > 0.2
    empty = [row for row in found if row["part"] is None and row["covered"] == 0]
    for row in empty[:10]:
        crop = image(tmp_path / "new" / row["file"])
        height, width = crop.shape[:2]
        assert crop[height // 2, width // 2].mean() < 60 < np.median(crop)


def test_boxes_of_parts_lie_around_them(tmp_path: Path) -> None:
    folder = DataFolder(tmp_path / "new", "test")
    for seed in range(3):
        write_objects(PRODUCT, BENCH, SIMULATION, seed, folder)
    found = rows(tmp_path / "new" / "objects.jsonl")
    assert len(found) == 3
    for row in found:
        picture = image(tmp_path / "new" / row["file"])
        for part in row["parts"]:
            left, top, right, bottom = part["box_px"]
            inside = picture[top:bottom, left:right].reshape(-1, 3).mean(axis=0)
            paint = np.array(PRODUCT.parts[part["part"]].colour_rgb)[::-1]
            assert inside.argmax() == paint.argmax()
            assert part["visible_px"] <= (right - left) * (bottom - top)


@pytest.mark.long
def test_mixed_trays_have_things_that_lie_and_unknown_ones_where_the_true_camera_sees_them(tmp_path: Path) -> None:
    folder = DataFolder(tmp_path / "new", "test")
    varied = settings_of(simulated(load_configuration(), "varied").devices.simulation)
    for seed in range(4):
        settings = varied.model_copy(update={"clutter": mixed_clutter(varied.clutter, seed)})
        write_objects(sometimes_steel(PRODUCT, 0.5, seed), BENCH, settings, seed, folder, views=2)
    found = load_scenes([tmp_path / "new"], PRODUCT)
    labels = [label for scene in found for label in scene.labels]
    assert len(found) == 8
    assert any(not label.upright for label in labels)
    assert any(label.part == "unknown" for label in labels)
    for row, scene in zip(rows(tmp_path / "new" / "objects.jsonl"), found, strict=True):
        for part, label in zip(row["parts"], scene.labels, strict=True):
            left, top, right, bottom = part["box_px"]
            assert label.box_px[0] - 3 < left
            assert label.box_px[1] - 3 < top
            assert right < label.box_px[2] + 4
            assert bottom < label.box_px[3] + 4


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_as_many_parts_of_a_mixed_tray_lie_as_is_asked_for(share: float) -> None:
    clutter = mixed_clutter(SIMULATION.clutter, seed=3, lying_share=share)
    assert clutter.lying_share == share
    assert clutter.stacked_share > 0


def test_stills_of_the_plate_tell_what_is_in_the_holes_and_what_hides_them(tmp_path: Path) -> None:
    folder = DataFolder(tmp_path / "new", "test")
    write_plates(PRODUCT, BENCH, SIMULATION, 3, folder, 12, lambda *_: np.array(BENCH.arm_look_rad))
    plates = load_plates([tmp_path / "new"], PRODUCT)
    holes = [hole for plate in plates for hole in plate.holes]
    assert len(plates) == 12
    assert {hole.position for hole in holes} == set(PRODUCT.positions)
    assert {hole.part for hole in holes} == {None, *PRODUCT.parts}
    assert any(not hole.upright for hole in holes)
    assert max(hole.covered for hole in holes) > 0.3
    squares = squares_m(BENCH, PRODUCT)
    for plate in plates:
        crops = hole_crops(plate.image, plate.camera, plate.world_from_camera, squares)
        for crop, hole in zip(crops, plate.holes, strict=True):
            middle = crop[:, 22:26, 22:26].mean()
            if hole.part is None and hole.covered == 0:
                assert middle < np.median(crop)


def test_parts_that_fell_onto_a_hole_rest_on_the_plate_and_lean_or_lie() -> None:
    rng = np.random.default_rng(0)
    fallen, again = (FallenParts(PRODUCT, BENCH, SIMULATION.physics, seed=3) for _ in range(2))
    for part, kind in PRODUCT.parts.items():
        rests = [fallen.draw(part, rng) for _ in range(4)]
        for rest in rests:
            assert rest is not None
            way = rest.transform(np.array([0.0, 0.0, 1.0])) - np.array(rest.position_m)
            assert way[2] < math.cos(SEATED_TILT_RAD)
            assert math.hypot(*rest.position_m[:2]) < NEAR_HOLE_M
            assert rest.position_m[2] < max(kind.size_m)
    last = list(PRODUCT.parts)[-1]  # the same whichever type is asked for first
    assert again.draw(last, np.random.default_rng(1)) == fallen.draw(last, np.random.default_rng(1))


def test_a_hole_holds_what_lies_over_it_also_what_fell_from_another() -> None:
    plate = Plate(PRODUCT, BENCH, SIMULATION, 4, lambda *_: None, astray_share=1.0)
    world, radius_m = plate.world, PRODUCT.hole_radius_m
    seen = set()
    for _ in range(60):
        still = plate.shuffle()
        placed = [body.body for body in world.bodies if body not in still.held]
        points = world.data.geom_xpos[np.isin(world.model.geom_bodyid, placed)]
        for position, (part, _) in still.holes.items():
            middle_m = plate.hole_m(position)
            over = np.hypot(*(points - middle_m)[:, :2].T) < 0.9 * radius_m
            high = np.abs(points[:, 2] - middle_m[2]) < 0.1
            if (over & high).any():  # the middle of one of a part's solids is over the opening
                seen.add(part)
                assert part is not None
    assert seen == set(PRODUCT.parts)


def test_as_many_parts_on_the_plate_are_astray_as_asked_for(tmp_path: Path) -> None:
    for share in (0.0, 1.0):
        folder = DataFolder(tmp_path / f"of {share}", "test")
        write_plates(PRODUCT, BENCH, SIMULATION, 4, folder, 3, lambda *_: None, astray_share=share)
        holes = [
            hole for plate in load_plates([tmp_path / f"of {share}"], PRODUCT) for hole in plate.holes if hole.part
        ]
        assert len(holes) > 5
        assert {hole.upright for hole in holes} == {share == 0.0}


def test_the_same_seed_gives_the_same_files_and_nothing_is_overwritten(tmp_path: Path) -> None:
    for name in ("one", "two"):
        again = record(PRODUCT, BENCH, SIMULATION, SEED)
        write_hands(Source(again, PRODUCT, BENCH), DataFolder(tmp_path / name, "test"))
    files = sorted(path.relative_to(tmp_path / "one") for path in (tmp_path / "one").rglob("*") if path.is_file())
    assert len(files) == 1 + FRAMES
    for file in files:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()
    with pytest.raises(InputError, match="not an empty folder"):
        DataFolder(tmp_path / "one", "test")


@pytest.mark.slow
def test_by_physics_too_the_robot_hands_parts_over(tmp_path: Path) -> None:
    person = SIMULATION.person.model_copy(update={"storage": Storage(handed_over=0.5)})
    settings = SIMULATION.model_copy(update={"person": person})
    taken = record(PRODUCT, BENCH, settings, 11, physics=True)
    tray = np.array(BENCH.tray.centre_m)[:2], np.array(BENCH.tray.size_m) / 2
    inside = np.all(np.abs(taken.moments[0].parts_m[:, :2] - tray[0]) < tray[1], axis=1)
    assert inside.sum() >= 2  # only the robot fetches from there
    last = holes_of(Source(taken, PRODUCT, BENCH), taken.moments[-1])
    assert {position: part for position, (part, _) in last.items()} == dict(PRODUCT.goal_placements(taken.goal))
    write_hands(Source(taken, PRODUCT, BENCH), DataFolder(tmp_path / "new", "test"), every=True)
    assert len({row["frame"] for row in rows(tmp_path / "new" / "hands.jsonl")}) == len(taken.moments)


def test_what_another_process_made_is_added_as_if_it_were_made_here(tmp_path: Path) -> None:
    picture = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)

    def write(folder: DataFolder, seed: int) -> None:
        folder.row("things", {"seed": seed, "image": folder.image(f"images/{seed}.png", picture + seed)})

    here, there = DataFolder(tmp_path / "here", "cell lab data"), DataFolder(tmp_path / "there", "cell lab data")
    for seed in (3, 4):
        write(here, seed)
        piece = DataPiece()
        write(piece, seed)
        there.add(pickle.loads(pickle.dumps(piece)))
    assert here.close({}) == there.close({})
    files = sorted(file.relative_to(tmp_path / "here") for file in (tmp_path / "here").rglob("*") if file.is_file())
    assert len(files) == 4
    assert all((tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes() for name in files)


def test_hands_high_over_the_table_are_drawn_more_often_than_they_are_seen() -> None:
    shares = shares_by_height(np.array([0.1] * 90 + [0.25] * 10))
    assert shares.sum() == pytest.approx(1.0)
    assert shares[90:].sum() == pytest.approx(0.5 * 0.5 + 0.5 * 0.1)


def test_all_frames_are_taken_once_in_their_order() -> None:
    assert [index for stretch in every_frame(100) for index in stretch] == list(range(100))
    assert every_frame(0) == []


def test_a_segment_across_lost_frames_is_as_long_and_has_no_hand_in_their_place(tmp_path: Path) -> None:
    whole = source().assembly
    lost = set(range(100, 110))
    moments = [moment for moment in whole.moments if moment.exposure.sequence not in lost]
    kept = [number for number, moment in enumerate(whole.moments) if moment in moments]

    def some(values: Sequence[Any]) -> tuple[Any, ...]:
        return tuple(values[number] for number in kept)

    fewer = replace(whole, moments=some(whole.moments), labels=some(whole.labels))
    fewer = replace(fewer, guarded=some(whole.guarded), held=some(whole.held))
    write_segments(replace(source(), assembly=fewer), DataFolder(tmp_path / "new", "test"))
    perfect = json.loads(json.dumps(hands_of(source())))
    across = 0
    for row in rows(tmp_path / "new" / "segments.jsonl"):
        first = row["frame"] - SEGMENT_FRAMES + 1
        for number, hand in enumerate(row["hands"], first):
            assert hand == (None if number in lost else perfect[number])
        across += bool(lost & set(range(first, row["frame"])))
        before = [hand for number, hand in enumerate(perfect[:first]) if hand is not None and number not in lost]
        assert row["hand_before"] == (before[-1] if before else None)
    assert across


def test_a_covered_hand_is_lost_for_as_long_as_it_is_covered() -> None:
    perfect = hands_of(source())
    covered = range(50, 150)
    visible = [0.2 if number in covered else 1.0 for number in range(len(perfect))]
    lost = [
        np.mean([hand is None for hand in as_tracked(source(), perfect, visible, np.random.default_rng(seed))[50:150]])
        for seed in range(60)
    ]
    assert 0.7 < np.mean(np.array(lost) == 1.0) < 1.0
    after = [as_tracked(source(), perfect, visible, np.random.default_rng(seed))[150] for seed in range(60)]
    assert np.mean([hand is not None for hand in after]) > 0.9
