"""The safety configuration: everything in a cell's files that decides on people, as values with one hash."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any

from bracket_cell.configuration import Configuration, load_configuration, load_faults, load_product, located
from bracket_cell.skills.motion.collision import standing_m
from bracket_cell.skills.motion.contact import clamps
from bracket_cell.wiring import limits
from bracket_cell.wiring.detectors import with_detectors_for
from bracket_ground.interfaces.faults import FaultTable
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.robot import RobotModel

NOT_ABOUT_PEOPLE = frozenset({"wrist", "bins_m", "arm_look_rad"})  # of the bench: where parts are looked for
DEVICES = ("arm", "gripper", "overhead")  # which move, or see people
SAFETY = "safety.json"  # in a log
SHORT = 12  # digits of a hash that people compare
MESH = re.compile(r'filename="([^"]+)"')
Values = Mapping[str, Any]


@dataclass(frozen=True)
class SafetyConfiguration:
    """What a person signs.

    Attributes:
        values: by dotted keys, plain: numbers, words, truths and lists of them; files by their SHA-256.
    """

    values: Values

    @cached_property
    def sha256(self) -> str:
        """Over all values, in the order of their keys."""
        return hash_of(self.values)

    @property
    def short(self) -> str:
        """The digits that people compare."""
        return self.sha256[:SHORT]

    def changes(self, signed: Values) -> list[str]:
        """What is other than in signed values, a line each: key, signed value, value now."""
        keys = sorted({key for key in {*signed, *self.values} if _said(signed, key) != _said(self.values, key)})
        return [f"{key}: signed {_said(signed, key)}, now {_said(self.values, key)}" for key in keys]


def hash_of(values: Values) -> str:
    """SHA-256 of values, in hexadecimal digits."""
    return sha256(json.dumps(values, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def safety_of(configuration: Configuration, product: Product, table: FaultTable) -> SafetyConfiguration:
    """The safety configuration of a cell as it runs: with the detectors, and the errors of their cards, that it has.

    Whatever `motion` has belongs to it, the numbers that nobody may set among them, and all of the bench but where
    parts are looked for: a key that is added later is signed, too.
    """
    bench, devices, motion = configuration.bench, configuration.devices, configuration.motion
    perception, robot = configuration.perception, configuration.robot
    parts: dict[str, Any] = {
        "faults": {row.signal: row.model_dump(exclude={"signal"}) for row in table.faults},
        "unsafe_table": configuration.unsafe_table,
        "controller": configuration.controller.model_dump(exclude={"max_duration_s"}),
        "motion": {**limits.fixed("motion"), **motion.model_dump(), "speed_share": motion.configured_share},
        "clamps": clamps(standing_m(product, bench), robot, motion.separation.clamp_n),
        "robot": {**robot.model_dump(exclude={"urdf"}), "urdf": _geometry(robot)},
        "bench": bench.model_dump(exclude=set(NOT_ABOUT_PEOPLE)),
        "hands": {"kind": perception.chosen("hands").kind, **perception.files("hands")},
        "classical": limits.fixed("classical") | perception.classical.model_dump(),
        "limits": limits.values(),
        "devices": {role: getattr(devices, role).model_dump() for role in DEVICES},
    }
    parts["motion"]["separation"] |= limits.fixed("motion.separation")
    return SafetyConfiguration(dict(_flat("", parts)))


def safety_from(path: Path) -> SafetyConfiguration:
    """The safety configuration of a configuration's file.

    Raises:
        InputError: a file cannot be used.
    """
    configuration = load_configuration(path)
    with located(path, configuration):
        configuration, _ = with_detectors_for(configuration, product := load_product(configuration, path))
    return safety_of(configuration, product, load_faults(configuration))


def other_limits(recorded: str) -> list[str]:
    """Which of these numbers are others than in the values of a log's safety.json, a line each.

    Raises:
        ValueError: it is no JSON object.
    """
    values = json.loads(recorded)
    if not isinstance(values, dict):
        raise ValueError("it is no JSON object")
    fixed = {f"{name}.{key}": value for name in limits.FIXED for key, value in limits.fixed(name).items()}
    now = {
        key: value for key, value in _flat("", {"limits": limits.values(), **fixed}) if key not in fixed.keys() - values
    }
    was = {key: value for key, value in values.items() if key.startswith("limits.") or key in fixed}
    return [line.replace(": signed ", ": was ", 1) for line in SafetyConfiguration(now).changes(was)]


def _geometry(robot: RobotModel) -> str:
    """SHA-256 of the arm's URDF and of its meshes, wherever they lie."""
    text, digest = robot.urdf_text, sha256()
    for mesh in MESH.findall(text):
        digest.update(Path(mesh).read_bytes())
    digest.update(MESH.sub(lambda found: f'filename="{Path(found[1]).name}"', text).encode())
    return digest.hexdigest()


def _flat(key: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Plain values of nested ones, by dotted keys."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _flat(f"{key}.{name}".lstrip("."), inner)
    elif isinstance(value, list | tuple) and any(isinstance(inner, Mapping) for inner in value):
        for number, inner in enumerate(value):
            yield from _flat(f"{key}.{number}", inner)
    elif isinstance(value, Path):
        yield key, sha256(value.read_bytes()).hexdigest() if value.is_file() else value.name
    elif value is not None:
        yield key, list(value) if isinstance(value, tuple) else value


def _said(values: Values, key: str) -> str:
    return json.dumps(values[key], ensure_ascii=False).strip('"') if key in values else "not there"
