"""Segments from a log: 45 frames of hand track, the action that was detected, and what the holes showed later."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cell.interfaces.perception import SEGMENT_FRAMES, Action, BenchView, HandSample
from cell.log.reading.reader import Log
from cell.recording.schemas import plain

CARRY_S = 3.0  # a hand that has placed a part held it at most this long before: a segment's length
FLICKER_FRAMES = 3  # in a row in which the hand of a carry looks empty
STRIDE_FRAMES = 15  # one second at 15 FPS; a change of the action always ends a segment, too


@dataclass(frozen=True)
class LoggedSegment:
    """Segment s of Algorithm 1 as it was seen.

    Attributes:
        views: (SEGMENT_FRAMES,) answers to frames that follow one another without a gap.
        before: the hand as it was last seen before them.
        confirmed: the placement that the holes showed later, as plain data; None where the log does not tell.
    """

    views: tuple[BenchView, ...]
    before: HandSample | None
    confirmed: dict[str, Any] | None

    def row(self, log: str, windows: Mapping[str, str | None]) -> dict[str, Any]:
        """As a line of segments.jsonl; `windows` are the files of `hand_crop` and `hole_crop`."""
        last = self.views[-1]
        return {
            "log": log,
            "frame": last.sequence,
            "begin_s": self.views[0].time_s,
            "end_s": last.time_s,
            "detected": plain(last.action),
            "confirmed": self.confirmed,
            **windows,
            "holes": {position: hole.part for position, hole in last.holes.items()},
            "hands": [plain(view.hand) for view in self.views],
            "hand_before": plain(self.before),
        }


def bench_views(log: Log) -> list[BenchView]:
    """Every answer of the bench watcher, once."""
    found: list[BenchView] = []
    for tick in log.ticks:
        view = tick.observation.bench
        if view is not None and (not found or view.sequence != found[-1].sequence):
            found.append(view)
    return found


def segments(views: Sequence[BenchView]) -> Iterator[LoggedSegment]:
    """One segment a second, and one at every change of the action; none across frames that were lost."""
    before: HandSample | None = None
    for end in range(SEGMENT_FRAMES, len(views) + 1):
        if end > SEGMENT_FRAMES:
            before = views[end - SEGMENT_FRAMES - 1].hand or before
        window = tuple(views[end - SEGMENT_FRAMES : end])
        if window[-1].sequence - window[0].sequence != SEGMENT_FRAMES - 1:
            continue
        changed = _named(window[-1].action) != _named(window[-2].action)
        if changed or (end - SEGMENT_FRAMES) % STRIDE_FRAMES == 0:
            yield LoggedSegment(window, before, confirmed(views, end - 1))


def confirmed(views: Sequence[BenchView], at: int) -> dict[str, Any] | None:
    """What the hole of a detected assembly held when it was next seen free of the hand.

    None where no assembly was detected, or where the hole was not seen again.
    """
    action, time_s = views[at].action, views[at].time_s
    if action.kind != "assembly" or action.position is None:
        return None
    for view in views[at:]:
        hole = view.holes.get(action.position)
        if hole is not None and hole.seen_s > time_s:
            agrees = hole.part == action.part
            return {"part": hole.part, "position": action.position, "seen_s": hole.seen_s, "agrees": agrees}
    return None


def carried_parts(views: Sequence[BenchView]) -> dict[int, str]:
    """By number of the frame, the part in the hand as its hole confirmed it afterwards.

    A carry goes back as far as something was seen in the hand, but for some frames.
    """
    found: dict[int, str] = {}
    for at, view in enumerate(views):
        if view.action.kind != "assembly" or (at and _named(views[at - 1].action) == _named(view.action)):
            continue
        truth = confirmed(views, at)
        if truth is None or truth["part"] is None:
            continue
        before = [earlier for earlier in views[:at] if earlier.time_s >= view.time_s - CARRY_S]
        holding = [earlier.hand is not None and earlier.hand.held_part is not None for earlier in before]
        last = len(holding) - 1 - holding[::-1].index(True) if True in holding else -1
        while last >= 0 and any(holding[max(0, last - FLICKER_FRAMES) : last + 1]):
            found[before[last].sequence] = truth["part"]
            last -= 1
    return found


def _named(action: Action) -> tuple[object, ...]:
    return action.kind, action.part, action.position, action.finished
