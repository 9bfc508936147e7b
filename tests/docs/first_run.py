"""What `make run` prints and logs, as README shows it: the sample of its lines, and docs/assembly.webp."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.log.read.frames import Frames
from bracket_cell.log.read.reader import read_log
from tests import ROOT

Image = NDArray[np.uint8]

LINE = re.compile(r"^ *(\d+\.\d\d) s  (\w+) +(.*)$", re.MULTILINE)
SAMPLE = re.compile(r"(?:^     *\d+\.\d\d s  .*\n|^     \.\.\.\n)+", re.MULTILINE)
STORY = re.compile(r"(?:hand o\d at|robot (?:holding|carrying|placed)|goal|cell finished)")
PERIOD_S, SHOWN_MS, LAST_MS = 0.3, 75, 2500  # four times as fast as the run
SHOWN_ROWS, WIDTH_PX, BAND_PX, BAR_PX = 330, 720, 84, 110  # of the camera's image, and of the film
BAND_BGR, INK_BGR, PALE_BGR, BAR_BGR = (38, 34, 32), (240, 240, 240), (92, 86, 82), (90, 200, 120)
QUALITY = 60


@dataclass(frozen=True)
class Line:
    """What the terminal shows at a time."""

    time_s: float
    kind: str
    text: str

    def __str__(self) -> str:
        return f"    {self.time_s:6.2f} s  {self.kind:<8}  {self.text}"

    @property
    def words(self) -> str:
        """Without its figures, and so without their order."""
        return " ".join([self.kind, *sorted(re.sub(r"\d+\.\d+", "", self.text).split(", "))])


@dataclass(frozen=True)
class FirstRun:
    """The run of `make run`."""

    lines: tuple[Line, ...]
    film: bytes


@cache
def first_run() -> FirstRun:
    """Assemble that bracket."""
    settings = re.search(r"^RUN_ARGS \?= (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert settings is not None
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap"
        command = [sys.executable, "-m", "bracket_cell", "run", *settings[1].split(), "--log", str(log)]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
        lines = tuple(printed(done.stderr))
        return FirstRun(lines, film(log, lines))


def printed(text: str) -> Iterator[Line]:
    """The lines of a run in a text."""
    yield from (Line(float(time), kind, said) for time, kind, said in LINE.findall(text))


def sample(lines: Sequence[Line]) -> str:
    """The lines that tell the story up to the robot's first part, and the last one; goals only where another leads."""
    story: list[Line] = []
    leader = ""
    for line in lines:
        if not STORY.match(f"{line.kind} {line.text}") or line.text in [known.text for known in story]:
            continue
        if line.kind == "goal":
            before, leader = leader, line.text.split()[0]
            if leader == before:
                continue
        story.append(line)
    first = next(number for number, line in enumerate(story) if line.text.startswith("placed"))
    return "\n".join([*map(str, story[: first + 1]), "     ...", str(story[-1])]) + "\n"


def readme() -> str:
    """README.md with the sample of this run."""
    return SAMPLE.sub(lambda _: sample(first_run().lines), (ROOT / "README.md").read_text(), count=1)


def film(log: Path, lines: Sequence[Line]) -> bytes:
    """An animated WebP of the overhead camera; below it what hand and robot do, and which goal is believed."""
    whole = read_log(log)
    frames, end_s = Frames(whole), whole.ticks[-1].time_s
    times_s = [*np.arange(whole.ticks[0].time_s + PERIOD_S, end_s, PERIOD_S).tolist(), end_s]
    animation = cv2.Animation()
    animation.frames = [
        _picture(frame.jpeg, time_s, lines)
        for time_s in times_s
        for frame in frames.newest(time_s)
        if frame.camera == "overhead"
    ]
    animation.durations = [*[SHOWN_MS] * (len(animation.frames) - 1), LAST_MS]
    made, encoded = cv2.imencodeanimation(".webp", animation, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
    assert made
    return bytes(encoded)


def _picture(jpeg: bytes, time_s: float, lines: Sequence[Line]) -> Image:
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    height_px = SHOWN_ROWS * WIDTH_PX // image.shape[1]
    large = cv2.resize(image[:SHOWN_ROWS], (WIDTH_PX, height_px), interpolation=cv2.INTER_CUBIC)
    canvas: Image = np.full((height_px + BAND_PX, WIDTH_PX, 3), BAND_BGR, np.uint8)
    canvas[:height_px] = large
    newest = {line.kind: line.text for line in lines if line.time_s <= time_s}
    _write(canvas, f"person  {newest.get('hand', '')}", (16, height_px + 34))
    _write(canvas, f"robot   {newest.get('robot', '')}", (16, height_px + 64))
    believed = dict(re.findall(r"(g\d) (\d\.\d+)", newest.get("goal", "")))
    for number, goal in enumerate(sorted(believed)):
        left, top = WIDTH_PX - BAR_PX - 16, height_px + 14 + 22 * number
        _write(canvas, goal, (left - 30, top + 13))
        for share, colour in ((1.0, PALE_BGR), (float(believed[goal]), BAR_BGR)):
            cv2.rectangle(canvas, (left, top), (left + round(BAR_PX * share), top + 12), colour, cv2.FILLED)
    return canvas


def _write(canvas: Image, text: str, origin: tuple[int, int]) -> None:
    cv2.putText(canvas, text, origin, INK_BGR, cv2.FontFace("sans"), 17)
