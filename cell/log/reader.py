"""A log as the run that it tells of: ticks with what each one saw and decided, attachments and metadata."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from py_trees.common import Status
from pydantic import TypeAdapter, ValidationError

from cell.interfaces.errors import LogError
from cell.interfaces.observation import ArmState, GripperState, ObjectStatus, Observation
from cell.interfaces.perception import BenchView, PartsView
from cell.log.mcap_file import McapContent, Message, read_mcap
from trees.node import StatusChange

Note = tuple[str, dict[str, Any]]
OF_A_TICK = ("/tick", "/command", "/display", "/timing")


@dataclass(frozen=True)
class LoggedTick:
    """One tick as it was.

    Attributes:
        observation: rebuilt bit for bit; views of bench and parts are the same object in all ticks that saw them.
        status: of the root, by name; "ERROR" where the tick raised.
        notes: (topic, fields) in order: belief, plan, verdict, help, skill.
        command: what the nodes asked of arm and gripper, and what was sent, as plain data; None for nothing.
        display: what the person was shown from this tick on, as plain data; None for no change.
        wall_s: how long the tick took on the machine that ran it.
    """

    number: int
    time_s: float
    observation: Observation
    status: str
    changes: tuple[StatusChange, ...]
    notes: tuple[Note, ...]
    command: Mapping[str, Any] | None
    display: Mapping[str, Any] | None
    wall_s: float
    overrun: bool


@dataclass(frozen=True)
class Log:
    """A run from its log.

    Attributes:
        attachments: content by name: configuration.yaml, product.yaml, tree/*.xml.
        edited_s: when an edited tree first took over during the run, None where none did.
        metadata: seed, versions, hashes of weights and the like.
        outcome: how the run ended; empty where the log was cut off.
        ticks: in order, from 0, without gaps.
        messages: everything in the order of writing, cameras and CAN frames included.
        unfinished: what is missing at the end of a log that was not closed, else empty.
    """

    path: Path
    attachments: Mapping[str, bytes]
    metadata: Mapping[str, str]
    outcome: Mapping[str, str]
    ticks: tuple[LoggedTick, ...]
    messages: tuple[Message, ...]
    unfinished: str = ""
    edited_s: float | None = None


def read_log(path: Path) -> Log:
    """Read a whole log; one of a killed process is read up to its last whole tick and says so in `unfinished`.

    Raises:
        LogError: the file cannot be read, is no log of a run, is damaged or lacks a message in its middle.
    """
    content = read_mcap(path)
    ticks = _Ticks(path)
    for message in content.messages:
        if message.encoding == "json":
            ticks.take(message)
    return Log(
        path=path,
        attachments=content.attachments,
        metadata=content.metadata.get("run", {}),
        outcome=content.metadata.get("outcome", {}),
        ticks=tuple(ticks.done),
        messages=tuple(content.messages),
        unfinished=_unfinished(path, content, ticks),
        edited_s=min((time_ns / 1e9 for time_ns, _, _ in content.later_attachments), default=None),
    )


def _unfinished(path: Path, content: McapContent, ticks: _Ticks) -> str:
    what = content.unfinished
    if not content.unfinished and "outcome" not in content.metadata:
        what = "the run's end is not in it"
    if ticks.pending is None:
        return what
    if not what:
        raise LogError(path, f"tick {ticks.pending.number} is not whole")
    return f"{what}; tick {ticks.pending.number} is not whole and left out"


class _Pending:
    """A tick of which not all messages have come."""

    def __init__(self, number: int, observation: Observation) -> None:
        self.number = number
        self.observation = observation
        self.parts: dict[str, dict[str, Any]] = {}
        self.notes: list[Note] = []

    def whole(self) -> LoggedTick:
        tick, timing = self.parts["/tick"], self.parts["/timing"]
        changes = tuple(
            StatusChange(one["path"], one["uid"], Status[one["old"]], Status[one["new"]], one["feedback"])
            for one in tick["changes"]
        )
        return LoggedTick(
            number=self.number,
            time_s=self.observation.time_s,
            observation=self.observation,
            status=tick["status"],
            changes=changes,
            notes=tuple(self.notes),
            command=self.parts.get("/command"),
            display=self.parts.get("/display"),
            wall_s=timing["wall_s"],
            overrun=timing["overrun"],
        )


class _Ticks:
    """Puts ticks together; /observation opens one, /timing closes it."""

    def __init__(self, path: Path) -> None:
        self.done: list[LoggedTick] = []
        self.pending: _Pending | None = None
        self._path = path
        self._bench: BenchView | None = None
        self._parts: PartsView | None = None

    def take(self, message: Message) -> None:
        topic = message.topic
        try:
            fields = json.loads(message.data)
            if topic == "/bench":
                self._bench = _adapter(BenchView).validate_python(fields)
            elif topic == "/parts":
                self._parts = _adapter(PartsView).validate_python(fields)
            elif topic == "/observation":
                self._open(fields)
            elif topic in OF_A_TICK or topic.startswith("/note/"):
                self._add(topic, fields)
        except (ValueError, KeyError, TypeError, ValidationError) as error:
            what = f"message of {topic} at {message.time_ns / 1e9:.3f} s does not hold what it should"
            raise LogError(self._path, f"{what}: {type(error).__name__}: {error}") from None

    def _open(self, fields: dict[str, Any]) -> None:
        number = fields["tick"]
        if self.pending is not None:
            raise LogError(self._path, f"tick {self.pending.number} is not whole when tick {number} begins")
        if number != len(self.done):
            raise LogError(self._path, f"tick {number} stands where tick {len(self.done)} should")
        bench, parts = fields["bench"], fields["parts"]
        if bench != (self._bench and self._bench.sequence) or parts != (self._parts and self._parts.sequence):
            raise LogError(self._path, f"tick {number} saw answers {bench} and {parts}, which are not in the log")
        gripper = {**fields["gripper"], "object_status": ObjectStatus[fields["gripper"]["object_status"]]}
        observation = Observation(
            tick=number,
            time_s=fields["time_s"],
            arm=_adapter(ArmState).validate_python(fields["arm"]),
            gripper=_adapter(GripperState).validate_python(gripper),
            bench=self._bench,
            parts=self._parts,
        )
        self.pending = _Pending(number, observation)

    def _add(self, topic: str, fields: dict[str, Any]) -> None:
        number = fields.pop("tick")
        if self.pending is None or number != self.pending.number:
            raise LogError(self._path, f"a message of {topic} for tick {number} stands outside of that tick")
        if topic.startswith("/note/"):
            self.pending.notes.append((topic.removeprefix("/note/"), fields))
        elif topic in self.pending.parts:
            raise LogError(self._path, f"tick {number} has two messages of {topic}")
        else:
            self.pending.parts[topic] = fields
        if topic == "/timing":
            if "/tick" not in self.pending.parts:
                raise LogError(self._path, f"tick {number} has no message of /tick")
            self.done.append(self.pending.whole())
            self.pending = None


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)
