"""`cell lab see`: what is found is drawn and told, and nothing that exists is lost."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from bracket_cell.commands.main import main
from bracket_cell.commands.terminal import BAD_INPUT
from bracket_cell.configuration import DEFAULT_CONFIGURATION, load_configuration
from bracket_ground.errors import InputError
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Pose
from bracket_lab.commands.see import _chosen, _of_hands
from bracket_lab.evaluations.detections import GREY, drawn_hands
from bracket_lab.pictures.sources import _video
from tests.cell.log.hostile import enormous
from tests.learned.classical.scenes import bench_canvas, draw_hand, in_hole
from tests.learned.hands.test_tracking import BENCH, reading

TIPS_M = (0.78, 0.2)


@pytest.fixture
def picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    canvas = bench_canvas()
    canvas.parts([in_hole("o2", "p2")])
    draw_hand(canvas, TIPS_M)
    return written(tmp_path / "bench.png", canvas.image(np.random.default_rng(3)))


def written(path: Path, image: Any) -> Path:
    path.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(path), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    return path


def see(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, Any]:
    assert main(["lab", "see", *map(str, words), "--perception", "classical", "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out.splitlines()[-1])
    return found


def test_a_picture_gives_a_picture_with_the_hand_drawn_and_told(
    picture: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = see(capsys, picture)
    (view,) = answer["frames"]
    assert np.allclose(view["hand"]["fingertips_m"], TIPS_M, atol=0.01)
    assert answer["written"] == ["bench-seen.png"]
    before, drawn = cv2.imread(str(picture)), cv2.imread("bench-seen.png")
    assert before is not None
    assert drawn is not None
    factor = drawn.shape[1] // before.shape[1]
    left, top, right, bottom = (factor * side for side in view["hand"]["box_px"])
    changed = np.abs(drawn.astype(int) - cv2.resize(before, drawn.shape[1::-1])).max(axis=2) > 40
    assert changed[top - 2 : top + 3, left:right].any(axis=0).mean() > 0.9
    assert changed[bottom + 30 :, : left - 60].mean() < 0.01


def test_all_detectors_are_taken_as_said_also_those_that_are_chosen_by_themselves() -> None:
    configured = load_configuration(DEFAULT_CONFIGURATION)
    perception = configured.perception.with_detector("holes", "plate").with_detector("hands", "mediapipe")
    own = configured.model_copy(update={"perception": perception})
    assert _chosen(own, None, None).perception.words == perception.words
    assert _chosen(own, None, "classical").perception.words == "classical"
    assert _chosen(own, "slim", "classical").perception.chosen("hands").kind == "slim"
    assert _chosen(own, "slim", "classical").perception.chosen("holes").kind == "classical"


def test_two_trackers_are_drawn_side_by_side_and_told_by_their_names(
    picture: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alone = see(capsys, picture, "--hands", "classical")
    both = see(capsys, picture, "--hands", "classical, slim", "--out", "both.png")
    assert both["frames"] == alone["frames"]
    ((beside,),) = both["beside"].values()
    assert list(both["beside"]) == ["slim"]
    assert beside["hand"] != alone["frames"][0]["hand"]
    one, two = cv2.imread("bench-seen.png"), cv2.imread("both.png")
    assert one is not None
    assert two is not None
    assert two.shape == (one.shape[0], 2 * one.shape[1], 3)
    assert (two[:, : one.shape[1]] == one).all()
    assert (two[:, one.shape[1] :] != one).any()
    assert main(["lab", "see", str(picture), "--hands", "slim,none"]) == BAD_INPUT
    assert "none" in capsys.readouterr().err


def test_what_is_read_and_not_believed_is_drawn_in_grey() -> None:
    """A person saw no hand, and not a hand of .7."""
    image = np.full((360, 480, 3), 90, np.uint8)
    frame = Frame("overhead", 0, 0.0, image, BENCH.overhead.mount.pose)
    drawn, without = (
        drawn_hands(frame, BENCH, None, (), doubtful)
        for doubtful in ([replace(reading(TIPS_M, confidence=0.7), box_px=(100, 100, 200, 180))], [])
    )
    factor = drawn.shape[1] // 480
    assert (drawn[factor * 140, factor * 100] == GREY).all()
    changed = (drawn != without).any(axis=2)
    assert changed[factor * 80 : factor * 100].any(), "its share"
    assert not changed[factor * 185 :].any()


def test_many_frames_do_not_go_into_one_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The last one would be all that is left of them."""
    out = tmp_path / "one.png"
    assert main(["lab", "see", "sim:7", "--out", str(out)]) == BAD_INPUT
    said = " ".join(capsys.readouterr().err.split())
    assert "--frames 1" in said
    assert ".mp4" in said
    assert not out.exists()


def test_nothing_is_overwritten_unasked(picture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept = written(Path("kept.png"), np.zeros((4, 4, 3), np.uint8))
    before = kept.read_bytes()
    assert main(["lab", "see", str(picture), "--out", "kept.png"]) == BAD_INPUT
    assert "--overwrite" in capsys.readouterr().err
    assert kept.read_bytes() == before
    assert main(["lab", "see", str(picture), "--out", ".", "--perception", "classical"]) == BAD_INPUT
    see(capsys, picture, "--out", "kept.png", "--overwrite")
    assert kept.read_bytes() != before


def test_a_folder_gives_a_folder_and_each_picture_stands_alone(
    picture: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = Path("many")
    for number in range(3):
        written(folder / f"{number}.png", np.full((360, 480, 3), 90, np.uint8))
    (folder / "1.png").write_bytes(picture.read_bytes())
    (folder / "notes.txt").write_text("no picture")
    answer = see(capsys, folder)
    assert [view["hand"] is not None for view in answer["frames"]] == [False, True, False]
    assert [view["file"] for view in answer["frames"]] == ["0.png", "1.png", "2.png"]
    assert answer["written"] == [f"many-seen/{number}.png" for number in range(3)]


@pytest.mark.parametrize("kind", ["learned", "classical"])
def test_a_picture_is_enough_to_see_its_holes_and_no_other_picture_counts(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What fills holes is seen in several frames of a film; the second of two equal pictures was called frozen."""
    monkeypatch.chdir(tmp_path)
    bare, filled = bench_canvas(), bench_canvas()
    filled.parts([in_hole("o2", "p2")])
    for name, canvas in (("a", bare), ("b", filled), ("c", filled)):
        written(tmp_path / "many" / f"{name}.png", canvas.image(np.random.default_rng(3)))
    written(tmp_path / "many" / "d.png", np.full((360, 480, 3), 90, np.uint8))
    assert main(["lab", "see", "many", "--perception", kind, "--json"]) == 0
    views = json.loads(capsys.readouterr().out.splitlines()[-1])["frames"]
    assert [view["holes"]["p2"]["part"] for view in views[:3]] == [None, "o2", "o2"]
    assert [len(view["holes"]) for view in views[:3]] == [6, 6, 6]
    assert [view["health"] for view in views] == ["", "", "", "without contrast"]
    assert main(["lab", "see", "many/b.png", "--perception", kind, "--json"]) == 0
    (alone,) = json.loads(capsys.readouterr().out.splitlines()[-1])["frames"]
    assert {**views[1], "sequence": 0} == {"file": "b.png", **alone}


def test_a_photograph_that_cannot_be_read_is_left_out_of_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """And one of two with the same name keeps its ending; a dot in the folder's name begins none."""
    monkeypatch.chdir(tmp_path)
    folder = Path("photos.2026")
    for name in ("a.png", "a.bmp", "c.png"):
        written(folder / name, np.full((360, 480, 3), 90, np.uint8))
    (folder / "b.jpg").write_text("no image")
    assert main(["lab", "see", str(folder), "--perception", "classical", "--json"]) == 0
    told = capsys.readouterr()
    assert [view["file"] for view in json.loads(told.out)["frames"]] == ["a.bmp", "a.png", "c.png"]
    assert json.loads(told.out)["written"] == [f"photos-2026-seen/{name}.png" for name in ("a.bmp", "a.png", "c")]
    assert f"left out: {folder / 'b.jpg'}: cannot be read as an image" in told.err


def test_an_enormous_picture_and_a_pipe_are_left_out_and_of_a_moving_one_it_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    written(Path("photos/a.png"), np.full((360, 480, 3), 90, np.uint8))
    Path("photos/b.png").write_bytes(enormous())
    os.mkfifo("photos/c.png")
    moving = cv2.Animation()
    moving.frames, moving.durations = [np.full((360, 480, 3), level, np.uint8) for level in (0, 90)], [100, 100]
    cv2.imwriteanimation("photos/d.webp", moving)
    assert main(["record", "photos", "--out", "own"]) == 0
    told = capfd.readouterr().err.splitlines()
    assert [line.split(": ")[:3] for line in told[:2]] == [
        ["cell", "left out", f"photos/{name}.png"] for name in ("b", "c")
    ]
    assert told[2] == "cell: photos/d.webp: moves: its first picture alone is taken; name the file for all"
    assert main(["record", "photos/b.png", "--out", "other"]) == 2
    assert "photos/b.png: cannot be read as an image" in capfd.readouterr().err


def test_what_is_looked_at_is_never_written_over(picture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = picture.read_bytes()
    folder = Path("many")
    written(folder / "000000.png", np.full((360, 480, 3), 90, np.uint8))
    for source, out in ((picture, "./bench.png"), (folder, "many")):
        assert main(["lab", "see", str(source), "--out", out, "--overwrite"]) == BAD_INPUT
        assert "is also the input" in capsys.readouterr().err
    assert picture.read_bytes() == before
    assert [file.name for file in folder.iterdir()] == ["000000.png"]


def test_frames_of_several_sizes_are_no_video(picture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All but those of the first size were missing in it, without a word."""
    for number, size in enumerate(((360, 480, 3), (100, 120, 3))):
        written(Path("many") / f"{number}.png", np.full(size, 90, np.uint8))
    assert main(["lab", "see", "many", "--out", "many.mp4", "--perception", "classical"]) == BAD_INPUT
    assert "several sizes" in capsys.readouterr().err
    assert not list(picture.parent.glob("*.mp4"))


def test_a_video_gives_a_video_of_the_frames_that_are_asked_for(
    picture: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image = cv2.imread(str(picture))
    assert image is not None
    video = cv2.VideoWriter("clip.mp4", cv2.VideoWriter.fourcc(*"mp4v"), 15.0, (480, 360))
    for _ in range(6):
        video.write(image)
    video.release()
    answer = see(capsys, "clip.mp4", "--frames", 5, "--every", 2)
    assert len(answer["frames"]) == 5
    assert all(view["hand"] for view in answer["frames"])
    made = cv2.VideoCapture("clip-seen.mp4")
    assert made.get(cv2.CAP_PROP_FRAME_COUNT) == 3
    assert made.get(cv2.CAP_PROP_FPS) == pytest.approx(7.5)


@pytest.mark.usefixtures("picture")
@pytest.mark.parametrize("suffix", [".gif", ".webp", ".png"])
def test_a_moving_image_is_a_video_whose_frames_come_when_they_are_shown(
    suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a moving WebP the first frame alone was seen; a rate that varies was taken for its mean."""
    moving = cv2.Animation()
    moving.frames = [np.full((48, 64, 3), level, np.uint8) for level in (0, 90, 180)]
    moving.durations = [100, 500, 100]
    cv2.imwriteanimation(f"clip{suffix}", moving)
    answer = see(capsys, f"clip{suffix}")
    assert [view["time_s"] for view in answer["frames"]] == pytest.approx([0.0, 0.1, 0.6])
    assert answer["written"] == ["clip-seen.mp4"]


@pytest.mark.parametrize("rate_hz", [0.5, 480.0])
def test_time_lapse_and_slow_motion_keep_their_rate(
    rate_hz: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They were taken for 15 frames a second: a hand then moves as fast as none, or stands."""
    monkeypatch.chdir(tmp_path)
    video = cv2.VideoWriter("clip.avi", cv2.VideoWriter.fourcc(*"MJPG"), rate_hz, (96, 72))
    for _ in range(4):
        video.write(np.zeros((72, 96, 3), np.uint8))
    video.release()
    opened = _video("clip.avi", "clip", "overhead", Pose((0.0, 0.0, 1.0)))
    assert opened.rate_hz == pytest.approx(rate_hz)
    assert [frame.time_s for frame in opened.frames] == pytest.approx([number / rate_hz for number in range(4)])


def test_how_steadily_a_hand_is_seen_is_told_of_frames_that_follow_each_other() -> None:
    def row(x: float | None) -> dict[str, Any]:
        hand = None if x is None else {"palm_m": (x / 400, 0.0)}
        return {"hand": hand, "other_hands": [], "palm_px": None if x is None else (x, 7.0)}

    even = _of_hands([row(x) for x in (0.0, 3.0, 6.0, 9.0)], follows=True)
    assert even["jitter of its palm [px]"] == {"median": 0.0, "95 %": 0.0}
    shaking = _of_hands([row(x) for x in (0.0, 2.0, 0.0, 2.0)], follows=True)
    assert shaking["jitter of its palm [px]"] == {"median": 2.0, "95 %": 2.0}
    lost = _of_hands([row(x) for x in (0.0, 0.0, None, 40.0, 0.0)], follows=True)
    assert lost["with a hand at work"] == 4
    assert lost["times that it was lost"] == 1
    assert lost["jumps of its palm over 80 mm"] == 1
    assert "jitter of its palm [px]" not in lost, "of no three frames in a row"
    assert list(_of_hands([row(0.0)], follows=False)) == ["with a hand at work", "with other hands"]


def test_a_video_whose_end_is_missing_is_seen_as_far_as_it_goes_and_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    video = cv2.VideoWriter("whole.avi", cv2.VideoWriter.fourcc(*"MJPG"), 15.0, (96, 72))
    for number in range(20):
        video.write(np.random.default_rng(number).integers(0, 255, (72, 96, 3), np.uint8))
    video.release()
    content = Path("whole.avi").read_bytes()
    Path("cut.avi").write_bytes(content[: 2 * len(content) // 3])
    words = ["--perception", "classical", "--overwrite", "--out", "seen.mp4"]
    assert main(["lab", "see", "whole.avi", *words]) == 0
    assert "ends early" not in capfd.readouterr().err
    assert main(["lab", "see", "cut.avi", *words, "--frames", "5"]) == 0
    assert "ends early" not in capfd.readouterr().err, "all that was asked for is there"
    assert main(["lab", "see", "cut.avi", *words]) == 0
    said = r"cell: cut\.avi: ends early: 0\.[89] of 1\.3 s could be read \(1\d frames\)\n"
    assert re.search(said, capfd.readouterr().err)


@pytest.mark.parametrize(
    ("told", "at_frames", "said"),
    [
        (12, range(10), True),
        (11, range(10), False),
        (0, range(10), False),
        (-2e15, range(10), False),
        (20, range(0, 20, 2), False),
    ],
)
def test_what_a_container_only_guesses_is_no_missing_end(
    told: float, at_frames: range, said: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Many count no frames: they tell how long they last, and frames may come at a varying rate."""

    class Capture:
        def __init__(self, *_: object) -> None:
            self.left, self.at = list(at_frames), 0

        def isOpened(self) -> bool:
            return True

        def get(self, what: int) -> float:
            return {cv2.CAP_PROP_FPS: 10.0, cv2.CAP_PROP_FRAME_COUNT: told, cv2.CAP_PROP_POS_MSEC: 100.0 * self.at}[
                what
            ]

        def read(self) -> tuple[bool, Any]:
            if not self.left:
                self.at = 0
                return False, None
            self.at = self.left.pop(0)
            return True, np.zeros((8, 8, 3), np.uint8)

        def release(self) -> None:
            pass

    monkeypatch.setattr(cv2, "VideoCapture", Capture)
    assert len(list(_video("a.mkv", "a", "overhead", Pose((0.0, 0.0, 1.0))).frames)) == 10
    assert ("a.mkv: ends early" in capsys.readouterr().err) == said


def test_a_codec_that_is_unknown_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """As AV1 is, in which telephones and screens are recorded today."""

    class Capture:
        def __init__(self, *_: object) -> None:
            pass

        def isOpened(self) -> bool:
            return True

        def get(self, what: int) -> float:
            return float(cv2.VideoWriter.fourcc(*"AV01")) if what == cv2.CAP_PROP_FOURCC else 30.0

        def read(self) -> tuple[bool, Any]:
            return False, None

    monkeypatch.setattr(cv2, "VideoCapture", Capture)
    with pytest.raises(InputError, match=r"a\.mp4: no frame can be read: damaged, or a codec \(AV01\)"):
        list(_video("a.mp4", "a", "overhead", Pose((0.0, 0.0, 1.0))).frames)


def test_a_list_of_other_films_is_refused(picture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("clip.mp4").write_text(f"ffconcat version 1.0\nfile {picture.name}\n")
    assert main(["lab", "see", "clip.mp4", "--perception", "classical"]) == BAD_INPUT
    assert "clip.mp4: is a list of other files, which are not opened" in capsys.readouterr().err
    assert not list(Path().glob("*seen*"))


def test_pictures_of_another_size_are_searched_for_hands_alone(
    picture: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image = cv2.imread(str(picture))
    assert image is not None
    cv2.imwrite("large.png", cv2.resize(image, (960, 720)))
    (view,) = see(capsys, "large.png")["frames"]
    assert np.allclose(view["hand"]["fingertips_m"], TIPS_M, atol=0.01)
    assert "holes" not in view


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["none.png"], "none.png: there is no such file, nor a source of that name; legal:"),
        (["empty"], "holds no images"),
        (["text.png"], "cannot be read as an image"),
        (["text.mp4"], "cannot be opened as a video"),
        (["text.txt"], "of no known kind; legal: an image, a folder"),
        (["text.txt"], ".webm, .wmv"),
        (["camera:x"], "'x' must be a whole number from 0 on, as in camera:7"),
        (["sim:-1"], "'-1' must be a whole number from 0 on, as in sim:7"),
        (["sim:1", "--camera", "wrist"], "overhead camera only"),
        (["bench.png", "--camera", "side"], "legal: overhead, wrist"),
        (["bench.png", "--perception", "best"], "legal: learned, classical"),
        (["bench.png", "--hands", "best"], "legal: slim, classical, both, mediapipe"),
        (["bench.png", "--out", "seen.gif"], "must end in"),
        (["bench.png", "--look", "hard"], "--look goes with sim:SEED"),
        (["small.png", "--camera", "wrist"], "8 x 8"),
    ],
)
def test_bad_input_is_named(picture: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str) -> None:
    Path("empty").mkdir()
    for name in ("text.png", "text.mp4", "text.txt"):
        Path(name).write_text("no picture")
    written(Path("small.png"), np.zeros((8, 8, 3), np.uint8))
    before = set(picture.parent.iterdir())
    assert main(["lab", "see", *words]) == BAD_INPUT
    assert said in capsys.readouterr().err
    assert set(picture.parent.iterdir()) == before


@pytest.mark.parametrize(
    ("name", "content"), [("text.mp4", b"no video"), ("cut.avi", b"RIFF\x10\0\0\0AVI LIST\xff\xfe")]
)
def test_a_video_that_is_none_is_told_by_us_alone(name: str, content: bytes, tmp_path: Path) -> None:
    """FFmpeg writes to standard error itself; it asks once in a process whether it may. OpenCV's reader of AVI did."""
    (tmp_path / name).write_bytes(content)
    command = [sys.executable, "-m", "bracket_cell", "record", name, "--out", "kept"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, check=False)
    assert (ended.returncode, ended.stderr.decode()) == (BAD_INPUT, f"cell: {name}: cannot be opened as a video\n")


@pytest.mark.parametrize(
    ("own", "classical"),
    [("", "actions, holes, parts"), ("parts: {kind: centre, weights: own.onnx}", "actions, holes")],
)
def test_a_product_that_no_weights_know_is_seen_by_colour_but_by_detectors_of_its_own(
    picture: Path, capsys: pytest.CaptureFixture[str], own: str, classical: str
) -> None:
    for name in ("cell.yaml", "sim.yaml", "products.yaml"):
        text = (
            DEFAULT_CONFIGURATION.with_name(name)
            .read_text("utf-8")
            .replace("  kind: learned ", f"  {own}\n  kind: learned ")
        )
        picture.with_name(name).write_text(re.sub(r"\bo1\b", "ball", text))
    assert main(["lab", "see", str(picture), "--config", "cell.yaml"]) == 0
    assert f"classical (colours, outlines): {classical}: " in capsys.readouterr().err
