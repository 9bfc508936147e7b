"""What the log's JSON channels hold: one small JSON schema for each topic, and plain data of our own types."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from bracket_cell.recording.json_schema import FLAG, INTEGER, NUMBER, OBJECT, TEXT, Schema, array, fields_of, record
from bracket_ground.interfaces.command import Command, Display, GripperCommand
from bracket_ground.interfaces.faults import SafetyDecision
from bracket_ground.interfaces.memory import Memory
from bracket_ground.interfaces.observation import LOGGED_AS, Observation
from bracket_ground.interfaces.perception import BenchView, PartsView
from btxml.engine.causes import Cause
from btxml.engine.node import StatusChange

Convert = Callable[[Any], Any]

TICKED = frozenset(("RUNNING", "SUCCESS", "FAILURE", "SKIPPED"))  # statuses of a root that was asked
DIGITS = 19  # of an integer that may need more than 64 bits
TICK = {"tick": INTEGER}
TEXTS = array(TEXT)
NUMBERS = array(NUMBER)
REASON = {"type": "object", "properties": {"signal": TEXT, "words": TEXT}}
TRAJECTORY = {"type": "object", "properties": {"times_s": NUMBERS}}  # and rows of positions_rad, one for each time

_FIELDS: dict[str, dict[str, Schema]] = {
    "/tick": {**TICK, "status": TEXT, "changes": array(record(StatusChange))},
    "/judgement": {**TICK, "action": TEXT, "share": NUMBER, "reasons": array(REASON)},
    "/timing": {**TICK, "wall_s": NUMBER, "overrun": FLAG, "observers_s": NUMBER},
    "/observation": {
        **{LOGGED_AS.get(name, name): schema for name, schema in fields_of(Observation).items()},
        **dict.fromkeys(("bench", "parts"), INTEGER),  # numbers of the answers
    },
    "/bench": fields_of(BenchView),
    "/parts": fields_of(PartsView),
    "/command": {
        **TICK, "stop_arm": FLAG, "look": FLAG, "activate_gripper": FLAG,
        "follow": TRAJECTORY, "gripper": record(GripperCommand),
        "sent_follow": TRAJECTORY, "sent_as_asked": FLAG, "sent_gripper": record(GripperCommand),
    },
    "/display": {**TICK, **fields_of(Display)},
    "/note/belief": {
        **TICK, "placed": OBJECT, "goals": OBJECT, "goal": TEXT, "edge": TEXTS, "source": TEXT, "told": TEXT,
        "denied": TEXT, "told_part": TEXTS, "taken_out": OBJECT, "replaced": OBJECT,
    },
    "/note/plan": {
        **TICK, "guidance": OBJECT, "any_part": TEXTS, "next": TEXTS, "required": INTEGER, "graspable": NUMBER,
        "solution": TEXT,
    },
    "/note/verdict": {**TICK, "subject": TEXT, "part": TEXT, "position": TEXT, "decision": TEXT, "reason": TEXT},
    "/note/help": {**TICK, "text": TEXT},
    "/note/file": {**TICK, "path": TEXT, "done": TEXT},
    "/note/outside": {
        **TICK, "node": TEXT, "question": TEXT, "polls": INTEGER, "answer": TEXT, "error": TEXT, "cancelled": FLAG,
    },
    "/note/message": {**TICK, "text": TEXT, "weight": TEXT},
    "/note/snapshot": {**TICK, "camera": TEXT, "sequence": INTEGER, "taken_s": NUMBER, "label": TEXT},
    "/note/bracket": {**TICK, "number": INTEGER, "edge": TEXT, "order": TEXT},
    "/note/memory": {**TICK, **fields_of(Memory)},
    "/note/skill": {**TICK, "node": TEXT, "status": TEXT, "reason": TEXT},
    "/note/cause": {**TICK, **fields_of(Cause)},
    "/note/why": {**TICK, "text": TEXT, "otherwise": TEXT, "held": TEXT, "guard": OBJECT, "tree": OBJECT},
    "/edit": {**TICK, "files": OBJECT},
    "/hook": {**TICK, "order": TEXT},
    "/snapshot": {**TICK, "statuses": OBJECT, "blackboard": OBJECT, "display": record(Display)},
    "/state": {**TICK, "lost": TEXT},  # the rest is lists of several kinds
    "/truth": {
        **dict.fromkeys(("kind", "act", "action", "edge", "part", "position"), TEXT),
        **dict.fromkeys(("name", "posture", "robot", "human"), TEXT),
        **dict.fromkeys(("pace", "duration_s", "speed_m_s", "relative_m_s", "first_m_s", "force_n"), NUMBER),
        **dict.fromkeys(("start_s", "end_s"), NUMBER),
        **dict.fromkeys(("position_m", "quaternion_wxyz", "point_m"), NUMBERS),
        "on": TEXTS,
    },
    "/can": {"id": INTEGER, "sent": FLAG, "data_hex": TEXT},
}  # fmt: skip
TOPICS = tuple(_FIELDS)


def schema(topic: str) -> dict[str, Any]:
    """JSON schema of a topic; messages may hold more than it names."""
    title = "cell." + "".join(word.capitalize() for word in topic.strip("/").split("/"))
    return {"type": "object", "title": title, "properties": _FIELDS[topic]}


def plain(value: object) -> Any:
    """Data that JSON can hold, from dataclasses, mappings, sequences, arrays and enumerations.

    Numbers that are not finite become text: JSON has no word for them.

    Raises:
        TypeError: a log cannot hold it.
    """
    kind = type(value)
    convert = _CONVERTERS.get(kind)
    if convert is None:
        convert = _CONVERTERS[kind] = _converter(kind)
    return convert(value)


def plain_or_text(value: object) -> Any:
    """Plain data, or the text of what has none."""
    try:
        return plain(value)
    except TypeError:
        return str(value)


def json_bytes(value: object) -> bytes:
    """Plain data as JSON that every reader takes: huge integers as text, a question mark for half characters."""
    try:
        return orjson.dumps(value)
    except orjson.JSONEncodeError:
        text = json.dumps(value, allow_nan=False, ensure_ascii=False).encode(errors="replace")
        return orjson.dumps(json.loads(text, parse_int=lambda digits: int(digits) if len(digits) < DIGITS else digits))


def tick_json(tick: int, status: str, changes: Iterable[StatusChange]) -> bytes:
    """The message of `/tick`; a change that was told before is not encoded again."""
    text = ",".join([change.json for change in changes])
    return f'{{"tick":{tick},"status":"{status}","changes":[{text}]}}'.encode()


def asked_of_devices(command: Command) -> dict[str, Any] | None:
    """What a tick asked of arm, gripper and wrist camera, as plain data; None for nothing."""
    moves = command.follow is not None or command.gripper is not None
    if not (moves or command.stop_arm or command.look or command.activate_gripper or command.signals):
        return None
    return {
        **({"signals": plain(command.signals)} if command.signals else {}),
        "stop_arm": command.stop_arm,
        "look": command.look,
        "activate_gripper": command.activate_gripper,
        "follow": plain(command.follow),
        "gripper": plain(command.gripper),
    }


def judged(judgement: SafetyDecision) -> dict[str, Any]:
    """What the supervisor allowed, as plain data."""
    reasons = [{"signal": signal, "words": words} for signal, words in judgement.reasons]
    return {"action": judgement.action.name, "share": plain(judgement.speed_scale), "reasons": reasons}


def _converter(kind: type) -> Convert:
    """How values of a type become plain data; worked out once for each type, as a tick converts hundreds."""
    if issubclass(kind, Enum):
        return lambda value: value.name
    if issubclass(kind, int | np.integer):
        return int
    if issubclass(kind, float | np.floating):
        return lambda value: float(value) if math.isfinite(value) else str(value)
    if dataclasses.is_dataclass(kind):
        return _record_converter(tuple(field.name for field in dataclasses.fields(kind)))
    if issubclass(kind, Mapping):
        return lambda value: {_key(key): plain(item) for key, item in value.items()}
    if issubclass(kind, np.ndarray):
        return _array
    if issubclass(kind, list | tuple):
        return _listed
    if issubclass(kind, str | Path):
        return str
    raise TypeError(f"a log cannot hold a {kind.__name__}")


def _record_converter(names: tuple[str, ...]) -> Convert:
    return lambda value: {name: plain(getattr(value, name)) for name in names}


def _listed(values: Sequence[Any]) -> list[Any]:
    """Rows of finite numbers, which most lists are, pass as they are."""
    if all(type(value) is float for value in values) and math.isfinite(sum(values)):
        return list(values)
    return [plain(value) for value in values]


def _array(values: Any) -> Any:
    finite = values.dtype.kind == "f" and np.isfinite(values).all()
    return values.tolist() if finite else plain(values.tolist())


_CONVERTERS: dict[type, Convert] = dict.fromkeys((type(None), str, bool, int), lambda value: value)


def _key(key: object) -> str:
    return " ".join(str(part) for part in key) if isinstance(key, tuple) else str(key)
