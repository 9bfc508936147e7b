"""Frames of the gripper (config/gripper.dbc or a file of one's own): read, and checked before anything is sent.

The registers stand where the shipped file has them; a file of one's own may have other identifiers and a finer scale.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path

import cantools.database
from cantools.database.can import Database, Message, Signal

from bracket_ground.errors import SettingError, words_of
from bracket_ground.files.files import regular, shipped
from bracket_ground.interfaces.gripper import Gripper, default_gripper, scaled

logging.getLogger("cantools").setLevel(logging.CRITICAL)

SHIPPED = shipped("bracket_cell.config", "gripper.dbc")
COMMAND, STATUS, HEARTBEAT, EMERGENCY = "GripperCommand", "GripperStatus", "GripperHeartbeat", "GripperEmergency"
# How far the physical value of a raw one may be from the shipped file's, as a gripper was measured; else exactly there.
TOLERANCES = {"rPR": 1.0, "rSP": 1.0, "rFR": 1.0, "gPR": 1.0, "gPO": 5.0, "gCU": 0.1}


def load_gripper_database(path: Path = SHIPPED, gripper: Gripper | None = None) -> Database:
    """Read the frames; the shipped ones for any gripper.

    Raises:
        SettingError: the file cannot be read, is not a DBC file, or does not say what the gripper needs;
            every problem is reported.
    """
    gripper = gripper or default_gripper()
    text = scaled(read_frames(path), gripper) if path == SHIPPED else read_frames(path)
    try:
        database = _parsed(text)
    except (cantools.Error, ValueError, KeyError) as error:
        raise _problem(path, f"is not a DBC file: {' '.join(words_of(error).split())}") from None
    if problems := [problem for wanted in _wanted(gripper).messages for problem in _problems(database, wanted)]:
        raise _problem(path, "; ".join(problems))
    return database


def read_frames(path: Path = SHIPPED) -> str:
    """The text of the file.

    Raises:
        SettingError: it cannot be read.
    """
    try:
        return regular(path).read_text(encoding="cp1252")
    except OSError as error:
        raise _problem(path, f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise _problem(path, f"is not a DBC file: byte {error.start} is not text") from None


def _parsed(text: str) -> Database:
    database = cantools.database.load_string(text, database_format="dbc")
    assert isinstance(database, Database)
    return database


def _wanted(gripper: Gripper) -> Database:
    return _parsed(scaled(read_frames(), gripper))


def _problem(path: Path, what: str) -> SettingError:
    return SettingError((("devices", "gripper", "database"), f"{path}: {what}"))


def _problems(database: Database, wanted: Message) -> Iterator[str]:
    named = [message for message in database.messages if message.name == wanted.name]
    if len(named) != 1:
        yield f"message {wanted.name} is missing" if not named else f"message {wanted.name} is there {len(named)} times"
        return
    message = named[0]
    others = [other.name for other in database.messages if other.frame_id == message.frame_id and other is not message]
    if others:
        yield f"{message.name} and {', '.join(others)} have one identifier, 0x{message.frame_id:X}"
    if message.length != wanted.length:
        yield f"{message.name} has {message.length} bytes, must be {wanted.length}"
    if message.is_extended_frame:
        yield f"{message.name} has an identifier of 29 bits, must be of 11"
    if message.is_multiplexed():
        yield f"{message.name} is multiplexed, must not be"
    signals = {signal.name: signal for signal in message.signals}
    for signal in wanted.signals:
        if signal.name not in signals:
            yield f"{message.name} has no signal {signal.name}"
        elif (found := signals[signal.name]) and _layout(found) != _layout(signal):
            yield f"{message.name}.{signal.name} is {_layout(found)}, must be {_layout(signal)}"
        elif problem := _misscaled(found, signal):
            yield f"{message.name}.{signal.name} {problem}"


def _layout(signal: Signal) -> str:
    """Where a signal stands in its frame, and how its raw value is written: as in a DBC."""
    order, sign = int(signal.byte_order == "little_endian"), "-" if signal.is_signed else "+"
    number = "float " if signal.conversion.is_float else ""
    return f"{number}{signal.start}|{signal.length}@{order}{sign}"


def _misscaled(found: Signal, wanted: Signal) -> str:
    found_ends, right = _ends(found), _ends(wanted)
    tolerance = TOLERANCES.get(wanted.name, 0.0)
    if all(abs(one - other) <= tolerance for one, other in zip(found_ends, right, strict=True)):
        return ""
    return f"runs from {found_ends[0]:g} to {found_ends[1]:g}, must run from {right[0]:g} to {right[1]:g}"


def _ends(signal: Signal) -> tuple[float, float]:
    """Physical values of the least and the greatest raw value."""
    scaled = signal.conversion.raw_to_scaled
    return float(scaled(0, decode_choices=False)), float(scaled(2**signal.length - 1, decode_choices=False))  # type: ignore[arg-type]
