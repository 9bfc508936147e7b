"""The gripper as data: what it does, how far and how hard, its shapes, and which holds it offers for a part."""

from __future__ import annotations

import math
import re
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from bracket_ground.files.files import shipped
from bracket_ground.files.model import Model
from bracket_ground.files.units import Length
from bracket_ground.files.words.message import Message
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.grasping import PAD_WIDTH_M, held_off_middle, places_m
from bracket_ground.interfaces.grip import Grip, Hold
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import PartType
from bracket_ground.interfaces.solid import span_m

FOLDER = shipped("bracket_cell.config", "grippers")
DEFAULT = "2f85"
MARGINS_M = (0.004, 0.001)  # of the outline that is kept free: along the opening, and around the coupling
ROUND = 6  # decimals of an outline in [m]
AROUND = np.arange(16) * math.pi / 8  # directions in which a cup's lip is looked at
FLAT_M, POINT_M = 2e-4, 1e-5  # of a face that seals; half a window that stands for a point
COUNTS = 255  # of the greatest raw value of a register
STEP_M = 0.002  # between places where a cup is tried
FALLS_M_S2 = 9.81  # what pulls at a part by no more than its weight
SWITCH_M = 0.010  # opening that stands for "off" of what is switched; 0 stands for "on"

Positive = Annotated[float, Field(gt=0, le=10_000)]
Shape = tuple[tuple[float, float, float], tuple[float, float, float]]  # centre and size of a box, in the flange's frame


class Fingers(Model):
    """Two fingers that move alike along x of the tool.

    Attributes:
        stroke_m: distance between the pads when they are open; 0 when they are closed.
        force_n, speed_m_s: the least and the most, as its command registers tell; values beyond are cut to these.
        pads_m: of a fingertip: its thickness along x, its width, its length.
        mass_kg: of each finger.
    """

    stroke_m: Length
    force_n: tuple[Positive, Positive]
    speed_m_s: tuple[Positive, Positive]
    pads_m: tuple[Length, Length, Length]
    mass_kg: Positive = 0.08

    grips: ClassVar[tuple[Grip, ...]] = (Grip.WIDTH, Grip.LENGTH)

    @model_validator(mode="after")
    def _has_ranges(self) -> Fingers:
        for name in ("force_n", "speed_m_s"):
            least, most = getattr(self, name)
            if least > most:
                raise ValueError(f"{name} is the least and the most: {least:g} is above {most:g}")
        return self

    def why_not(self, kind: PartType, clearance_m: float) -> str:
        """Why none of a body's sides fits between the fingers; empty where one does."""
        narrowest_m, most_m = min(grip.span_m(kind) for grip in self.grips), self.stroke_m - 2 * clearance_m
        if narrowest_m <= most_m:
            return ""
        wide, most = f"{1e3 * narrowest_m:.0f}", f"{1e3 * max(0.0, most_m):.0f}"
        return Message("is {wide} mm wide; it takes at most {most} mm", wide=wide, most=most)

    def possible(self, kind: PartType, clearance_m: float) -> tuple[Grip, ...]:
        """Grips for which the stroke leaves this gap between each finger and the box around the body."""
        return tuple(grip for grip in self.grips if grip.span_m(kind) + 2 * clearance_m <= self.stroke_m)

    def tips_m(self, kind: PartType, grip: Grip, depth_m: float, least_m: float) -> float:
        """Height of the fingertips above a body's bottom: near the top of what they hold, never below `least_m`."""
        return max(least_m, grip.top_m(kind, self.pads_m[1]) - depth_m)

    def holds(self, kind: PartType, grip: Grip, tips_m: float) -> tuple[Hold, ...]:
        """In the middle of its sides, and beside it where its shape and the pads' width allow that."""
        found = tuple(Hold(grip, place) for place in places_m(grip.axis))
        beside = self.pads_m[1] >= PAD_WIDTH_M and held_off_middle(kind, grip.axis, tips_m)
        return found if beside else found[:1]

    def opening_for(self, kind: PartType, grip: Grip, clearance_m: float) -> float:
        """Opening that leaves this gap on both sides of a body, as far as the stroke allows."""
        return min(self.stroke_m, grip.span_m(kind) + 2 * clearance_m)

    def shapes(self, opening_m: float, palm_end_m: float, tip_m: float) -> dict[str, Shape]:
        """Both fingers at an opening."""
        thick, wide, _ = self.pads_m
        middle_m = round((palm_end_m + tip_m) / 2, ROUND)
        size = (thick, wide, round(tip_m - palm_end_m, ROUND))
        offsets = {"finger_left": (opening_m + thick) / 2, "finger_right": -(opening_m + thick) / 2}
        return {name: ((offset, 0.0, middle_m), size) for name, offset in offsets.items()}


class Switched(Model):
    """What holds a part by its top, and is switched on and off: an opening of 0 is on, any other is off.

    Attributes:
        diameter_m: of what touches the part.
        travel_m: how far it gives way before it is stiff.
        stiffness_n_m: with which it does.
        builds_s: within this time it holds, or nothing is there.
    """

    diameter_m: Length
    travel_m: Length = 0.002
    stiffness_n_m: Positive = 2000.0
    builds_s: float = Field(default=0.4, gt=0, le=2)

    grips: ClassVar[tuple[Grip, ...]] = (Grip.TOP,)
    stroke_m: ClassVar[float] = SWITCH_M
    force_n: ClassVar[tuple[float, float]] = (1.0, 235.0)  # it knows neither: whatever is commanded, is taken
    speed_m_s: ClassVar[tuple[float, float]] = (0.02, 0.15)

    @property
    def ring_m(self) -> tuple[float, float]:
        """Width of what must lie on one flat face all around, and how high something inside of it may stand out."""
        return self.diameter_m / 2, 0.0

    def why_not(self, kind: PartType, clearance_m: float) -> str:  # noqa: ARG002 - of fingers
        """Why a body cannot be held; empty where it can."""
        wide = f"{1e3 * self.diameter_m:.0f}"
        return "" if self._face(kind) else Message("has no flat face of {wide} mm on top", wide=wide)

    def possible(self, kind: PartType, clearance_m: float) -> tuple[Grip, ...]:
        """From above, where there is a flat face."""
        return () if self.why_not(kind, clearance_m) else self.grips

    def tips_m(self, kind: PartType, grip: Grip, depth_m: float, least_m: float) -> float:  # noqa: ARG002 - of fingers
        """Height of its end above a body's bottom, pressed on by half of its travel."""
        face = self._face(kind)
        return (kind.size_m[2] if face is None else face[1]) - self.travel_m / 2

    def holds(self, kind: PartType, grip: Grip, tips_m: float) -> tuple[Hold, ...]:  # noqa: ARG002 - of fingers
        """On the flat face that is nearest to the middle."""
        face = self._face(kind)
        return () if face is None else (Hold(grip, face[0]),)

    def opening_for(self, kind: PartType, grip: Grip, clearance_m: float) -> float:  # noqa: ARG002 - of fingers
        """That stands for off."""
        return self.stroke_m

    def shapes(self, opening_m: float, palm_end_m: float, tip_m: float) -> dict[str, Shape]:  # noqa: ARG002
        """The tube with its end."""
        centre = (0.0, 0.0, round((palm_end_m + tip_m) / 2, ROUND))
        return {"cup": (centre, (self.diameter_m, self.diameter_m, round(tip_m - palm_end_m, ROUND)))}

    def _face(self, kind: PartType) -> tuple[float, float] | None:
        return _face(kind, self.diameter_m, *self.ring_m)


class Cup(Switched):
    """A vacuum cup at the end of a tube.

    Attributes:
        lip_m: width of its ring, which must lie on one flat face all around.
        depth_m: what stands out inside of the lip may be so high.
        vacuum_kpa: below the air's pressure that its source reaches on a face that seals.
        held_kpa: from so much on something is held.
    """

    lip_m: Length = 0.003
    depth_m: float = Field(default=0.002, ge=0, le=1)
    vacuum_kpa: float = Field(gt=0, le=101)
    held_kpa: float = Field(gt=0, le=101)

    @model_validator(mode="after")
    def _is_reached(self) -> Cup:
        if self.held_kpa >= self.vacuum_kpa:
            raise ValueError(f"held_kpa {self.held_kpa:g} is never reached: its source reaches {self.vacuum_kpa:g}")
        if 2 * self.lip_m >= self.diameter_m:
            raise ValueError(f"lip_m {self.lip_m:g} all around leaves nothing of diameter_m {self.diameter_m:g}")
        return self

    @property
    def ring_m(self) -> tuple[float, float]:
        """Of the lip."""
        return self.lip_m, self.depth_m

    @property
    def most_n(self) -> float:
        """With which the air presses on a part that seals."""
        return 1e3 * self.vacuum_kpa * math.pi * (self.diameter_m / 2) ** 2


class Magnet(Switched):
    """A magnet that is switched, as an electromagnet: it holds parts of a type that is `magnetic`.

    Attributes:
        most_n: with which it holds on thick steel without a gap.
        tells: its device tells whether something is held; otherwise nothing is taken, as a lost part would not be seen.
    """

    most_n: Positive
    tells: bool

    def why_not(self, kind: PartType, clearance_m: float) -> str:
        """Why a body cannot be held; empty where it can."""
        if not self.tells:
            return "would be held by a magnet that does not tell whether it holds"
        return super().why_not(kind, clearance_m) if kind.magnetic else "is not magnetic"


class Nothing(Switched):
    """The flange is bare, or holds a camera alone."""

    diameter_m: Length = 0.001

    grips: ClassVar[tuple[Grip, ...]] = ()

    def why_not(self, kind: PartType, clearance_m: float) -> str:  # noqa: ARG002 - of grippers
        """Nothing is held."""
        return "the arm has no gripper"

    def shapes(self, opening_m: float, palm_end_m: float, tip_m: float) -> dict[str, Shape]:  # noqa: ARG002
        """None."""
        return {}


class Gripper(Model):
    """What hangs on the flange: two fingers, a vacuum cup, a magnet, or nothing that holds.

    Attributes:
        name: for messages.
        mass_kg: of all of it.
        with_part_kg: of all that hangs on the flange, with the heaviest part in use; with the payload by default.
        payload_kg: the heaviest part that it may hold, by its data sheet; 0 where nothing holds.
        tcp_from_flange_m: distance of the tool frame (TCP) from the flange, along the flange's z.
        fingertip_beyond_tcp_m: fingertips, or the lip, reach this far below the TCP.
        coupling_m: diameter and length of what it is screwed on with.
        palm_m: its body: extent along the opening, across it, and where it ends, from the flange.
        fingers: of a gripper that has two.
        cup: of one that sucks.
        magnet: of one that is switched on.
        nothing: the cell watches, and the person places everything.
    """

    name: str
    mass_kg: Positive
    with_part_kg: Positive | None = None
    payload_kg: float = Field(ge=0, le=10_000)
    tcp_from_flange_m: Length
    fingertip_beyond_tcp_m: float = Field(default=0.0, ge=0, le=1)
    coupling_m: tuple[Length, Length]
    palm_m: tuple[Length, Length, Length]
    fingers: Fingers | None = None
    cup: Cup | None = None
    magnet: Magnet | None = None
    nothing: bool = False

    @model_validator(mode="after")
    def _does_one_thing(self) -> Gripper:
        if sum(map(bool, (self.fingers, self.cup, self.magnet, self.nothing))) != 1:
            raise ValueError("give one of fingers, cup, magnet, or nothing: true")
        if self.coupling_m[1] >= self.palm_m[2]:
            raise ValueError(f"palm_m ends at {self.palm_m[2]:g}, within the coupling: {self.coupling_m[1]:g}")
        if self.palm_m[2] >= self.tip_m:
            raise ValueError(f"palm_m ends at {self.palm_m[2]:g}, beyond the tips: {self.tip_m:g}")
        if self.fingers is not None and self.fingers.pads_m[2] > self.tip_m - self.palm_m[2]:
            raise ValueError(f"pads_m: {self.fingers.pads_m[2]:g} long, and fingers end {self.tip_m:g} from the flange")
        if self.with_part_kg is not None and self.with_part_kg < self.mass_kg:
            raise ValueError(f"with_part_kg {self.with_part_kg:g} is less than mass_kg {self.mass_kg:g} without a part")
        return self

    @property
    def does(self) -> Fingers | Switched:
        """What holds."""
        return self.fingers or self.switched or Nothing()

    @property
    def switched(self) -> Cup | Magnet | None:
        """What holds by a part's top."""
        return self.cup or self.magnet

    @property
    def loaded_kg(self) -> float:
        """Of all that hangs on the flange, at most."""
        return self.with_part_kg or self.mass_kg + self.payload_kg

    @property
    def tip_m(self) -> float:
        """Where it ends, from the flange."""
        return self.tcp_from_flange_m + self.fingertip_beyond_tcp_m

    @property
    def stroke_m(self) -> float:
        """Opening with which it holds nothing."""
        return self.does.stroke_m

    def within(self, opening_m: float) -> float:
        """An opening that it can have."""
        return min(self.stroke_m, max(0.0, opening_m))

    @property
    def pads_m(self) -> float:
        """Width of what touches a part's sides; the usual one where nothing does."""
        return PAD_WIDTH_M if self.fingers is None else self.fingers.pads_m[1]

    @property
    def known(self) -> tuple[Grip, ...]:
        """Ways to hold any part."""
        return self.does.grips

    def why_not(self, kind: PartType, clearance_m: float) -> str:
        """Why a part cannot be held, in words with what is legal; empty where it can."""
        most_kg = self.payload_kg if self.switched is None else min(self.payload_kg, self.switched.most_n / FALLS_M_S2)
        if kind.mass_kg > most_kg and not self.nothing:
            kilograms, most = f"{kind.mass_kg:g}", f"{most_kg:.3g}"
            return Message("weighs {kilograms} kg; it takes at most {most} kg", kilograms=kilograms, most=most)
        return self.does.why_not(kind, clearance_m)

    def grips(self, kind: PartType, clearance_m: float) -> tuple[Grip, ...]:
        """Ways to hold a part, the best first, with this gap to each side before the fingers close."""
        return () if self.why_not(kind, clearance_m) else self.does.possible(kind, clearance_m)

    def tips_m(self, kind: PartType, grip: Grip, depth_m: float, least_m: float) -> float:
        """Height of its end above a body's bottom; see `Fingers` and `Switched`."""
        return self.does.tips_m(kind, grip, depth_m, least_m)

    def holds(self, kind: PartType, grip: Grip, tips_m: float) -> tuple[Hold, ...]:
        """Where along a grip's sides a part may be held, the nearest to the middle first."""
        return self.does.holds(kind, grip, tips_m)

    def opening_for(self, kind: PartType, grip: Grip, clearance_m: float) -> float:
        """With which it comes down over a body and lets go of it."""
        return self.does.opening_for(kind, grip, clearance_m)

    def held_m(self, kind: PartType, grip: Grip, tips_m: float) -> float | None:
        """Distance between the pads that hold a body; None where the opening tells nothing of it."""
        return None if self.fingers is None else grip.held_m(kind, tips_m, self.pads_m)

    def moving(self, opening_m: float) -> dict[str, Shape]:
        """Boxes of what holds, at an opening, by name."""
        return self.does.shapes(opening_m, self.palm_m[2], self.tip_m)

    @property
    def palm(self) -> Shape:
        """The box around coupling and body that is kept free."""
        along, around = MARGINS_M
        wide = max(self.palm_m[0] + along, self.coupling_m[0] + around)
        deep = max(self.palm_m[1], self.coupling_m[0]) + around
        end = self.palm_m[2]
        return (0.0, 0.0, end / 2), (round(wide, ROUND), round(deep, ROUND), end)


@cache
def _face(kind: PartType, diameter_m: float, lip_m: float, depth_m: float) -> tuple[float, float] | None:
    """Place along a body's length that a cup seals on, and how high it is; the nearest to the middle."""
    steps = np.arange(0.0, kind.size_m[0] / 2, STEP_M)
    for place in sorted({*steps.tolist(), *(-steps).tolist()}, key=lambda at: (abs(at), at)):
        rim = [_top(kind, place, diameter_m / 2 - back) for back in (0.0, lip_m / 2, lip_m)]
        inside = [_top(kind, place, share * (diameter_m / 2 - lip_m)) for share in (0.0, 0.5, 0.9)]
        low, high = np.min(rim), np.max(rim)
        if high - low <= FLAT_M and np.max(inside) <= high + depth_m:
            return place, float(high)
    return None


def _top(kind: PartType, place_m: float, radius_m: float) -> Array:
    """(16,) how high a body is on a circle; minus infinity where it is not."""
    points = zip(place_m + radius_m * np.cos(AROUND), radius_m * np.sin(AROUND), strict=True)
    spans = (span_m(kind.solids, 2, {0: (x - POINT_M, x + POINT_M), 1: (y - POINT_M, y + POINT_M)}) for x, y in points)
    return np.array([-1.0 if span is None else span[1] for span in spans])


def ranges(gripper: Gripper) -> dict[str, tuple[float, float]]:
    """Least and most of the command's opening [mm], speed [mm/s] and force [N]."""
    (slow, fast), stroke_m = gripper.does.speed_m_s, gripper.does.stroke_m
    return {"rPR": (0.0, 1e3 * stroke_m), "rSP": (1e3 * slow, 1e3 * fast), "rFR": gripper.does.force_n}


def scaled(text: str, gripper: Gripper) -> str:
    """The text of a DBC file with registers that run over what a gripper can do."""
    ends = ranges(gripper)
    shut = ends["rPR"][::-1]
    for name, (first, last) in (ends | {"rPR": shut, "gPR": shut, "gPO": shut}).items():
        factor = math.trunc((last - first) / COUNTS * 1e12) / 1e12  # so that no raw value is beyond its end
        low, high = sorted((first, last))
        own = rf"(SG_ {name} : \S+ )\([^)]*\) \[[^]]*\]"
        text = re.sub(own, rf"\g<1>({factor:.12f},{first:g}) [{low:g}|{high:g}]", text)
    return text


def shipped_grippers() -> list[str]:
    """Names of the grippers that come with the program."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def load_gripper(name: str, folder: Path = Path()) -> Gripper:
    """A gripper that is shipped, by its name, or a gripper file.

    Args:
        folder: where files are looked for.

    Raises:
        ValueError: there is none.
        InputError: with every problem of its file.
    """
    path = FOLDER / f"{name}.yaml" if name in shipped_grippers() else folder / name
    if not path.is_file():
        raise ValueError(f"unknown gripper; legal: {', '.join(shipped_grippers())}, or a gripper file")
    return load_yaml(path, Gripper)


@cache
def default_gripper() -> Gripper:
    """That is mounted where no file says."""
    return load_gripper(DEFAULT)


def _named(value: Any, info: ValidationInfo) -> Any:
    if not isinstance(value, str):
        return value
    return load_gripper(value, Path((info.context or {}).get("folder", ".")))


NamedGripper = Annotated[Gripper, BeforeValidator(_named, json_schema_input_type=str)]
