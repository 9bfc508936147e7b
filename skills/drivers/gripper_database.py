"""Frames of the gripper (config/gripper.dbc or a file of one's own): read, and checked before anything is sent."""

from __future__ import annotations

from pathlib import Path

import cantools.database
from cantools.database.can import Database, Message

from cell.errors import SettingError
from cell.files.files import shipped

SHIPPED = shipped("config", "gripper.dbc")
COMMAND, STATUS, HEARTBEAT, EMERGENCY = "GripperCommand", "GripperStatus", "GripperHeartbeat", "GripperEmergency"
SIGNALS: dict[str, tuple[str, ...]] = {
    COMMAND: ("rACT", "rGTO", "rATR", "rARD", "rPR", "rSP", "rFR"),
    STATUS: ("gACT", "gGTO", "gSTA", "gOBJ", "gFLT", "gPR", "gPO", "gCU"),
    HEARTBEAT: ("NodeState",),
    EMERGENCY: ("ErrorCode", "ErrorRegister", "FaultStatus"),
}
LENGTHS = {COMMAND: 8, STATUS: 8, HEARTBEAT: 1, EMERGENCY: 8}
# (message, signal): physical values of the raw values 0 and 255, by the 2F-85's manual, and the greatest deviation
SCALES: dict[tuple[str, str], tuple[float, float, float]] = {
    (COMMAND, "rPR"): (85.0, 0.0, 1.0),
    (COMMAND, "rSP"): (20.0, 150.0, 1.0),
    (COMMAND, "rFR"): (20.0, 235.0, 1.0),
    (STATUS, "gPR"): (85.0, 0.0, 1.0),
    (STATUS, "gPO"): (85.0, 0.0, 5.0),
    (STATUS, "gCU"): (0.0, 2.55, 0.1),
}


def load_gripper_database(path: Path = SHIPPED) -> Database:
    """Read the frames.

    Raises:
        SettingError: the file cannot be read, is not a DBC file, or does not say what a 2F-85 needs;
            every problem is reported.
    """
    text = read_frames(path)
    try:
        database = cantools.database.load_string(text, database_format="dbc")
    except (cantools.Error, UnicodeDecodeError, ValueError, KeyError) as error:
        raise _problem(
            path, f"is not a DBC file: {str(error).splitlines()[0] if str(error) else type(error).__name__}"
        ) from None
    assert isinstance(database, Database)
    if problems := [problem for name in SIGNALS for problem in _problems(database, name)]:
        raise _problem(path, "; ".join(problems))
    return database


def read_frames(path: Path = SHIPPED) -> str:
    """The text of the file.

    Raises:
        SettingError: it cannot be read.
    """
    try:
        return path.read_text(encoding="cp1252")
    except OSError as error:
        raise _problem(path, f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise _problem(path, f"is not a DBC file: byte {error.start} is not text") from None


def _problem(path: Path, what: str) -> SettingError:
    return SettingError((("devices", "gripper", "database"), f"{path}: {what}"))


def _problems(database: Database, name: str) -> list[str]:
    message = next((message for message in database.messages if message.name == name), None)
    if message is None:
        return [f"message {name} is missing"]
    missing = [signal for signal in SIGNALS[name] if signal not in message.signal_tree]
    problems = [f"{name} has no signal {signal}" for signal in missing]
    if message.length != LENGTHS[name]:
        problems.append(f"{name} has {message.length} bytes, must be {LENGTHS[name]}")
    scaled = [(signal, scale) for (owner, signal), scale in SCALES.items() if owner == name and signal not in missing]
    return problems + [problem for signal, scale in scaled if (problem := _misscaled(message, signal, scale))]


def _misscaled(message: Message, name: str, scale: tuple[float, float, float]) -> str | None:
    signal = message.get_signal_by_name(name)
    first, last, tolerance = scale
    low, high = (float(signal.conversion.raw_to_scaled(raw, decode_choices=False)) for raw in (0, 255))  # type: ignore[arg-type]
    if signal.length != 8 or abs(low - first) > tolerance or abs(high - last) > tolerance:
        return f"{message.name}.{name} runs from {low:g} to {high:g}, must run from {first:g} to {last:g} over one byte"
    return None
