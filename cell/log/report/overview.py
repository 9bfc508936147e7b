"""The page about a run that lasts hours: its shift, its figures and its alarms, read part by part in one go."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from cell.errors import LogError
from cell.log.read.mcap_file import statistics
from cell.log.read.reader import LogStream
from cell.log.read.ticks import LoggedTick
from cell.log.report.html_page import rendered, write_page
from cell.log.report.report import TEMPLATE, Axis
from cell.log.report.shift import shift_from
from cell.log.report.summary import Line, lines_from

LONG_S = 1200.0  # the whole of a run that is longer would fill no readable page
MOST_LINES = 2000  # of what the controller said, the last ones
WIDTH, LABELS, NARROWEST_PX = 1120, 270, 720  # as the charts of the other page, which this one has not


def is_long(parts: Sequence[Path]) -> bool:
    """Whether a log in parts holds more than a page can show."""
    spans = [(begin_s, end_s) for begin_s, end_s, _ in _spans(parts)]
    return len(spans) > 1 and max(end for _, end in spans) - min(begin for begin, _ in spans) > LONG_S


def write_overview(stream: LogStream, path: Path) -> int:
    """Write the page; returns its size in bytes.

    Raises:
        LogError: a part cannot be read, or there is no tick to tell of.
        InputError: the page cannot be written.
    """
    told = _Told(stream)
    shift = shift_from(told.ticks(), lambda: stream.result)
    if not told.count:
        raise LogError(stream.path, "holds no tick that could be reported")
    page = rendered(
        TEMPLATE,
        log=stream,
        parts=_spans(stream.parts),
        shift=shift,
        axis=Axis(told.first_s, told.last_s),
        width=WIDTH,
        labels=LABELS,
        narrowest=NARROWEST_PX,
        lines=told.lines[-MOST_LINES:],
        tiles=told.tiles(),
    )
    return write_page(page, path)


class _Told:
    """What is counted while the ticks pass."""

    def __init__(self, stream: LogStream) -> None:
        self._stream = stream
        self.count = self._late = self._helps = 0
        self.first_s = self.last_s = 0.0
        self.lines: list[Line] = []

    def ticks(self) -> Iterator[LoggedTick]:
        """All ticks, once."""
        for piece in self._stream:
            self.lines += lines_from(self._stream.path, piece.messages)
            for tick in piece.ticks:
                self.first_s = tick.time_s if not self.count else self.first_s
                self.last_s = tick.time_s
                self.count += 1
                self._late += tick.overrun
                self._helps += sum(topic == "help" for topic, _ in tick.notes)
                yield tick

    def tiles(self) -> list[tuple[str, str, str]]:
        """(caption, value, mood) of the tiles."""
        end = self._stream.outcome.get("end", "cut off")
        alarms = sum(line.count for line in self.lines if line.level != "info")
        return [
            ("outcome", end, "good" if end == "finished" else "bad"),
            ("calls for help", str(self._helps), "bad" if self._helps else ""),
            ("time", f"{(self.last_s - self.first_s) / 3600:.2f} h", ""),
            ("ticks", str(self.count), ""),
            ("overruns", str(self._late), "bad" if self._late else "good"),
            ("alarms", str(alarms), "bad" if alarms else "good"),
        ]


def _spans(parts: Sequence[Path]) -> list[tuple[float, float, Path]]:
    """(from, until, file) of the parts that say so [s]."""
    found = [(part, told) for part in parts if (told := statistics(part)) is not None]
    return [(told.message_start_time / 1e9, told.message_end_time / 1e9, part) for part, told in found]
