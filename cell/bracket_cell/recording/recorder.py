"""The log of a run: MCAP with Foxglove's schemas for images, frames and log lines."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import foxglove
from foxglove import messages
from foxglove.channels import CompressedImageChannel, LogChannel

from bracket_cell.recording import identity as digest
from bracket_cell.recording import joint_samples
from bracket_cell.recording.images import Files, ImageEncoder
from bracket_cell.recording.json_schema import without_nulls
from bracket_cell.recording.rotation import Heading as Heading  # who opens a recorder needs it
from bracket_cell.recording.rotation import LogFiles, Snapshot
from bracket_cell.recording.scene import CAMERAS, CellModel, SceneLog
from bracket_cell.recording.scene_frames import timestamp
from bracket_cell.recording.schemas import (
    TICKED,
    TOPICS,
    asked_of_devices,
    json_bytes,
    judged,
    plain,
    schema,
    tick_json,
)
from bracket_cell.settings import LogSettings
from bracket_cell.skills.drivers.can_gripper import CanFrame
from bracket_cell.watching.observer import Level, Observer, Outcome, TickRecord
from bracket_cell.watching.work_state import WorkState
from bracket_ground.errors import InputError, Place, Problem
from bracket_ground.interfaces.devices import TruthEvent
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import LOGGED_AS, NOBODY, Observation
from bracket_ground.interfaces.perception import BenchView, PartsView

USUALLY_NOTHING = ("troubles", "late_s", "acknowledged", "operator", "signals", "holding_faults")  # mostly absent
LEVELS = {"info": messages.LogLevel.Info, "warning": messages.LogLevel.Warning, "error": messages.LogLevel.Error}


@dataclass
class Dropped:
    """What was left out: the disk did not keep up, or a frame's image could not be made."""

    frames: int = 0
    ticks: int = 0
    can_frames: int = 0


class McapRecorder(Observer):
    """An observer that writes everything to a file; `log_time` is clock time.

    Attributes:
        context: of all channels; a live server serves them from there, too.
        scene: what viewers show beside them, None where the cell's model was not given.
        state: what a replay from the next tick on needs; kept at the beginning of each part and of each bracket.
        why: why the robot does what it does after a tick, in plain data; noted where its text changes.

    Args:
        in_step: time stands while a tick runs, as in simulation, so it may wait for images: the same run writes
            the same file. Beside a real cell no tick waits.
        cell: what viewers need to show robot and bench; None for a log without frames, bodies and overlays.
        alarm: told (clock time, level, text) when the disk refuses and when it takes bytes again.
        blackboard: what the tree's blackboard holds, for the beginning of each part of a rotated log.
        result: how the job was done, by name, asked for at the end; kept as JSON in the metadata `result`.
        overwrite: an earlier log of this name goes, with all its parts; otherwise it is refused.
        truth: what really happened since the last call, where the devices know it.

    Raises:
        InputError: the file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        settings: LogSettings,
        heading: Heading,
        cell: CellModel | None = None,
        alarm: Callable[[float, Level, str], None] = lambda *_: None,
        blackboard: Callable[[], Mapping[str, object]] = dict,
        truth: Callable[[], Sequence[TruthEvent]] = tuple,
        result: Callable[[], Mapping[str, object]] = dict,
        in_step: bool = True,
        overwrite: bool = False,
    ) -> None:
        self.context = foxglove.Context()
        self.state: Callable[[], Mapping[str, object]] = dict
        self.why: Callable[[], Mapping[str, object]] = dict
        self._told: Mapping[str, object] = {}
        self._work, self._ticked_s = WorkState(), 0.0
        self._settings = settings
        self._result = result
        self._alarm = alarm
        self._alarmed = ""
        self._files = _open(path, settings, self.context, heading, overwrite)
        self._limit_bytes = round(settings.buffer_mb * 1e6)
        self.dropped = Dropped()
        self._open_channels(joint_samples.ANY[:6] if cell is None else cell.motion.settings.robot.joints)
        self.scene = None if cell is None else SceneLog(self.context, cell)
        self._encoder = ImageEncoder(settings.jpeg_quality, in_step)
        self._bench: BenchView | None = None
        self._parts: PartsView | None = None
        self._digest = digest.InputDigest()
        self._snapshot = Snapshot(blackboard)
        self._truth = truth
        self._can: list[CanFrame] = []
        self._tick = 0
        self._closed = False
        self._files.flush()

    def _open_channels(self, joints: Sequence[str]) -> None:
        self._json = {
            topic: foxglove.Channel(topic, schema=schema(topic), message_encoding="json", context=self.context)
            for topic in TOPICS
        }
        self._log = LogChannel("/log", context=self.context)
        self._joints = foxglove.Channel(
            joint_samples.TOPIC, schema=joint_samples.schema(joints), message_encoding="protobuf", context=self.context
        )
        topics = [f"/camera/{camera}" for camera in CAMERAS]
        self._images = {topic: CompressedImageChannel(topic, context=self.context) for topic in topics}

    @property
    def path(self) -> Path:
        """The file that the log begins with."""
        return self._files.path

    @property
    def parts(self) -> int:
        """How many files were begun."""
        return self._files.number

    @property
    def complete(self) -> bool:
        """Whether everything is in the file; asked after the end."""
        return self._closed and not self.shortfall

    @property
    def shortfall(self) -> str:
        """What the log lacks, for people; empty where it is complete."""
        lacks = [f"{count} {name.replace('_', ' ')} dropped" for name, count in vars(self.dropped).items() if count]
        return "; ".join([*([self._files.error] if self._files.error else []), *lacks])

    def frame(self, frame: Frame) -> None:
        if self._files.waiting_bytes > self._limit_bytes / 2:  # images go first: ticks are small and say more
            self.dropped.frames += self._settings.camera_frames
            return
        if self.scene is not None:
            self.scene.frame(frame, _nanoseconds(frame.time_s))
        if self._settings.camera_frames:
            self._encoder.submit(frame)

    def tick(self, record: TickRecord) -> None:
        observation = record.observation
        tick, stamp_ns = observation.tick, _nanoseconds(observation.time_s)
        begins = _next_bracket(record)
        turned = self._files.due(observation.time_s, begins) and self._turn(observation.time_s, tick)
        self._tick = tick + 1
        self._watch_disk(observation.time_s)
        if self._full:
            self.dropped.ticks += 1
            self.dropped.can_frames += len(self._can)
            self._can.clear()
            return
        self._write_collected(self._encoder.take())
        self._observe(observation, stamp_ns)
        if record.judgement is not None:
            self._write("/judgement", stamp_ns, {"tick": tick, **judged(record.judgement)})
        self._json["/tick"].log(tick_json(tick, record.status, record.changes), log_time=stamp_ns)
        for topic, fields in record.notes:
            self._write(f"/note/{topic}", stamp_ns, {"tick": tick, **plain(fields)})
        self._work.see(record)
        self._ticked_s = observation.time_s if record.status in TICKED else self._ticked_s
        if record.status in TICKED and (why := self.why()):
            if turned or why["text"] != self._told.get("text"):
                self._write("/note/why", stamp_ns, {"tick": tick, **why})
            self._told = why
        self._command(stamp_ns, record)
        if (turned or (begins and self._files.rotates)) and (state := self.state()):
            self._json["/state"].log(json_bytes({"tick": tick, **state}), log_time=stamp_ns)
        self._write("/timing", stamp_ns, self._took(record))
        if record.joints is not None and len(record.joints.times_s) and self._settings.joint_samples:
            self._joints.log(joint_samples.encode(record.joints), log_time=stamp_ns)
        if self.scene is not None:
            self.scene.tick(record, stamp_ns)
        if self._files.rotates:
            self._snapshot.follow(record)
        self._files.flush()

    def can_frame(self, frame: CanFrame) -> None:
        """A CAN frame went over the gripper's bus; it is written with the tick."""
        self._can.append(frame)

    def settle(self) -> None:
        """Wait until the ticks so far are on the disk, but not for ever: between two ticks, beside the physics.

        A process that is killed afterwards has them all in its log.
        """
        self._files.settle()

    def edited(self, texts: Mapping[str, str], time_s: float) -> None:
        """An edited tree takes over in the tick under way; texts by the files' names."""
        self._snapshot.forget_nodes()
        self._write("/edit", _nanoseconds(time_s), {"tick": self._tick, "files": dict(texts)})

    def hooked(self, order: str, body: object, time_s: float) -> None:
        """A monitor put hooks on nodes or took them away; it acts from the next tick on."""
        self._write("/hook", _nanoseconds(time_s), {"tick": self._tick, "order": order, "body": plain(body)})

    def message(self, time_s: float, level: Level, text: str) -> None:
        stamp_ns = _nanoseconds(time_s)
        line = messages.Log(timestamp=timestamp(stamp_ns), level=LEVELS[level], message=text, name="controller")
        self._log.log(line, log_time=stamp_ns)

    def close(self, outcome: Outcome) -> None:
        self._write_collected(self._encoder.take_all())
        self._encoder.close()
        self.dropped.frames += self._encoder.failed
        fields = ("end", "reason", "condition", "ticks", "overruns", "sim_time_s", "wall_time_s")
        values = {name: str(getattr(outcome, name)) for name in fields}
        if outcome.end != "finished":
            values |= {"state": self._work.name, "failed_s": f"{self._ticked_s:.3f}"}
        if outcome.why is not None:
            values |= {
                "cause": outcome.cause,
                "why": json_bytes(outcome.why.plain() | {"causes": self._told.get("causes", ())}).decode(),
            }
        self._files.note("outcome", {**values, digest.NAME: self._digest.text()})
        self._files.note("result", {name: json_bytes(plain(value)).decode() for name, value in self._result().items()})
        if self.dropped != Dropped():
            self._files.note("dropped", {name: str(count) for name, count in vars(self.dropped).items()})
        self._files.close()
        self._closed = True
        if not self.complete:
            self._alarm(outcome.sim_time_s, "error", f"the log is not complete: {self.shortfall}")

    def abandon(self) -> None:
        """Leave no file behind of a run that did not begin; harmless once the log is closed."""
        if not self._closed:
            self._encoder.close()
            self._files.remove()
            self._closed = True

    @property
    def _full(self) -> bool:
        return self._files.waiting_bytes > self._limit_bytes

    def _watch_disk(self, time_s: float) -> None:
        """Tell once that the disk refuses, and once that it takes bytes again."""
        error = self._files.error
        if bool(error) == bool(self._alarmed):
            return
        self._alarmed = error
        level: Level = "error" if error else "info"
        text = f"the log cannot be written: {error}; the cell goes on" if error else "the log is written again"
        self._alarm(time_s, level, text)
        if not self._full:
            self.message(time_s, level, text)

    def _turn(self, time_s: float, tick: int) -> bool:
        """Begin a part with what a reader of this part alone must know; `/snapshot` ends it."""
        if not self._files.turn(time_s, tick):
            return False
        stamp_ns = _nanoseconds(time_s)
        for topic, view in (("/bench", self._bench), ("/parts", self._parts)):
            if view is not None:
                self._write(topic, stamp_ns, plain(view))
        if self.scene is not None:
            self.scene.repeat_all(stamp_ns)
        self._write("/snapshot", stamp_ns, self._snapshot.fields(tick))
        return True

    def _observe(self, seen: Observation, stamp_ns: int) -> None:
        """What the tick saw; answers of detectors only where they are new."""
        if seen.bench is not None and (self._bench is None or seen.bench.sequence != self._bench.sequence):
            self._bench = seen.bench
            self._saw("/bench", stamp_ns, plain(seen.bench))
        if seen.parts is not None and (self._parts is None or seen.parts.sequence != self._parts.sequence):
            self._parts = seen.parts
            self._saw("/parts", stamp_ns, plain(seen.parts))
        values = {
            "tick": seen.tick,
            "time_s": seen.time_s,
            "arm": plain(seen.arm),
            "gripper": plain(seen.gripper),
            "bench": seen.bench and seen.bench.sequence,
            "parts": seen.parts and seen.parts.sequence,
            "share": seen.speed_scale,
            "work_s": seen.work_s,
            **{LOGGED_AS.get(n, n): plain(v) for n in USUALLY_NOTHING if (v := getattr(seen, n)) and v != NOBODY},
        }
        self._saw("/observation", stamp_ns, values)

    def _took(self, record: TickRecord) -> dict[str, Any]:
        """How long the tick took, and the observers of the tick before it: this one's are not over yet."""
        times = {"wall_s": record.wall_s, "overrun": record.overrun, "observers_s": record.observers_s}
        return {"tick": record.observation.tick, **times}

    def _command(self, stamp_ns: int, record: TickRecord) -> None:
        command = record.command
        if command.display is not None:
            self._write("/display", stamp_ns, {"tick": record.observation.tick, **plain(command.display)})
        asked = asked_of_devices(command)
        if asked is None:
            return
        as_asked = record.sent.trajectory is command.follow
        values = {
            "tick": record.observation.tick,
            **asked,
            "sent_follow": None if as_asked else plain(record.sent.trajectory),
            "sent_as_asked": as_asked,
            "sent_gripper": plain(record.sent.gripper),
        }
        self._write("/command", stamp_ns, values)

    def _write_collected(self, images: list[tuple[Frame, Files]]) -> None:
        """CAN frames and truth since the last tick, and images of earlier ticks: they have been encoded meanwhile."""
        for can in self._can:
            values = {"id": can.identifier, "sent": can.sent, "data_hex": can.data.hex()}
            self._write("/can", _nanoseconds(can.time_s), values)
        self._can.clear()
        for event in self._truth():
            self._write("/truth", _nanoseconds(event.time_s), {"kind": event.kind, **plain(event.fields)})
        for frame, (jpeg, png) in images:
            self._write_image(f"/camera/{frame.camera}", frame, jpeg, "jpeg")
            if png:
                self._write_image(f"/depth/{frame.camera}", frame, png, "png")

    def _write_image(self, topic: str, frame: Frame, data: bytes, kind: str) -> None:
        if topic not in self._images:
            self._images[topic] = CompressedImageChannel(topic, context=self.context)
        stamp_ns = _nanoseconds(frame.time_s)
        image = messages.CompressedImage(
            timestamp=timestamp(stamp_ns), frame_id=f"camera_{frame.camera}", data=data, format=kind
        )
        self._images[topic].log(image, log_time=stamp_ns)

    def _saw(self, topic: str, stamp_ns: int, values: dict[str, Any]) -> None:
        self._digest.add(topic, self._write(topic, stamp_ns, values))

    def _write(self, topic: str, stamp_ns: int, values: dict[str, Any]) -> bytes:
        content = json_bytes(without_nulls(values))
        self._json[topic].log(content, log_time=stamp_ns)
        return content


def _open(path: Path, settings: LogSettings, context: foxglove.Context, heading: Heading, overwrite: bool) -> LogFiles:
    try:
        return LogFiles(path, settings, context, heading, overwrite)
    except OSError as error:
        problem = Problem(
            Place(path), f"the log cannot be written: {error.strerror or error}", "choose a path with --log"
        )
        raise InputError(problem) from None


def _next_bracket(record: TickRecord) -> bool:
    """Whether a bracket begins that is not the first one."""
    return any(
        topic == "bracket" and fields.get("edge") == "begin" and fields.get("number") != 1 and "resumed" not in fields
        for topic, fields in record.notes
    )


def _nanoseconds(time_s: float) -> int:
    return round(time_s * 1e9)
