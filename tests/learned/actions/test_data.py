"""Folders of training data become arrays; what nobody confirmed is left out, what is wrong is told with its line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.learned.actions.segments import CROP_PX, SegmentReader
from bracket_cell.learned.actions.settings import Classes
from bracket_ground.errors import InputError
from bracket_lab.learned.actions.data import inputs_of, load_segments
from tests.learned.actions.drawn import BENCH, PRODUCT, write_folder

CLASSES = Classes.of(PRODUCT)
READER = SegmentReader(BENCH, PRODUCT)


def test_inputs_are_those_of_the_files_and_vary_only_in_training(tmp_path: Path) -> None:
    segments = load_segments([write_folder(tmp_path / "some", 12, 1)], CLASSES)
    chosen = np.arange(len(segments))
    plain, crops = inputs_of(segments, chosen, READER)
    again, _ = inputs_of(segments, chosen, READER)
    varied, changed = inputs_of(segments, chosen, READER, np.random.default_rng(0))
    assert np.array_equal(plain, again)
    assert crops.shape == (12, 2, CROP_PX, CROP_PX, 3)
    assert 0.0 < np.abs(varied[:, :2] - plain[:, :2]).mean() < 0.1
    assert (changed != crops).any()
    placing = segments.classes < CLASSES.assemblies
    assert not crops[~placing, 1].any()
    red, green, blue = crops[segments.classes < 6][0][0].reshape(-1, 3).T.astype(int)
    assert (red - blue).max() > 100 > (blue - red).max()  # RGB: o1 is red
    assert green.max() < 200


def test_recorded_runs_teach_what_the_holes_confirmed(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "log", 40, 2, key="detected")
    rows = [json.loads(line) for line in (folder / "segments.jsonl").read_text().splitlines()[1:]]
    sure = [
        row for row in rows if row["detected"]["kind"] == "transit" or (row["confirmed"] or {"agrees": False})["agrees"]
    ]
    assert len(load_segments([folder], CLASSES)) == len(sure) < len(rows)


def labelled(folder: Path, **changes: object) -> tuple[list[str], list[bool]]:
    """What is learned from one segment that was detected as o1 at p2: names of classes, and whether fingers opened."""
    path = write_folder(folder, 1, 3, key="detected") / "segments.jsonl"
    header, line = path.read_text().splitlines()
    detected = {"kind": "assembly", "part": "o1", "position": "p2", "confidence": 0.9, "finished": True}
    path.write_text(f"{header}\n{json.dumps(json.loads(line) | {'detected': detected} | changes)}\n")
    found = load_segments([folder], CLASSES)
    return [CLASSES.names[number] for number in found.classes], found.released.tolist()


def test_a_label_by_hand_is_what_is_learned(tmp_path: Path) -> None:
    for number, label in enumerate(
        (
            {"part": "o3", "position": "p2"},
            {"part": "o3", "position": "p2", "seen_s": 1.0, "agrees": True},  # as it was before
            {"part": "o3", "position": "p2", "seen_s": 1.0, "agrees": False},
        )
    ):
        assert labelled(tmp_path / f"corrected{number}", confirmed=label) == (["o3 at p2"], [True])
    right = {"part": "o1", "position": "p2", "agrees": False}
    assert labelled(tmp_path / "right", confirmed=right) == (["o1 at p2"], [True])
    missed: dict[str, object] = {"detected": {"kind": "transit", "finished": False}}
    moved = {"part": "o1", "position": "p5"}
    assert labelled(tmp_path / "missed", **missed, confirmed=moved) == (["o1 at p5"], [False])
    assert labelled(tmp_path / "opened", **missed, confirmed=moved | {"released": True}) == (["o1 at p5"], [True])
    with pytest.raises(InputError, match="no labelled segments"):
        labelled(tmp_path / "empty", confirmed={"part": None, "position": "p2"})


def test_segments_of_another_pace_are_refused(tmp_path: Path) -> None:
    path = write_folder(tmp_path / "fast", 3, 3) / "segments.jsonl"
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    for row in rows[2:]:
        for hand in row["hands"]:
            hand["time_s"] /= 2  # a camera of 30 frames a second
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    with pytest.raises(InputError, match=r"segments\.jsonl:3: .*30 frames a second; the camera takes 15\n.*:4: "):
        load_segments([path.parent], CLASSES)


def test_a_key_that_is_missing_is_named_as_such(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"segments\.jsonl:2: confirmed\.position: Field required"):
        labelled(tmp_path / "some", confirmed={"part": "o1"})


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda lines: ['{"format": "cell.holes"}', *lines[1:]], "no file of segments"),
        (
            lambda lines: [lines[0].replace('"version": 1', '"version": 99'), *lines[1:]],
            "segments.jsonl:1: segments of version 99; this program reads version 1",
        ),
        (lambda lines: [lines[0], "{", *lines[2:]], "segments.jsonl:2"),
        (lambda lines: [line.replace('"part": "o', '"part": "x') for line in lines], "segments.jsonl:2: x"),
        (
            lambda lines: [lines[0], *(line.replace("0000.png", "gone.png") for line in lines[1:])],
            "gone.png: cannot be read",
        ),
        (lambda lines: lines[:1], "no labelled segments"),
    ],
)
def test_mistakes_are_told_with_file_and_line(tmp_path: Path, spoil: object, told: str) -> None:
    folder = write_folder(tmp_path / "some", 8, 3)
    path = folder / "segments.jsonl"
    path.write_text("\n".join(spoil(path.read_text().splitlines())) + "\n")  # type: ignore[operator]
    with pytest.raises(InputError, match=told):
        load_segments([folder], CLASSES)
    with pytest.raises(InputError, match="cannot be read"):
        load_segments([tmp_path], CLASSES)
