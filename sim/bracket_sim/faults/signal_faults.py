"""A fault is data: a kind in a signal of a device, such as `arm.positions_rad.2:offset:0.1` or `arm.pace:lost`.

A signal is a field of a device's state, an order to a device, on the gripper's bus a message or a register, or a field
of a detector's answer: of the view itself, or of a hand, a hole or a part in it.
"""

from __future__ import annotations

import math
import zlib
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from enum import Enum
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from bracket_ground.errors import InputError
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.observation import ArmMode
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Array

Kind = Literal[
    "stuck",
    "late",
    "early",
    "repeated",
    "scaled",
    "offset",
    "flipped",
    "lost",
    "foreign",
    "nan",
    "infinite",
    "jumps",
    "swapped",
    "cut",
    "refused",
]  # the last two, a part and an exception, are not drawn
ANY: tuple[Kind, ...] = get_args(Kind)
ANSWER, WORD, MEASURE = ("stuck", "late", "repeated", "lost"), ("stuck", "repeated", "flipped", "foreign"), ANY[:9]
ORDER: tuple[Kind, ...] = ("stuck", "late", "repeated", "scaled", "offset", "flipped", "foreign", "lost")
FRAME: tuple[Kind, ...] = ("stuck", "late", "repeated", "flipped", "foreign", "lost")
REGISTER: tuple[Kind, ...] = ("stuck", "scaled", "offset", "flipped", "foreign")
AT_ONCE: tuple[Kind, ...] = ("scaled", "offset", "foreign", "nan", "infinite", "jumps")  # nothing is kept for them
POINT: tuple[Kind, ...] = ("stuck", "late", "repeated", "flipped", "swapped", *AT_ONCE)
FAR_M = 1e9
LATE_S = 0.2  # how late or early, where nothing else is said
SCALE = 1.3
RAMP_S = 0.3  # in which a wrong path leaves the right one: servos cannot jump
KEPT = 64  # values
MODES = tuple(mode for mode in get_args(ArmMode) if mode not in ("normal", "safeguard_closed"))
GROUPS: Mapping[str, tuple[str, ...]] = {  # several fields of one state
    "state": ("positions_rad", "velocities_rad_s", "moving", "mode", "path_s"),
    "answer": ("positions_rad", "velocities_rad_s", "moving", "mode", "path_s", "time_s"),
}
OTHERS = {"normal": "protective_stop", "operational": "stopped", "stopped": "operational"}  # of signals that are words


class Spread(NamedTuple):
    """What may be wrong with a signal.

    Attributes:
        kinds: that are drawn.
        offset: a usual one, in the signal's own unit.
        foreign: what another device could tell: least and most, or words.
    """

    kinds: Sequence[str]
    offset: float = 1.0
    foreign: tuple[float, float] | tuple[str, ...] = (0.0, 1.0)


SIGNALS: dict[str, Spread] = {
    "arm.positions_rad": Spread(MEASURE, 0.1, (-2.0, 2.0)),
    "arm.velocities_rad_s": Spread(MEASURE, 0.5, (-1.5, 1.5)),
    "arm.path_s": Spread(MEASURE, 0.3, (0.0, 3.0)),
    "arm.time_s": Spread(MEASURE, 0.3, (0.0, 60.0)),
    "arm.moving": Spread(("stuck", "late", "repeated", "flipped")),
    "arm.mode": Spread(WORD, foreign=MODES),
    "arm.state": Spread(ANSWER[:3]),
    "arm.answer": Spread(ANSWER),
    "arm.follow": Spread(ORDER, 0.1, (-0.5, 0.5)),
    "arm.pace": Spread(ORDER, 0.3, (0.0, 1.0)),
    "arm.stop": Spread(("late", "repeated", "foreign", "lost")),
    "bus.GripperStatus": Spread(FRAME),
    "bus.GripperHeartbeat": Spread(FRAME),
    "bus.GripperEmergency": Spread(("repeated", "foreign", "lost")),
    "bus.GripperCommand": Spread(FRAME),
    "bus.gPO": Spread(REGISTER, 20.0, (0.0, 85.0)),
    "bus.gPR": Spread(REGISTER, 20.0, (0.0, 85.0)),
    "bus.gCU": Spread(REGISTER, 1.0, (0.0, 2.55)),
    "bus.gOBJ": Spread(REGISTER, 1.0, (0.0, 3.0)),
    "bus.gSTA": Spread(REGISTER, 1.0, (0.0, 3.0)),
    "bus.gACT": Spread(REGISTER),
    "bus.gGTO": Spread(REGISTER),
    "bus.gFLT": Spread(("foreign",), 1.0, (1.0, 15.0)),
    "bus.NodeState": Spread(("flipped", "foreign"), 1.0, (0.0, 127.0)),
    "bus.rPR": Spread(REGISTER, 20.0, (0.0, 85.0)),
    "bus.rSP": Spread(REGISTER, 20.0, (20.0, 150.0)),
    "bus.rFR": Spread(REGISTER, 40.0, (20.0, 235.0)),
    "bus.rGTO": Spread(REGISTER),
    "bus.rACT": Spread(REGISTER),
    "overhead.image": Spread((*FRAME, "scaled", "offset"), 40.0, (0.0, 255.0)),
    "overhead.time_s": Spread(MEASURE, 0.3, (0.0, 60.0)),
    "overhead.frame": Spread(ANSWER),
    "wrist.time_s": Spread(MEASURE, 0.3, (0.0, 60.0)),
    "wrist.frame": Spread(ANSWER),
    "panel.orders": Spread(FRAME, foreign=("pause", "resume", "acknowledge", "stop")),
}
DETECTED: dict[str, Spread] = {  # what detectors answer
    "bench.answer": Spread(ANSWER),
    "bench.view": Spread(ANSWER[:3]),
    "bench.time_s": Spread((*MEASURE[:6], *AT_ONCE), 0.3, (0.0, 60.0)),
    "bench.hand": Spread(ANSWER),
    "bench.left_by": Spread(ANSWER),
    "bench.holes": Spread((*ANSWER, "swapped")),
    "hand.time_s": Spread(("stuck", "late", *AT_ONCE), 0.3, (0.0, 60.0)),
    "hand.palm_m": Spread(POINT, 0.1, (-FAR_M, FAR_M)),
    "hand.fingertips_m": Spread(POINT, 0.1, (-FAR_M, FAR_M)),
    "hand.velocity_m_s": Spread(POINT, 0.5, (-FAR_M, FAR_M)),
    "hand.acceleration_m_s2": Spread(POINT, 2.0, (-FAR_M, FAR_M)),
    "hand.height_m": Spread(POINT[:4] + AT_ONCE, 0.1, (-5.0, 5.0)),
    "hand.fingertips_height_m": Spread(POINT[:4] + AT_ONCE, 0.1, (-5.0, 5.0)),
    "hole.part": Spread(("lost", "foreign"), foreign=("o1", "o2", "o3", "of no type")),
    "hole.confidence": Spread(AT_ONCE, 0.3),
    "hole.seen_s": Spread(AT_ONCE, 0.3, (0.0, 60.0)),
    "hole.upright": Spread(("flipped",)),
    "parts.answer": Spread(ANSWER),
    "parts.view": Spread(ANSWER[:3]),
    "parts.time_s": Spread((*MEASURE[:6], *AT_ONCE), 0.3, (0.0, 60.0)),
    "parts.detections": Spread((*ANSWER, "swapped")),
    "part.position_m": Spread(AT_ONCE, 0.02, (-FAR_M, FAR_M)),
    "overhead.depth_mm": Spread((*FRAME, "scaled", "offset"), 40.0),
}
OF_JOINTS = ("positions_rad", "velocities_rad_s", "follow")
OF_GRIPPER = ("GripperStatus", "GripperHeartbeat", "GripperEmergency", "GripperCommand")
IMAGE: tuple[Kind, ...] = (*FRAME, "scaled", "offset")
JOINTS: tuple[Kind, ...] = ("nan", "infinite", "jumps", "cut")
UNDRAWN: Mapping[str, tuple[Kind, ...]] = {  # kinds that only people ask for
    **dict.fromkeys(("arm.positions_rad", "arm.velocities_rad_s"), JOINTS),
    **dict.fromkeys(("arm.answer", "arm.pace", "arm.stop", "overhead.frame", "wrist.frame"), ("refused",)),
    **{f"bus.{frame}": ("cut",) for frame in OF_GRIPPER},
    "arm.follow": ("cut", "refused"),
    "arm.acknowledge": ("late", "repeated", "lost", "refused"),
    "bus.frames": ("stuck", "late", "repeated", "flipped", "lost", "cut", "refused"),
    "wrist.image": IMAGE,
    **dict.fromkeys(("overhead.sequence", "wrist.sequence"), ("stuck", "late", "repeated")),
}
ORDERS = ("follow", "pace", "stop", "acknowledge")  # to the arm


class SignalFault:
    """One kind of fault in one signal.

    Args:
        signal: a field of a state, or a register of a CAN frame.
        size: of an offset in the signal's unit, as a factor, in seconds; or a value that another device would tell.
        joint: of a signal that has a value for each joint the only one; None for all.

    Attributes:
        device: "arm", "bus", "overhead", "wrist" or "panel"; of answers "bench", "hand", "hole", "parts" or "part".
    """

    def __init__(
        self, signal: str, kind: Kind, size: float | str | None = None, joint: int | None = None, device: str = "arm"
    ) -> None:
        self.device, self.signal, self.kind, self.joint = device, signal, kind, joint
        spread = (SIGNALS | DETECTED).get(f"{device}.{signal}", Spread(()))
        usual: dict[str, float | str] = {"scaled": SCALE, "foreign": spread.foreign[-1]}
        usual |= dict.fromkeys(("offset", "jumps"), spread.offset)
        self.size = usual.get(kind, LATE_S) if size is None else size
        self._kept: deque[tuple[float, Any]] = deque(maxlen=KEPT)
        self._told: Any = None
        self._again = False

    @staticmethod
    def parse(text: str) -> SignalFault:
        """Of DEVICE.SIGNAL[.JOINT]:KIND[:SIZE]; raises InputError."""
        name, kind, *sizes = text.split(":")
        device, _, rest = name.partition(".")
        signal, _, joint = rest.partition(".")
        known, asked = SIGNALS | DETECTED, f"{device}.{signal}"
        if asked not in {**known, **UNDRAWN}:
            raise InputError(f"unknown signal {name!r}; legal: {', '.join({**known, **UNDRAWN})}")
        kinds = (*known.get(asked, Spread(())).kinds, *UNDRAWN.get(asked, ()))
        if kind not in kinds:
            raise InputError(f"{text!r}: no kind of fault in {asked} is {kind!r}; legal: {', '.join(kinds)}")
        if len(sizes) > 1 or (joint and not (joint.isdecimal() and signal in OF_JOINTS)):
            of = ", ".join(f"arm.{name}" for name in OF_JOINTS)
            raise InputError(f"{text!r}: must be DEVICE.SIGNAL[.JOINT]:KIND[:SIZE], with a joint, from 0 on, of {of}")
        fault = SignalFault(signal, ANY[ANY.index(kind)], _size(sizes), int(joint) if joint else None, device)
        if legal := _wrong_size(fault, known.get(asked, Spread(())).foreign):
            raise InputError(f"{text!r}: the size of {kind} must be {legal}")
        return fault

    @property
    def name(self) -> str:
        """As `parse` reads it."""
        joint = "" if self.joint is None else f".{self.joint}"
        size = f"{self.size:.4g}" if isinstance(self.size, float) else self.size
        return f"{self.device}.{self.signal}{joint}:{self.kind}:{size}"

    @property
    def number(self) -> float:
        """The size as a number."""
        return float(self.size)

    def apply(self, value: Any, time_s: float, *, active: bool = True) -> Any:
        """What the signal says in place of its value; to be asked before the fault, too, as some need what was."""
        first = not self._kept
        self._kept.append((time_s, value))
        if not active or first or (self.kind == "repeated" and self._again):
            self._told = value
        if active and self.kind not in ("stuck", "repeated"):
            self._told = self._changed(value, time_s)
        self._again = not self._again
        return self._told

    def _changed(self, value: Any, time_s: float) -> Any:
        age_s = self.number if self.kind in ("late", "early") else 0.0
        old = next((kept for when_s, kept in reversed(self._kept) if when_s <= time_s - age_s), self._kept[0][1])
        if self.kind == "late" or value is None:
            return old if self.kind == "late" else None
        if self.kind == "swapped" or isinstance(value, Mapping):
            return _swapped(value) if self.kind == "swapped" else {}
        if isinstance(value, np.ndarray):
            return self._image(value)
        if isinstance(value, JointTrajectory):
            return self._path(value)
        if isinstance(value, tuple):
            return self._values(value, old)
        if isinstance(value, float) and isinstance(old, float) and not isinstance(self.size, str):
            return self._number(value, old)
        return self._word(value)

    def _values(self, value: tuple[Any, ...], old: tuple[Any, ...]) -> tuple[Any, ...]:
        if self.kind in ("cut", "lost") and self.joint is None:
            return value[:-1] if self.kind == "cut" else ()
        chosen = range(len(value)) if self.joint is None else (self.joint,)
        both = enumerate(zip(value, old or value, strict=True))
        return tuple(self._number(now, then) if number in chosen else now for number, (now, then) in both)

    def _number(self, now: float, old: float) -> float:
        changes: dict[str, Callable[[], float]] = {
            "early": lambda: now + (now - old),
            "scaled": lambda: now * self.number,
            "offset": lambda: now + self.number,
            "flipped": lambda: -now,
            "foreign": lambda: self.number,
            "lost": lambda: math.nan,
            "nan": lambda: math.nan,
            "infinite": lambda: math.inf,
            "jumps": lambda: now + self.number * float(np.random.default_rng(zlib.crc32(repr(now).encode())).normal()),
        }
        return changes[self.kind]()

    def _word(self, value: Any) -> Any:
        """Another value of something that is no measure."""
        if self.kind == "foreign":
            return self.size
        if self.kind == "lost":
            return None
        if self.kind != "flipped":
            return value
        if isinstance(value, bool):
            return not value
        return type(value)(value.value ^ 1) if isinstance(value, Enum) else OTHERS.get(value, value)

    def _image(self, image: np.ndarray) -> np.ndarray:
        """The image too bright or dark, shifted by pixels, upside down, of noise, or black; depths likewise."""
        most = np.iinfo(image.dtype).max
        rng = np.random.default_rng(zlib.crc32(image.tobytes()))
        changes: dict[str, Callable[[], np.ndarray]] = {
            "scaled": lambda: np.clip(image * self.number, 0, most).astype(image.dtype),
            "offset": lambda: np.roll(image, round(self.number), axis=1),
            "flipped": lambda: np.ascontiguousarray(np.flip(image, int(self.number) % image.ndim)),
            "foreign": lambda: rng.integers(0, most, image.shape, image.dtype, endpoint=True),
            "lost": lambda: np.zeros_like(image),
        }
        return changes[self.kind]()

    def _path(self, path: JointTrajectory) -> JointTrajectory:
        """Another path from the same place: faster, beside it, back, elsewhere, or only its first half."""
        if self.kind == "scaled":
            return replace(path, times_s=path.times_s / self.number)
        if self.kind == "cut":
            half = max(1, len(path.times_s) // 2)
            return JointTrajectory(path.times_s[:half], path.positions_rad[:half])
        if self.kind == "flipped":
            return replace(path, positions_rad=2 * path.positions_rad[0] - path.positions_rad)
        off: Array = np.zeros(path.positions_rad.shape[1])
        off[0 if self.joint is None else self.joint] = self.number
        leaves = np.minimum(path.times_s / RAMP_S, 1.0)[:, np.newaxis]
        return replace(path, positions_rad=path.positions_rad + leaves * off)


def _swapped(value: Any) -> Any:
    """Each in the place of its neighbour; parts keep their places and change their types."""
    turned = [*value.values()] if isinstance(value, Mapping) else [*value]
    turned = turned[1:] + turned[:1]
    if isinstance(value, Mapping):
        return dict(zip(value, turned, strict=True))
    if not all(isinstance(part, PartDetection) for part in value):
        return tuple(turned)
    return tuple(replace(part, part=other.part) for part, other in zip(value, turned, strict=True))


def drawn_fault(rng: np.random.Generator, signals: Mapping[str, Spread] = SIGNALS, joints: int = 6) -> SignalFault:
    """A fault at random: a signal, a kind that it can have, a size, and one of the arm's joints."""
    name = str(rng.choice(list(signals)))
    spread, (device, _, signal) = signals[name], name.partition(".")
    kind = ANY[ANY.index(str(rng.choice(list(spread.kinds))))]
    joint = int(rng.integers(joints)) if signal in OF_JOINTS and kind in ("offset", "foreign") else None
    return SignalFault(signal, kind, _drawn_size(rng, kind, spread), joint, device)


def _drawn_size(rng: np.random.Generator, kind: Kind, spread: Spread) -> float | str | None:
    if kind in ("late", "early"):
        return float(np.exp(rng.uniform(math.log(0.04), 0.0)))
    if kind == "scaled":
        return float(np.exp(rng.uniform(math.log(0.2), math.log(4.0))))
    if kind in ("offset", "jumps"):
        return float(spread.offset * rng.choice([-1, 1]) * np.exp(rng.uniform(math.log(0.1), math.log(10.0))))
    if kind == "foreign":
        words = [word for word in spread.foreign if isinstance(word, str)]
        return (
            str(rng.choice(words)) if words else float(rng.uniform(float(spread.foreign[0]), float(spread.foreign[1])))
        )
    return float(rng.integers(3)) if kind == "flipped" else None


def _size(texts: Sequence[str]) -> float | str | None:
    """A number where it is one."""
    try:
        return float(texts[0]) if texts else None
    except ValueError:
        return texts[0]


def _wrong_size(fault: SignalFault, foreign: Sequence[float | str]) -> str:
    """What the size must be, where it cannot be used; empty where it can."""
    number = isinstance(fault.size, float) and math.isfinite(fault.size)
    if fault.kind == "foreign" and not number:
        if fault.signal in OF_GRIPPER:
            register, _, value = str(fault.size).partition("=")
            return "" if register and isinstance(_size([value]), float) else "REGISTER=NUMBER"
        words = [word for word in foreign if isinstance(word, str)]
        return "" if fault.size in words or fault.signal == "part" else ", ".join(words) or "a number"
    least = 1e-3 if (fault.signal, fault.kind) == ("follow", "scaled") else 0.0  # of a path's times
    bounded = fault.kind in ("late", "early") or least > 0
    return "" if number and (fault.number >= least or not bounded) else f"a number{f', {least:g} or more' * bounded}"
