"""The configuration and the table of faults of a log in today's form, so that a log of any age is replayed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from cell.interfaces.devices import ROLES
from cell.interfaces.faults import OFF_PATH, OFF_PATH_LONG, SIGNALS, Fault, FaultTable
from cell.interfaces.robot import DEFAULT, FOLDER
from skills.motion.settings import MotionSettings, SeparationSettings

CONFIGURATION, ROBOT = "configuration.yaml", "robot.yaml"
OF_ROBOT = {"speed_limits_rad_s": "speed_rad_s", "acceleration_limits_rad_s2": "acceleration_rad_s2"}
OF_TOOL = {"tcp_from_tool0_m": "tcp_from_flange_m", "fingertip_beyond_tcp_m": "fingertip_beyond_tcp_m"}


def upgrade(folder: Path) -> None:
    """Rewrite the configuration of a log that was unpacked into a folder.

    Simulator and factory are left out, as a replay opens no devices; the robot is the one that was recorded.
    """
    path = folder / CONFIGURATION
    try:
        data = yaml.safe_load(path.read_text("utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError):
        return  # who loads it says what is wrong
    if not isinstance(data, dict):
        return
    devices = {role: device for role, device in (data.pop("devices", None) or {}).items() if role in ROLES}
    for key, role in (("gripper_can", "gripper"), ("signals", "signals")):
        if (settings := data.pop(key, None)) is not None:
            devices[role] = {"kind": "can", **settings}
    robot = _of_motion(data.get("motion") or {})
    if robot is not None:
        (folder / ROBOT).write_text(yaml.safe_dump(robot), "utf-8")
    if (folder / ROBOT).exists():
        data["robot"] = ROBOT
    path.write_text(yaml.safe_dump({**data, "devices": devices}), "utf-8")


def recorded_table(text: str) -> FaultTable:
    """The table of a log; signs that nobody knew when it was written do nothing in it."""
    rows = [dict(row) for row in yaml.safe_load(text)["faults"]]
    asks_s = {row["signal"]: row.pop("person_after_s", None) for row in rows}
    for row in rows:
        for key in set(row) - set(Fault.model_fields):
            del row[key]
    if (delay_s := asks_s.get(OFF_PATH)) is not None:  # a person was asked for by the same row
        off = next(row for row in rows if row["signal"] == OFF_PATH)
        rows.append({**off, "signal": OFF_PATH_LONG, "clear": "person", "delay_s": min(delay_s, 10.0)})
    unknown = set(SIGNALS) - {row["signal"] for row in rows}
    added = [{"signal": signal, "action": "run", "clear": "itself"} for signal in sorted(unknown)]
    return FaultTable.model_validate({"faults": [*rows, *added]})


def _of_motion(motion: dict[str, Any]) -> Mapping[str, Any] | None:
    """The robot that an older log describes among its motions; None where it does not.

    Its keys are taken away, and those that nobody may set any more.
    """
    limits = {OF_ROBOT[key]: motion.pop(key) for key in OF_ROBOT if key in motion}
    tool = {OF_TOOL[key]: motion.pop(key) for key in OF_TOOL if key in motion}
    for section, model in ((motion, MotionSettings), (motion.get("separation") or {}, SeparationSettings)):
        for key in set(section) - set(model.model_fields):
            del section[key]
    if not limits and not tool:
        return None
    usual = yaml.safe_load((FOLDER / f"{DEFAULT}.yaml").read_text("utf-8"))
    return {**usual, **limits, "tool": {**usual["tool"], **tool}}
