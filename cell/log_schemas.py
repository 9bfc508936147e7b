"""What the log's JSON channels hold: one small JSON schema for each topic, and plain data of our own types."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from cell.interfaces.command import Command

NUMBER = {"type": "number"}
INTEGER = {"type": "integer"}
TEXT = {"type": "string"}
FLAG = {"type": "boolean"}
LIST = {"type": "array"}
OBJECT = {"type": "object"}

_FIELDS: dict[str, dict[str, dict[str, str]]] = {
    "/tick": {"tick": INTEGER, "status": TEXT, "changes": LIST},
    "/timing": {"tick": INTEGER, "wall_s": NUMBER, "overrun": FLAG},
    "/observation": {"tick": INTEGER, "time_s": NUMBER, "arm": OBJECT, "gripper": OBJECT, "bench": INTEGER},
    "/bench": {"sequence": INTEGER, "time_s": NUMBER, "hand": OBJECT, "holes": OBJECT, "action": OBJECT},
    "/parts": {"sequence": INTEGER, "time_s": NUMBER, "detections": LIST},
    "/command": {"tick": INTEGER, "stop_arm": FLAG, "look": FLAG, "follow": OBJECT, "gripper": OBJECT},
    "/display": {"tick": INTEGER, "guidance": OBJECT, "goal_belief": OBJECT, "message": TEXT, "help_request": TEXT},
    "/note/belief": {"tick": INTEGER},
    "/note/plan": {"tick": INTEGER},
    "/note/verdict": {"tick": INTEGER, "subject": TEXT, "decision": TEXT, "reason": TEXT},
    "/note/help": {"tick": INTEGER, "text": TEXT},
    "/note/skill": {"tick": INTEGER, "node": TEXT, "status": TEXT, "reason": TEXT},
    "/can": {"id": INTEGER, "sent": FLAG, "data_hex": TEXT},
}
TOPICS = tuple(_FIELDS)


def schema(topic: str) -> dict[str, Any]:
    """JSON schema of a topic; messages may hold more than it names."""
    title = "cell." + "".join(word.capitalize() for word in topic.strip("/").split("/"))
    return {"type": "object", "title": title, "properties": _FIELDS[topic]}


def plain(value: object) -> Any:
    """Data that JSON can hold, from dataclasses, mappings, sequences, arrays and enumerations.

    Numbers that are not finite become text: JSON has no word for them.
    """
    if value is None or isinstance(value, str | bool):
        return value
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else str(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {_key(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"a log cannot hold a {type(value).__name__}: {value!r}")


def asked_of_devices(command: Command) -> dict[str, Any] | None:
    """What a tick asked of arm, gripper and wrist camera, as plain data; None for nothing."""
    moves = command.follow is not None or command.gripper is not None
    if not (moves or command.stop_arm or command.look or command.activate_gripper):
        return None
    return {
        "stop_arm": command.stop_arm,
        "look": command.look,
        "activate_gripper": command.activate_gripper,
        "follow": plain(command.follow),
        "gripper": plain(command.gripper),
    }


def _key(key: object) -> str:
    return " ".join(str(part) for part in key) if isinstance(key, tuple) else str(key)
