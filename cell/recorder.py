"""The log of a run: one MCAP file with Foxglove's schemas for images, frames and log lines (decision 12)."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import foxglove
from foxglove import messages
from foxglove.channels import CompressedImageChannel, LogChannel
from foxglove.mcap import MCAPWriteOptions

from cell.configuration import LogSettings
from cell.interfaces.errors import InputError, Place, Problem
from cell.interfaces.perception import Frame
from cell.log_schemas import TOPICS, asked_of_devices, plain, schema, tick_json
from cell.log_sink import LogSink
from cell.scene_frames import timestamp
from cell.scene_log import CellModel, SceneLog
from cell.witness import Level, Outcome, TickRecord
from skills.can_gripper import CanFrame

CHUNK_BYTES = 64 * 1024  # and a chunk ends with every tick, so that a killed process loses none
PATIENCE_S = 0.005  # how long a tick waits for the disk to take it
LEVELS = {"info": messages.LogLevel.Info, "warning": messages.LogLevel.Warning, "error": messages.LogLevel.Error}


@dataclass(frozen=True)
class Heading:
    """What a log says about its run before the first tick.

    Attributes:
        metadata: seed, versions, hashes of weights and the like, as text by name.
        attachments: (media type, content) by name: tree, configuration, product.
    """

    metadata: Mapping[str, str] = field(default_factory=dict)
    attachments: Mapping[str, tuple[str, bytes]] = field(default_factory=dict)


@dataclass
class Dropped:
    """What was left out because the disk did not keep up."""

    frames: int = 0
    ticks: int = 0
    can_frames: int = 0


class McapRecorder:
    """A witness that writes everything to a file; `log_time` is clock time.

    Attributes:
        context: of all channels; a live server serves them from there, too.
        scene: what viewers show beside them, None where the cell's model was not given.
    """

    def __init__(
        self,
        path: Path,
        settings: LogSettings,
        heading: Heading,
        cell: CellModel | None = None,
        alarm: Callable[[float, Level, str], None] = lambda *_: None,
    ) -> None:
        """Open the file.

        Args:
            cell: what viewers need to show robot and bench; None for a log without frames, bodies and overlays.
            alarm: told (clock time, level, text) when the disk refuses and when it takes bytes again.

        Raises:
            InputError: the file cannot be written.
        """
        self.path = path
        self._settings = settings
        self.context = foxglove.Context()
        self._alarm = alarm
        self._alarmed = ""
        self._sink = _open(path)
        options = MCAPWriteOptions(chunk_size=CHUNK_BYTES, compression_threads=0, profile="cell")
        self._writer = foxglove.open_mcap(self._sink, context=self.context, writer_options=options)
        self._limit_bytes = round(settings.buffer_mb * 1e6)
        self.dropped = Dropped()
        self._json = {
            topic: foxglove.Channel(topic, schema=schema(topic), message_encoding="json", context=self.context)
            for topic in TOPICS
        }
        self._log = LogChannel("/log", context=self.context)
        self.scene = None if cell is None else SceneLog(self.context, cell)
        self._images: dict[str, CompressedImageChannel] = {}
        self._bench = self._parts = -1
        self._closed = False
        for name, (media_type, content) in heading.attachments.items():
            self._writer.attach(log_time=0, create_time=0, name=name, media_type=media_type, data=content)
        self._writer.write_metadata("run", dict(heading.metadata))
        self._flush()

    @property
    def complete(self) -> bool:
        """Whether everything is in the file; asked after the end."""
        return self._closed and not self._sink.error and self.dropped == Dropped()

    def frame(self, frame: Frame) -> None:
        stamp_ns = _nanoseconds(frame.time_s)
        if self._sink.waiting_bytes > self._limit_bytes / 2:  # images go first: ticks are small and say more
            self.dropped.frames += self._settings.camera_frames
            return
        if self.scene is not None:
            self.scene.frame(frame, stamp_ns)
        if not self._settings.camera_frames:
            return
        options = [cv2.IMWRITE_JPEG_QUALITY, self._settings.jpeg_quality]
        _, jpeg = cv2.imencode(".jpg", cv2.cvtColor(frame.image, cv2.COLOR_RGB2BGR), options)
        if frame.camera not in self._images:
            self._images[frame.camera] = CompressedImageChannel(f"/camera/{frame.camera}", context=self.context)
        image = messages.CompressedImage(
            timestamp=timestamp(stamp_ns), frame_id=f"camera_{frame.camera}", data=jpeg.tobytes(), format="jpeg"
        )
        self._images[frame.camera].log(image, log_time=stamp_ns)

    def tick(self, record: TickRecord) -> None:
        observation = record.observation
        tick, stamp_ns = observation.tick, _nanoseconds(observation.time_s)
        self._watch_disk(observation.time_s)
        if self._full:
            self.dropped.ticks += 1
            return
        if observation.bench is not None and observation.bench.sequence != self._bench:
            self._bench = observation.bench.sequence
            self._write("/bench", stamp_ns, plain(observation.bench))
        if observation.parts is not None and observation.parts.sequence != self._parts:
            self._parts = observation.parts.sequence
            self._write("/parts", stamp_ns, plain(observation.parts))
        seen = {
            "tick": tick,
            "time_s": observation.time_s,
            "arm": plain(observation.arm),
            "gripper": plain(observation.gripper),
            "bench": observation.bench and self._bench,
            "parts": observation.parts and self._parts,
        }
        self._write("/observation", stamp_ns, seen)
        self._json["/tick"].log(tick_json(tick, record.status, record.changes), log_time=stamp_ns)
        for topic, fields in record.notes:
            self._write(f"/note/{topic}", stamp_ns, {"tick": tick, **plain(fields)})
        self._command(stamp_ns, record)
        self._write("/timing", stamp_ns, {"tick": tick, "wall_s": record.wall_s, "overrun": record.overrun})
        if self.scene is not None:
            self.scene.tick(record, stamp_ns)
        self._flush()

    def can_frame(self, frame: CanFrame) -> None:
        """A CAN frame went over the gripper's bus."""
        if self._full:
            self.dropped.can_frames += 1
            return
        values = {"id": frame.identifier, "sent": frame.sent, "data_hex": frame.data.hex()}
        self._write("/can", _nanoseconds(frame.time_s), values)

    def attach(self, name: str, media_type: str, content: bytes, time_s: float) -> None:
        """Add a file that came into use during the run."""
        stamp_ns = _nanoseconds(time_s)
        self._writer.attach(log_time=stamp_ns, create_time=stamp_ns, name=name, media_type=media_type, data=content)

    def message(self, time_s: float, level: Level, text: str) -> None:
        stamp_ns = _nanoseconds(time_s)
        line = messages.Log(timestamp=timestamp(stamp_ns), level=LEVELS[level], message=text, name="controller")
        self._log.log(line, log_time=stamp_ns)

    def close(self, outcome: Outcome) -> None:
        fields = ("end", "reason", "ticks", "overruns", "sim_time_s", "wall_time_s")
        self._writer.write_metadata("outcome", {name: str(getattr(outcome, name)) for name in fields})
        if self.dropped != Dropped():
            self._writer.write_metadata("dropped", {name: str(count) for name, count in vars(self.dropped).items()})
        self._writer.close()
        self._sink.close()
        self._closed = True
        if not self.complete:
            self._alarm(outcome.sim_time_s, "error", f"the log is not complete: {self.shortfall}")

    def abandon(self) -> None:
        """Leave no file behind of a run that did not begin; harmless once the log is closed."""
        if not self._closed:
            self._writer.close()
            self._sink.close()
            self._closed = True
            self.path.unlink(missing_ok=True)

    @property
    def shortfall(self) -> str:
        """What the log lacks, for people; empty where it is complete."""
        lacks = [f"{count} {name.replace('_', ' ')} dropped" for name, count in vars(self.dropped).items() if count]
        return "; ".join([*([self._sink.error] if self._sink.error else []), *lacks])

    @property
    def _full(self) -> bool:
        return self._sink.waiting_bytes > self._limit_bytes

    def _flush(self) -> None:
        self._writer.flush()
        self._sink.hand_over(PATIENCE_S)

    def _watch_disk(self, time_s: float) -> None:
        """Tell once that the disk refuses, and once that it takes bytes again."""
        error = self._sink.error
        if bool(error) == bool(self._alarmed):
            return
        self._alarmed = error
        level: Level = "error" if error else "info"
        text = f"the log cannot be written: {error}; the cell goes on" if error else "the log is written again"
        self._alarm(time_s, level, text)
        if not self._full:
            self.message(time_s, level, text)

    def _command(self, stamp_ns: int, record: TickRecord) -> None:
        command = record.command
        if command.display is not None:
            self._write("/display", stamp_ns, {"tick": record.observation.tick, **plain(command.display)})
        asked = asked_of_devices(command)
        if asked is None:
            return
        values = {
            "tick": record.observation.tick,
            **asked,
            "sent_follow": "as asked" if record.sent.trajectory is command.follow else plain(record.sent.trajectory),
            "sent_gripper": plain(record.sent.gripper),
        }
        self._write("/command", stamp_ns, values)

    def _write(self, topic: str, stamp_ns: int, values: dict[str, object]) -> None:
        self._json[topic].log(json.dumps(values, allow_nan=False).encode(), log_time=stamp_ns)


def _open(path: Path) -> LogSink:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return LogSink(path)
    except OSError as error:
        problem = Problem(
            Place(path), f"the log cannot be written: {error.strerror or error}", "choose a path by --log"
        )
        raise InputError(problem) from None


def _nanoseconds(time_s: float) -> int:
    return round(time_s * 1e9)
