"""Puts the ticks of a log together from its messages: `/observation` opens one, `/timing` closes it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import orjson
from pydantic import TypeAdapter
from pydantic_core import SchemaValidator, core_schema

from bracket_cell.log.read.mcap_file import Message
from bracket_cell.recording.json_schema import checked, with_nulls
from bracket_cell.recording.schemas import TOPICS, schema
from bracket_ground.errors import InputError, LogError, mistakes
from bracket_ground.interfaces.observation import NOBODY, ArmState, GripperState, ObjectStatus, Observation, Trouble
from bracket_ground.interfaces.operator import OperatorState
from bracket_ground.interfaces.perception import BenchView, PartsView
from btxml.engine.node import StatusChange
from btxml.engine.status import STATUSES

Note = tuple[str, dict[str, Any]]
OF_A_TICK = ("/judgement", "/tick", "/command", "/display", "/timing")
FROM_OUTSIDE = {"/edit": "edit", "/hook": "hook"}
SNAPSHOT = "/snapshot"
WRONG = (ValueError, TypeError, LookupError, AttributeError, StopIteration, InputError)  # what wrong data raise
ANY = SchemaValidator(core_schema.dict_schema())
TYPES = {topic: SchemaValidator(checked(schema(topic))) for topic in TOPICS}


@dataclass(frozen=True)
class LoggedTick:
    """One tick as it was.

    Attributes:
        observation: rebuilt bit for bit; views of bench and parts are the same object in all ticks that saw them.
        status: of the root, by name; "ERROR" where the tick raised, "STOPPING" where the run was being stopped.
        notes: (topic, fields) in order: belief, plan, verdict, help, skill.
        command: what the nodes asked of arm and gripper, and what was sent, as plain data; None for nothing.
        display: what the person was shown from this tick on, as plain data; None for no change.
        wall_s: how long the tick took on the machine that ran it.
        judgement: what the supervisor allowed, as plain data; None in logs from before it.
        state: what a replay from the next tick on needs, as plain data; None in most ticks.
        inputs: what came from outside before this tick, in order: ("edit", files of a tree that takes over in it) and
            ("hook", an order about breakpoints and overrides).
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
    inputs: tuple[Note, ...] = ()
    judgement: Mapping[str, Any] | None = None
    state: Mapping[str, Any] | None = field(default=None, compare=False)


@dataclass(frozen=True)
class Gap:
    """Ticks that are not in a log, from the first to the last."""

    first: int
    last: int

    def __str__(self) -> str:
        return (
            f"tick {self.first} is missing"
            if self.first == self.last
            else f"ticks {self.first} to {self.last} are missing"
        )


@contextmanager
def holding(log: Path, what: str) -> Iterator[None]:
    """What wrong data of a log raise in here is told in words, by its name.

    Raises:
        LogError: some did.
    """
    try:
        yield
    except WRONG as error:
        raise LogError(log, f"{what} does not hold what it should: {mistakes(error)[0]}") from None


class _Pending:
    """A tick of which not all messages have come."""

    def __init__(self, number: int, observation: Observation, inputs: tuple[Note, ...]) -> None:
        self.number = number
        self.observation = observation
        self.inputs = inputs
        self.parts: dict[str, dict[str, Any]] = {}
        self.notes: list[Note] = []
        self.state: dict[str, Any] | None = None

    def whole(self) -> LoggedTick:
        tick, timing = self.parts["/tick"], self.parts["/timing"]
        changes = tuple(
            StatusChange(row["path"], row["uid"], STATUSES[row["old"]], STATUSES[row["new"]], row["feedback"])
            for row in tick["changes"]
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
            inputs=self.inputs,
            judgement=self.parts.get("/judgement"),
            state=self.state,
        )


class TickBuilder:
    """Takes messages in the order of writing.

    Args:
        path: of the log, for messages.
        lossy: the log itself says that something is missing: what is left of half a tick is passed over, too.

    Attributes:
        done: whole ticks that were not taken away yet.
        last: number of the newest whole tick; None before the first.
        gaps: ticks that are missing between them.
        blind: how many ticks saw an answer of a detector that is missing; their observations hold None for it.
        pending: number of a tick that is not whole at the end.
    """

    def __init__(self, path: Path, lossy: bool = False) -> None:
        self.done: list[LoggedTick] = []
        self.last: int | None = None
        self.gaps: list[Gap] = []
        self.blind = 0
        self._path, self.lossy = path, lossy
        self._next: int | None = 0
        self._pending: _Pending | None = None
        self._outside: list[Note] = []
        self._bench: BenchView | None = None
        self._parts: PartsView | None = None

    @property
    def pending(self) -> int | None:
        return None if self._pending is None else self._pending.number

    def take(self, message: Message) -> None:
        """One more message.

        Raises:
            LogError: it does not fit.
        """
        topic = message.topic
        with holding(self._path, f"message of {topic} at {message.time_ns / 1e9:.3f} s"):
            if topic == "/bench":
                self._bench = _read(BenchView, _fields(topic, message.data))
            elif topic == "/parts":
                self._parts = _read(PartsView, _fields(topic, message.data))
            elif topic == "/observation":
                self._open(_fields(topic, message.data))
            elif topic in FROM_OUTSIDE:
                self._outside.append((FROM_OUTSIDE[topic], _fields(topic, message.data)))
            elif topic == "/state":
                state = _fields(topic, message.data)
                if self._pending is not None:
                    self._pending.state = state
            elif topic in OF_A_TICK or topic.startswith("/note/"):
                self._add(topic, _fields(topic, message.data))

    def begin(self, first: int | None) -> None:
        """Before the first message: the number of the first tick; None where it may be any."""
        self._next = first

    def take_away(self) -> list[LoggedTick]:
        """Whole ticks since the last call."""
        taken, self.done = self.done, []
        return taken

    def break_off(self) -> None:
        """The rest of a tick that is not whole is not there, as its file ends."""
        self._pending = None

    def _open(self, fields: dict[str, Any]) -> None:
        number = int(fields["tick"])
        if self._pending is not None:
            if not self.lossy:
                raise LogError(self._path, f"tick {self._pending.number} is not whole when tick {number} begins")
            self._pending = None
        expected = number if self._next is None else self._next
        if number < expected:
            raise LogError(self._path, f"tick {number} stands where tick {expected} should")
        if number > expected:
            self.gaps.append(Gap(expected, number - 1))
        self._next = number
        gripper = {**fields["gripper"], "object_status": ObjectStatus[fields["gripper"]["object_status"]]}
        bench, parts = self._seen(number, fields.get("bench"), fields.get("parts"))
        observation = Observation(
            tick=number,
            time_s=fields["time_s"],
            arm=_read(ArmState, fields["arm"]),
            gripper=_read(GripperState, gripper),
            bench=bench,
            parts=parts,
            troubles=tuple(Trouble(**trouble) for trouble in fields.get("troubles", ())),
            late_s=fields.get("late_s", 0.0),
            acknowledged=fields.get("acknowledged", False),
            operator=_adapter(OperatorState).validate_python(fields.get("operator", NOBODY)),
            signals=fields.get("signals", {}),
            speed_scale=fields.get("share", 1.0),
            holding_faults=tuple(fields.get("held_by", ())),
            work_s=fields.get("work_s"),
        )
        inputs = tuple((kind, answer) for kind, answer in self._outside if answer["tick"] <= number)
        self._outside = self._outside[len(inputs) :]
        self._pending = _Pending(number, observation, inputs)

    def _seen(self, number: int, bench: int | None, parts: int | None) -> tuple[BenchView | None, PartsView | None]:
        """The answers with these numbers; None for one that is lost with the ticks that are missing."""
        known_bench = self._bench if bench == (self._bench and self._bench.sequence) else None
        known_parts = self._parts if parts == (self._parts and self._parts.sequence) else None
        lost = (known_bench is None and bench is not None) or (known_parts is None and parts is not None)
        wrong = (bench is None and self._bench is not None) or (parts is None and self._parts is not None)
        if wrong or (lost and not (self.lossy or self.gaps)):
            raise LogError(self._path, f"tick {number} saw answers {bench} and {parts}, which are not in the log")
        self.blind += lost
        return known_bench, known_parts

    def _add(self, topic: str, fields: dict[str, Any]) -> None:
        number = fields.pop("tick")
        if self._pending is None or number != self._pending.number:
            if self.lossy:
                return  # of a tick that lost its beginning: it counts as missing
            raise LogError(self._path, f"a message of {topic} for tick {number} stands outside of that tick")
        if topic.startswith("/note/"):
            self._pending.notes.append((topic.removeprefix("/note/"), _with_placement(topic, fields)))
        elif topic in self._pending.parts:
            raise LogError(self._path, f"tick {number} has two messages of {topic}")
        else:
            self._pending.parts[topic] = fields
        if topic == "/timing":
            self._close(number)

    def _close(self, number: int) -> None:
        pending, self._pending = self._pending, None
        assert pending is not None
        if "/tick" in pending.parts:
            self.done.append(pending.whole())
            self.last, self._next = number, number + 1
        elif not self.lossy:
            raise LogError(self._path, f"tick {number} has no message of /tick")


def _fields(topic: str, data: bytes) -> dict[str, Any]:
    """Of a message, of the types that its topic has; reasons of a judgement are pairs in older logs."""
    found: dict[str, Any] = orjson.loads(data)
    if topic == "/judgement":
        pairs = ("signal", "words")
        found["reasons"] = [
            row if isinstance(row, dict) else dict(zip(pairs, row, strict=False)) for row in found["reasons"]
        ]
    TYPES.get(topic, ANY).validate_python(found)
    return found


def _read(kind: Any, fields: Any) -> Any:
    """A dataclass from its plain data; what was None was not written."""
    return _adapter(kind).validate_python(with_nulls(kind, fields))


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def _with_placement(topic: str, fields: dict[str, Any]) -> dict[str, Any]:
    """A note; logs of 0.12 and before have the placement of a verdict only as a text, `o1 at p2`."""
    if topic != "/note/verdict" or "part" in fields:
        return fields
    part, sign, position = str(fields.get("subject")).partition(" at ")
    return {**fields, "part": part, "position": position} if sign else fields
