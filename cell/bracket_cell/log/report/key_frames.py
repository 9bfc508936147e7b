"""Pictures of the moments of a run that matter, with what the detectors found in them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from bracket_cell.log.read.frames import Frames, LoggedFrame
from bracket_cell.log.read.reader import Log
from bracket_cell.log.replay.logged_tree import logged_bench, logged_product
from bracket_cell.log.report.summary import Placed
from bracket_cell.recording.scene_frames import HoleMarks
from bracket_ground.errors import InputError, LogError, counted
from bracket_ground.interfaces.perception import BenchView, PartsView

MOST_FRAMES = 24
SAME_S = 0.5  # key frames closer than this are one
HAND_COLOUR, EMPTY_COLOUR = "#ffdc00", "#ffffff"


@dataclass(frozen=True)
class Mark:
    """A box (left, top, right, bottom), or a circle inside of one, in [px], with a label at its upper left."""

    shape: Literal["box", "circle"]
    box_px: tuple[float, float, float, float]
    label: str
    colour: str


@dataclass(frozen=True)
class KeyFrame:
    """A picture at a moment that matters."""

    time_s: float
    caption: str
    uri: str
    width_px: int
    height_px: int
    marks: tuple[Mark, ...]


def key_frames(log: Log, placed: Sequence[Placed]) -> list[KeyFrame]:
    """Pictures of begin and end, placements, screws, looks into the tray, failures and calls for help."""
    frames, marker = Frames(log), _Marker(log)
    kept: list[tuple[float, str, str]] = []
    for moment in sorted(_moments(log, placed), key=lambda moment: moment[0]):
        if kept and moment[0] - kept[-1][0] < SAME_S and moment[1] == kept[-1][1]:
            time_s, camera, caption = kept[-1]
            kept[-1] = (time_s, camera, caption if moment[2] in caption else f"{caption}; {moment[2]}")
        else:
            kept.append(moment)
    if len(kept) > MOST_FRAMES:
        kept = [kept[round(i * (len(kept) - 1) / (MOST_FRAMES - 1))] for i in range(MOST_FRAMES)]
    return [
        _key_frame(time_s, caption, frame, marker)
        for time_s, camera, caption in kept
        if (frame := frames.newest_of(camera, time_s)) is not None
    ]


def _moments(log: Log, placed: Sequence[Placed]) -> Iterator[tuple[float, str, str]]:
    """(time, camera, caption) of what is worth a picture."""
    action, parts = "", None
    yield log.ticks[0].time_s, "overhead", "begin"
    for placement in placed:
        yield placement.time_s, "overhead", f"{placement.part} at {placement.position} ({placement.source})"
    for tick in log.ticks:
        bench, seen = tick.observation.bench, tick.observation.parts
        if bench is not None and bench.action.kind != action:
            action = bench.action.kind
            if action == "screw":
                yield bench.time_s, "overhead", "the person screws"
        if seen is not None and seen is not parts:
            yield seen.time_s, "wrist", f"tray: {counted(len(seen.detections), 'part')} seen"
            parts = seen
        for topic, fields in tick.notes:
            if topic == "help":
                yield tick.time_s, "overhead", f"help: {fields.get('text')}"
            elif topic == "skill" and fields.get("status") == "failure":
                yield tick.time_s, "overhead", f"{fields.get('node')}: {fields.get('reason')}"
    yield log.ticks[-1].time_s, "overhead", "end"


def _key_frame(time_s: float, caption: str, frame: LoggedFrame, marker: _Marker) -> KeyFrame:
    height_px, width_px = frame.image().shape[:2]
    return KeyFrame(time_s, caption, frame.uri, width_px, height_px, tuple(marker.marks(frame)))


class _Marker:
    """Marks what the detectors found in a frame; views are found by the time of their frame."""

    def __init__(self, log: Log) -> None:
        self._bench: dict[int, BenchView] = {}
        self._parts: dict[int, PartsView] = {}
        for tick in log.ticks:
            if (view := tick.observation.bench) is not None:
                self._bench[_key(view.time_s)] = view
            if (parts := tick.observation.parts) is not None:
                self._parts[_key(parts.time_s)] = parts
        self._colours: dict[str | None, str] = {}
        self._holes: dict[str, tuple[float, float, float, float]] = {}
        try:
            product, bench = logged_product(log), logged_bench(log)
        except (LogError, InputError):
            return  # a log of another version is shown without holes and colours
        self._colours = {name: _hex(part.colour_rgb) for name, part in product.parts.items()}
        self._holes = HoleMarks(product, bench).boxes_px

    def marks(self, frame: LoggedFrame) -> Iterator[Mark]:
        """What was found in this very frame."""
        key = _key(frame.time_s)
        if frame.camera == "overhead" and (view := self._bench.get(key)) is not None:
            for position, hole in view.holes.items():
                if position in self._holes:
                    colour = self._colours.get(hole.part, EMPTY_COLOUR)
                    tilted = "" if hole.upright else " tilted"
                    yield Mark("circle", self._holes[position], f"{hole.part or ''}{tilted}", colour)
            if view.hand is not None:
                held = f"holds {view.hand.held_part}" if view.hand.held_part else "hand"
                yield Mark("box", view.hand.box_px, held, HAND_COLOUR)
        if frame.camera == "wrist" and (parts := self._parts.get(key)) is not None:
            for number, part in enumerate(parts.detections):
                colour = self._colours.get(part.part, HAND_COLOUR)
                yield Mark("box", part.box_px, f"{number}: {part.part}", colour)


def _key(time_s: float) -> int:
    return round(time_s * 1e6)


def _hex(rgb: tuple[float, float, float]) -> str:
    """As CSS writes it, lightened so that it shows on the part itself."""
    return "#" + "".join(f"{round(255 * (0.45 + 0.55 * channel)):02x}" for channel in rgb)
