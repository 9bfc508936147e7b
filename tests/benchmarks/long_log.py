"""The log of a long shift: one bracket is simulated, then recorded again and again, as fast as it goes.

python -m tests.benchmarks.long_log --hours 8

Tells memory along the way, what an hour takes on the disk, and how long a question about ten seconds in the middle
takes, in a process of its own as a user asks it.
"""

from __future__ import annotations

import argparse
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
from rich.console import Console

import bracket_cell.runs.assembled
from bracket_cell.configuration import SHIFT_PART_S, load_configuration, load_product
from bracket_cell.recording.recorder import McapRecorder
from bracket_cell.recording.rotation import Heading
from bracket_cell.recording.scene import CellModel
from bracket_cell.runs.options import RunOptions
from bracket_cell.runs.run import run
from bracket_cell.settings import LogSettings
from bracket_cell.skills.drivers.can_gripper import CanFrame
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.viewing.moments import Moments
from bracket_cell.watching.observer import Outcome, TickRecord
from bracket_cell.watching.statistics import RunStatistics
from bracket_ground.interfaces.frame import Frame

MB, HOUR_S = 1e6, 3600.0
JPEG = (cv2.IMWRITE_JPEG_QUALITY, LogSettings().jpeg_quality)
ASKED_S = 10.0
REPORTS = 8  # how often memory is told on the way
PAUSE_S = 1.0  # between two brackets
IMAGES = 100_000  # more than a bracket has: by so much the numbers of images go on

MEASURE = """
import resource, subprocess, sys, time
began_s = time.perf_counter()
answer = subprocess.run(sys.argv[1:], stdout=subprocess.PIPE)
took_s, used = time.perf_counter() - began_s, resource.getrusage(resource.RUSAGE_CHILDREN)
print(f"{took_s:.2f} {used.ru_utime + used.ru_stime:.2f} {used.ru_maxrss}", len(answer.stdout.splitlines()))
"""

Step = tuple[list[tuple[Frame, bytes]], list[CanFrame], TickRecord]


class Kept:
    """What one bracket gave the recorder: frames (already JPEG), CAN frames and ticks."""

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self._frames: list[tuple[Frame, bytes]] = []
        self._can: list[CanFrame] = []

    def frame(self, frame: Frame) -> None:
        jpeg = cv2.imencode(".jpg", cv2.cvtColor(frame.image, cv2.COLOR_RGB2BGR), JPEG)[1].tobytes()
        small = replace(frame, image=frame.image[:1, :1].copy())
        self._frames.append((small, jpeg))

    def can(self, frame: CanFrame) -> None:
        self._can.append(frame)

    def tick(self, record: TickRecord) -> None:
        self.steps.append((self._frames, self._can, record))
        self._frames, self._can = [], []

    @property
    def length_s(self) -> float:
        return self.steps[-1][2].observation.time_s + PAUSE_S


class StoredImages:
    """In place of the encoder: the images were encoded once."""

    failed = 0

    def __init__(self) -> None:
        self._jpegs: list[tuple[Frame, bytes]] = []

    def put(self, frame: Frame, jpeg: bytes) -> None:
        self._jpegs.append((frame, jpeg))

    def submit(self, frame: Frame) -> None:
        """It is there already."""

    def take(self) -> list[tuple[Frame, bytes]]:
        taken, self._jpegs = self._jpegs, []
        return taken

    take_all = take

    def close(self) -> None:
        """Nothing to end."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=8.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--limit-s", type=float, default=math.inf, help="stop recording after so long, wall time")
    parser.add_argument("--folder", type=Path, help="where the log is kept; a temporary folder by default")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="long-log-") as folder:
        log = (options.folder or Path(folder)) / "shift.mcap"
        kept = one_bracket(Path(folder), options.seed)
        middle_s = play(kept, log, options.hours, options.limit_s) / 2
        for question in (("ticks", "--all"), ("query", "--topic", "verdict"), ("query", "--node", "PlacePart")):
            ask(log, middle_s, question)
        for whole in (("log", "info"), ("log", "info", "--nodes"), ("report",)):
            ask_all(log, whole)


def one_bracket(folder: Path, seed: int) -> Kept:
    """Simulate one, from pixels, and keep what its recorder was given."""
    kept = Kept()

    class Keeping(McapRecorder):
        def frame(self, frame: Frame) -> None:
            kept.frame(frame)
            super().frame(frame)

        def can_frame(self, frame: CanFrame) -> None:
            kept.can(frame)
            super().can_frame(frame)

        def tick(self, record: TickRecord) -> None:
            kept.tick(record)
            super().tick(record)

    bracket_cell.runs.assembled.McapRecorder = Keeping  # type: ignore[attr-defined]
    options = RunOptions(seed=seed, log=folder / "one.mcap", one_process=True)
    outcome = run(options, Console(quiet=True)).outcome
    size = (folder / "one.mcap").stat().st_size
    print(f"one bracket: {outcome.end}, {kept.length_s:.1f} s, {size / MB:.2f} MB in one file")
    return kept


def play(kept: Kept, log: Path, hours: float, limit_s: float) -> float:
    """Record brackets until the time is over; returns how long the log is, in [s] of its clock."""
    settings = LogSettings(rotate_brackets=True, rotate_s=SHIFT_PART_S)
    configuration = load_configuration()
    product = load_product(configuration)
    model = CellModel(product, configuration.bench, MotionPlanner(product, configuration.bench, configuration.motion))
    recorder = McapRecorder(log, settings, Heading({"seed": "1"}), model)
    images = StoredImages()
    recorder._encoder.close()
    recorder._encoder = images  # type: ignore[assignment]
    observers = (recorder, RunStatistics(), Moments())
    brackets = max(1, round(hours * HOUR_S / kept.length_s))
    told, ticks, began_s, began_cpu_s = {brackets * (n + 1) // REPORTS for n in range(REPORTS)}, 0, *clocks()
    print(f"{brackets} brackets; memory before them {memory_mb():.1f} MB")
    for number in range(brackets):
        for frames, can, record in again(kept, number, ticks):
            for frame, jpeg in frames:
                images.put(frame, jpeg)
                for observer in observers:
                    observer.frame(frame)
            for one in can:
                recorder.can_frame(one)
            for observer in observers:
                observer.tick(record)
            recorder.settle()
            ticks += 1
        if number + 1 in told:
            print(f"  after {(number + 1) * kept.length_s / HOUR_S:5.2f} h: {memory_mb():.1f} MB", flush=True)
        if time.perf_counter() - began_s > limit_s:
            break
    wall_s, cpu_s = (now - began for now, began in zip(clocks(), (began_s, began_cpu_s), strict=True))
    length_s = (number + 1) * kept.length_s
    recorder.close(Outcome("finished", "the shift is over", ticks, 0, length_s, wall_s))
    size = sum(path.stat().st_size for path in log.parent.glob(f"{log.stem}.*.mcap"))
    per_hour = size / 1e9 / (length_s / HOUR_S)
    lacks = recorder.shortfall or "nothing"
    print(f"{ticks} ticks, {1e3 * cpu_s / ticks:.3f} ms of processor time each; the log lacks: {lacks}")
    print(f"{length_s / HOUR_S:.2f} h in {recorder.parts} parts, {size / 1e9:.2f} GB: {per_hour:.3f} GB an hour")
    return length_s


def again(kept: Kept, number: int, first_tick: int) -> Iterator[Step]:
    """The steps of one more bracket: later, with the numbers that follow; a note says that it begins."""
    later_s, views = number * kept.length_s, dict[tuple[str, int, int], Any]()

    def moved(name: str, view: Any) -> Any:
        """A later view; before the first one of a bracket the last one of the bracket before it holds."""
        number_of = number if view is not None else number - 1
        view = view if view is not None or not number else getattr(kept.steps[-1][2].observation, name)
        if view is None:
            return None
        key = name, number_of, view.sequence
        if key not in views:
            shift_s = number_of * kept.length_s
            views[key] = replace(view, sequence=view.sequence + number_of * IMAGES, time_s=view.time_s + shift_s)
        return views[key]

    for place, (frames, can, record) in enumerate(kept.steps):
        seen, joints = record.observation, record.joints
        observation = replace(
            seen,
            tick=first_tick + place,
            time_s=seen.time_s + later_s,
            arm=replace(seen.arm, time_s=seen.arm.time_s + later_s),
            gripper=replace(seen.gripper, time_s=seen.gripper.time_s + later_s),
            bench=moved("bench", seen.bench),
            parts=moved("parts", seen.parts),
        )
        notes = record.notes
        if not place:
            notes = (*notes, ("bracket", {"number": number + 1, "edge": "begin"}))
        yield (
            [(replace(frame, time_s=frame.time_s + later_s), jpeg) for frame, jpeg in frames],
            [replace(frame, time_s=frame.time_s + later_s) for frame in can],
            replace(
                record,
                observation=observation,
                notes=notes,
                joints=joints and replace(joints, times_s=joints.times_s + later_s),
            ),
        )


def ask(log: Path, from_s: float, question: tuple[str, ...]) -> None:
    """One question of a user, in a process of its own: wall time, processor time, memory."""
    span = ("--from", f"{from_s}", "--until", f"{from_s + ASKED_S}", "--json")
    command = [sys.executable, "-m", "bracket_cell", "log", question[0], str(log), *question[1:], *span]
    # Measured from a small process: a child of a large one counts its parent's memory until it has begun.
    measured = subprocess.run([sys.executable, "-c", MEASURE, *command], capture_output=True, text=True, check=True)
    took_s, cpu_s, most_kb, answers = measured.stdout.split()
    asked, memory = " ".join(question), float(most_kb) / 1e3
    print(
        f"cell log {asked}, 10 s: {answers} answers, {took_s} s, processor {cpu_s} s, {memory:.0f} MB{measured.stderr}"
    )


def ask_all(log: Path, question: tuple[str, ...]) -> None:
    """A question about the whole log, in a process of its own."""
    command = [sys.executable, "-m", "bracket_cell", *question, str(log)]
    measured = subprocess.run([sys.executable, "-c", MEASURE, *command], capture_output=True, text=True, check=True)
    took_s, cpu_s, most_kb, _ = measured.stdout.split()
    memory = float(most_kb) / 1e3
    print(f"cell {' '.join(question)}, whole: {took_s} s, processor {cpu_s} s, {memory:.0f} MB{measured.stderr}")


def memory_mb() -> float:
    """What this process holds now."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / MB


def clocks() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()


if __name__ == "__main__":
    main()
