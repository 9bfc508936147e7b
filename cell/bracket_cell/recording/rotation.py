"""The files of one log: a single one, or parts that follow one another by size and by time, each readable alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import foxglove
from foxglove.mcap import MCAPWriteOptions

from bracket_cell.recording.packing import Packer
from bracket_cell.recording.parts import part_path, parts_of
from bracket_cell.recording.schemas import plain, plain_or_text
from bracket_cell.recording.sink import LogSink
from bracket_cell.settings import LogSettings
from bracket_cell.watching.observer import TickRecord
from bracket_ground.interfaces.command import Display
from btxml.engine.status import Status

CHUNK_BYTES = 64 * 1024  # and a chunk ends with every tick, so that a killed process loses none
SLACK_S = 1e-6  # times of ticks are sums of periods
FAR_BEHIND_BYTES = 1_000_000
RETRY_S = 1.0  # of clock time, where no next part could be opened
PATIENCE_S = 0.005  # how long the loop waits for the disk between two ticks


@dataclass(frozen=True)
class Heading:
    """What a log says about its run before the first tick.

    Attributes:
        metadata: seed, versions, hashes of weights and the like, as text by name.
        attachments: (media type, content) by name: tree, configuration, product.
    """

    metadata: Mapping[str, str] = field(default_factory=dict)
    attachments: Mapping[str, tuple[str, bytes]] = field(default_factory=dict)


class LogFile:
    """A file behind a bounded buffer; takes every message of its context from its opening to its end.

    Chunks are not compressed: that would cost a tick more than all else, and images, most of a log, are already.

    Attributes:
        sink: what waits for the disk, and how the disk is.
    """

    def __init__(self, path: Path, context: foxglove.Context, heading: Heading) -> None:
        """Open the file and write what every file begins with.

        Raises:
            OSError: it cannot be opened.
        """
        path.parent.mkdir(parents=True, exist_ok=True)
        self.sink = LogSink(path)
        options = MCAPWriteOptions(compression=None, chunk_size=CHUNK_BYTES, compression_threads=0, profile="cell")
        self._writer = foxglove.open_mcap(self.sink, context=context, writer_options=options)
        for name, (media_type, content) in heading.attachments.items():
            self._writer.attach(log_time=0, create_time=0, name=name, media_type=media_type, data=content)
        self.note("run", heading.metadata)

    @property
    def path(self) -> Path:
        return self.sink.path

    def note(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        self._writer.write_metadata(name, dict(values))

    def flush(self) -> None:
        """End the chunk and hand it to the sink's thread."""
        self._writer.flush()
        self.sink.hand_over()

    def close(self) -> None:
        """Write the index and wait for the disk."""
        self._writer.close()
        self.sink.close()

    def retire(self) -> None:
        """Write the index, and let the sink's thread end by itself once the disk has taken everything."""
        self._writer.close()
        self.sink.retire()


class Snapshot:
    """Follows the statuses of all nodes and the display; asks for the blackboard when it is needed.

    Args:
        blackboard: what the tree's blackboard holds now.
    """

    def __init__(self, blackboard: Callable[[], Mapping[str, object]]) -> None:
        self._blackboard = blackboard
        self._display: Display | None = None
        self._statuses: dict[str, str] = {}

    def follow(self, record: TickRecord) -> None:
        """One more tick is done."""
        self._display = record.command.display or self._display
        for change in record.changes:
            if change.new is Status.INVALID:
                self._statuses.pop(change.path, None)
            else:
                self._statuses[change.path] = change.new.name

    def forget_nodes(self) -> None:
        """Another tree takes over."""
        self._statuses.clear()

    def fields(self, tick: int) -> dict[str, Any]:
        """The message before a tick."""
        return {
            "tick": tick,
            "statuses": self._statuses,
            "blackboard": {name: plain_or_text(value) for name, value in self._blackboard().items()},
            "display": plain(self._display),
        }


class LogFiles:
    """Opens one part after the other, and takes old ones away where only some are to be kept.

    Attributes:
        rotates: whether there are parts at all.
        number: of the part that is written, from 1.
    """

    def __init__(
        self, path: Path, settings: LogSettings, context: foxglove.Context, heading: Heading, overwrite: bool = False
    ) -> None:
        """Open the first file; `overwrite` removes an earlier log of its name, with all its parts.

        Raises:
            OSError: it cannot be opened.
        """
        self.rotates = settings.rotate_mb is not None or settings.rotate_s is not None or settings.rotate_brackets
        self.number = 1
        first = part_path(path, 1) if self.rotates else path
        self._whole, self._settings, self._context, self._heading = path, settings, context, heading
        self._retired: list[LogFile] = []
        self._kept: list[Path] = []  # the parts before this one
        self._packer = Packer() if self.rotates and settings.compress else None
        self._lost_error = self._opening_error = ""
        self._began_s, self._retry_s = 0.0, float("-inf")
        if overwrite:
            for old in (path, *parts_of(path)):
                old.unlink(missing_ok=True)
        self._file = LogFile(first, context, heading)
        if self.rotates:
            self._file.note("part", {"number": "1", "first_tick": "0"})

    @property
    def path(self) -> Path:
        """The file that the log begins with, of those that are kept."""
        return self._kept[0] if self._kept else self._file.path

    @property
    def error(self) -> str:
        """Why the disk refuses, or refused for good; empty where all is well."""
        return self._refused or self._lost_error or self._opening_error

    @property
    def _refused(self) -> str:
        return next((file.sink.error for file in (self._file, *self._retired) if file.sink.error), "")

    @property
    def waiting_bytes(self) -> int:
        """Written, but not on the disk yet."""
        return sum(file.sink.waiting_bytes for file in (self._file, *self._retired))

    def due(self, time_s: float, bracket: bool = False) -> bool:
        """Whether the next tick begins a new part; never while the disk refuses or is far behind.

        Args:
            bracket: a bracket of a shift after the first begins with that tick.
        """
        if not self.rotates or time_s < self._retry_s or self.waiting_bytes > FAR_BEHIND_BYTES or self._refused:
            return False
        most_mb, most_s = self._settings.rotate_mb, self._settings.rotate_s
        if bracket and self._settings.rotate_brackets:
            return True
        large = most_mb is not None and self._file.sink.size_bytes >= most_mb * 1e6
        return large or (most_s is not None and time_s - self._began_s >= most_s - SLACK_S)

    def turn(self, time_s: float, tick: int) -> bool:
        """Open the next part, which begins with this tick; false where the disk refuses, and the old one goes on."""
        try:
            following = LogFile(part_path(self._whole, self.number + 1), self._context, self._heading)
        except OSError as error:
            self._opening_error = f"no next part: {error.strerror or error}"
            self._retry_s = time_s + RETRY_S
            return False
        self._opening_error = ""
        self._file.retire()
        self._retired.append(self._file)
        self._kept.append(self._file.path)
        self._file, self.number, self._began_s = following, self.number + 1, time_s
        following.note("part", {"number": str(self.number), "first_tick": str(tick)})
        self._sweep()
        self._retain()
        return True

    def note(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record into the part that is open."""
        self._file.note(name, values)

    def flush(self) -> None:
        """End a tick: hand it to the thread that writes it."""
        self._file.flush()
        if self._retired:
            self._sweep()

    def settle(self) -> None:
        """Wait until everything is on the disk, but not for ever."""
        self._file.sink.settle(PATIENCE_S)

    def close(self) -> None:
        """Close what is open, and wait for the disk and until all parts are packed."""
        self._file.close()
        for file in self._retired:
            file.sink.close()
        self._retired.append(self._file)
        self._sweep()
        if self._packer is not None:
            self._packer.close()
        self._retain()

    def remove(self) -> None:
        """Leave nothing behind."""
        self._packer = None
        self.close()
        for path in (*self._kept, self._file.path):
            path.unlink(missing_ok=True)

    def _sweep(self) -> None:
        """Have parts packed that are whole on the disk, and forget them; what one lost for good is remembered."""
        ended = [file for file in self._retired if file.sink.ended]
        self._lost_error = next((file.sink.error for file in ended if file.sink.error), self._lost_error)
        if self._packer is not None:
            for file in ended:
                if not file.sink.error:
                    self._packer.add(file.path)
        self._retired = [file for file in self._retired if file not in ended]

    def _retain(self) -> None:
        """Remove the oldest parts beyond what is kept; the one that is written always stays."""
        most, most_mb = self._settings.keep_parts, self._settings.keep_mb
        while self._kept and (
            (most is not None and len(self._kept) + 1 > most)
            or (most_mb is not None and sum(map(_size_bytes, self._kept)) > most_mb * 1e6)
        ):
            written = any(file.path == self._kept[0] and not file.sink.ended for file in self._retired)
            if written or (self._packer is not None and self._packer.busy(self._kept[0])):
                return  # it goes when it is written and packed
            oldest = self._kept.pop(0)
            try:
                oldest.unlink(missing_ok=True)
            except OSError as error:
                self._opening_error = f"an old part cannot be removed: {error.strerror or error}"


def _size_bytes(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:  # somebody else took it away
        return 0
