"""What kind of person stands at the bench: habits, pace, behaviour beside a robot. Read without a simulator."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field

from bracket_ground.errors import InputError
from bracket_ground.files.files import shipped
from bracket_ground.files.model import Model
from bracket_ground.files.yaml_file import load_yaml
from bracket_sim.scene.hand_motion import MotionSettings
from bracket_sim.scene.human_hand import Grasp

Place = Annotated[tuple[float, float, float], Field(description="(x, y, z) in the world")]
NEVER_S = 1e6  # a pause that outlasts every run
Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
GoesOn = Literal["parked", "leaving"]
Order = Literal["random", "positions", "reversed", "parts", "any"]


def _rising(span: tuple[float, float]) -> tuple[float, float]:
    low, high = span
    if not (math.isfinite(low) and math.isfinite(high) and low <= high):
        raise ValueError(f"[{low:g}, {high:g}] must be two finite numbers, the smaller one first")
    return span


def _from_nothing(span: tuple[float, float]) -> tuple[float, float]:
    if span[0] < 0:
        raise ValueError(f"[{span[0]:g}, {span[1]:g}] must not begin below 0")
    return span


SignedSpan = Annotated[tuple[float, float], AfterValidator(_rising)]
Span = Annotated[SignedSpan, AfterValidator(_from_nothing)]


class ScrewHabits(Model):
    """How the person screws.

    Attributes:
        probability: how likely it is that a part is screwed after it was placed.
        unscrewed_limit: after this many placements without screwing, the person always screws.
        duration_s: shortest and longest screwing.
        rate_hz: slowest and fastest turning.
        radius_m: least and greatest radius of the motion.
        yaw_rad: how far the wrist turns, least and most.
        height_m: of the fingertips over the part's top, least and most.
        tool: share of the times in which it is done with a tool, the hand farther away from the part.
    """

    probability: Share = 0.6
    unscrewed_limit: int = Field(default=2, ge=1)
    duration_s: Span = (4.0, 6.0)
    rate_hz: Span = (1.5, 2.0)
    radius_m: Span = (0.008, 0.008)
    yaw_rad: Span = (0.12, 0.12)
    height_m: Span = (0.012, 0.012)
    tool: Share = 0.0


class Grip(Model):
    """How the hand holds parts; drawn anew for each grasp.

    Attributes:
        tilt_rad: how far the wrist tips the fingers down, least and most.
        roll_rad: how far the hand leans to a side, least and most; positive to the right.
        from_middle_m: where along the part it is gripped, from its middle towards the person; null for near its end.
        curl_rad: how much more than usual ring and little finger are bent, least and most; negative is stretched.
        open_m: how much wider than the part the fingers open.
        thumb_m: length of the drawn hand's thumb.
        grasps: how a human hand grasps, drawn for each grasp: thumb against index and middle finger (tripod), against
            the index finger (pinch), or against its side (lateral).
    """

    tilt_rad: Span = (0.0, 0.0)
    roll_rad: SignedSpan = (0.0, 0.0)
    from_middle_m: SignedSpan | None = None
    curl_rad: SignedSpan = (0.0, 0.0)
    open_m: Span = (0.014, 0.014)
    thumb_m: float = Field(default=0.127, ge=0.08, le=0.15)
    grasps: tuple[Grasp, ...] = Field(default=("tripod", "pinch", "lateral"), min_length=1)

    @property
    def tilts(self) -> bool:
        """Whether the wrist does more than turn about the vertical."""
        return self.tilt_rad[1] > 0 or self.roll_rad != (0.0, 0.0)

    @property
    def curls(self) -> bool:
        """Whether ring and little finger move."""
        return self.curl_rad != (0.0, 0.0)


class Storage(Model):
    """Where the person's parts are when the run begins.

    Attributes:
        bins: each type in its own bin of the bench file, or types and bins permuted anew in every run.
        mixed: how likely it is that two bins have one part exchanged.
        elsewhere: share of parts that lie on the table before the bracket, as the robot left them.
        handed_over: share of parts that the robot fetches and holds out; only in data, where a script moves it.
        from_tray: share of fetches for which the person reaches into the robot's tray, where it has such a part.
        types: number of types, drawn, that the person has parts of; the rest only the robot has. Null: all.
        begun: number of holes, drawn, that somebody else has filled rightly with these parts before the run.
    """

    bins: Literal["own", "permuted"] = "own"
    mixed: Share = 0.0
    elsewhere: Share = 0.0
    handed_over: Share = 0.0
    from_tray: Share = 0.0
    types: int | None = Field(default=None, ge=1)
    begun: int = Field(default=0, ge=0)


class Lapses(Model):
    """What goes wrong or takes time on the way of a part to its hole; each is a probability for each part.

    Attributes:
        holds: the hand stays with the part before it goes to the bracket.
        hesitates: it stays over another hole first.
        regrips: the part is set down again after the grasp and gripped anew.
        wrong_part: a part of another type is fetched and placed; it is noticed afterwards, and taken away.
        overlooks: a part of another type that was placed is not noticed until somebody tells.
        takes_away: a part that sits well is taken away again.
        swaps: another part, that sits well, is taken out after this one was placed, and one of a wrong type put there;
            it is not noticed until somebody tells.
    """

    hold_s: ClassVar[Span] = (0.5, 4.0)  # that it stays with the part
    hesitate_s: ClassVar[Span] = (0.3, 1.2)  # that it stays over another hole
    holds: Share = 0.0
    hesitates: Share = 0.0
    regrips: Share = 0.0
    wrong_part: Share = 0.0
    overlooks: Share = 0.0
    takes_away: Share = 0.0
    swaps: Share = 0.0


class BesideRobot(Model):
    """How the person behaves beside a robot.

    Attributes:
        waits: share of the occasions on which the person waits for the arm.
        goes_on: when a person who waits goes on: once the arm stands parked, or as soon as it leaves the bracket.
        intrusions_per_min: how often the hand goes into the way of an arm that moves.
        intrusion_m_s: top speed of such a reach, least and most.
        chases: share of intrusions that follow the arm wherever it goes; the rest go to where it is expected.
        freezes: share of intrusions after which the hand stays there.
        pulls: share of intrusions that pull at what the robot holds; after the rest the hand withdraws at once.
    """

    begins_s: ClassVar[float] = 2.5  # how long the person waits after screwing for the robot to begin
    stands_s: ClassVar[float] = 8.0  # how long the person watches an arm that stands still away from its parking place
    freeze_s: ClassVar[Span] = (0.5, 4.0)  # how long it stays, least and most
    pull_m: ClassVar[Span] = (0.1, 0.25)  # how far it pulls, least and most
    waits: Share = 1.0
    goes_on: GoesOn = "parked"
    intrusions_per_min: float = Field(default=0.0, ge=0, le=60)
    intrusion_m_s: Span = (0.8, 1.6)
    chases: Share = 0.5
    freezes: Share = 0.4
    pulls: Share = 0.2


class HandOvers(Model):
    """What the person does where the robot holds a part out, or its open fingers.

    Attributes:
        takes: share of the parts held out that the person reaches for.
        early: share of them that are reached for while the arm still brings them.
        pulls: share of them that the person pulls at; at the rest the fingers close on the part and go again.
        waits_s: from closing the fingers on the part to the pull, least and most.
        pull_n: how hard the pull becomes, least and most.
        gives: share of the times that open fingers are held out in which the person puts a part between them.
    """

    pull_s: ClassVar[Span] = (0.2, 0.6)  # how long it takes to become so hard, least and most
    holds_on_s: ClassVar[float] = 3.0  # how long the person pulls in vain
    stands_back_s: ClassVar[float] = 8.0  # that the hand with the part waits beside the arm for it to go
    moved: ClassVar[Mapping[str, str]] = {"fastens": "leave it out: what the robot holds in its hole is fastened"}
    takes: Share = 1.0
    early: Share = 0.0
    pulls: Share = 1.0
    waits_s: Span = (0.4, 0.7)
    pull_n: Span = (12.0, 25.0)
    gives: Share = 1.0


class Leaving(Model):
    """How the person walks off in the middle of a bracket, and what they do when they are back.

    Attributes:
        leaves: share of the placed parts after which the person walks off, with both hands out of every view.
        away_s: for how long, least and most.
        exchanges_tray: share of the placed parts after which the person puts another tray there, with other places of
            the parts, while the robot does not work at it.
    """

    leaves: Share = 0.0
    away_s: Span = (20.0, 300.0)
    exchanges_tray: Share = 0.0


class OtherHand(Model):
    """A further hand at the bench: the person's left one, or of somebody beside them.

    Attributes:
        rest_m: where its palm rests.
        turned_rad: how it is turned there: 0 over the person's edge, pi / 2 over the edge to the right of that.
        acts: it fills holes and screws as the first hand does, at the same time; else it only lies there.
    """

    rest_m: Place
    turned_rad: float = Field(default=0.0, ge=-math.pi, le=math.pi)
    acts: bool = True


class ShiftHabits(Model):
    """What the person does between brackets, and when the cell asks.

    Attributes:
        answers_s: how long it takes on average until the person notices a question; exponential.
        places_asked: share of calls for help at which the person places the part; at the others it is set into the tray
            so that the robot can take it.
        pause_s: from the end of one bracket to taking it out, least and most.
        fills_at_once: share of the times in which bins and tray, each by itself, are filled with the exchange; else
            when something lacks.
        points: share of the questions where a part goes that are answered by pointing at the hole.
        new_goals: share of the brackets of a shift that have an arrangement which the product does not list.
    """

    exchange_s: ClassVar[Span] = (2.0, 5.0)  # how long finished bracket out and empty one in take, least and most
    fill_s: ClassVar[Span] = (1.5, 4.0)  # that filling takes
    gives_up_s: ClassVar[float] = 30.0  # after so long the bracket is changed although nothing asks for it
    answers_s: float = Field(default=10.0, ge=0, le=600)
    places_asked: Share = 0.5
    pause_s: Span = (0.5, 4.0)
    fills_at_once: Share = 0.8
    points: Share = 0.0
    new_goals: Share = 0.1


class Person(Model):
    """A person; of two values every one between them is as likely, and it is drawn anew each time.

    Attributes:
        order: in which order open positions are filled: at random; p1, p2, ...; backwards; one type of part after the
            other; or any of these, drawn for the run.
        pace: how fast the person is, least and most, as a factor; drawn for the run.
        pause_s: shortest and longest reaction before each fetch.
        retries: how often a part that does not sit well is placed again.
        motion: how the hand moves.
        grip: how the hand holds parts.
        storage: where the person's parts are.
        lapses: what goes wrong or takes time on the way of a part to its hole.
        screw: how the person screws.
        robot: how the person behaves beside a robot.
        handing: what the person does with what the robot holds out.
        leaving: how the person walks off, and exchanges the tray.
        rest_m: where the palm rests; null for where the bench file has it.
        other_hands: further hands that belong to nobody else's file; `motion.separation.people` says how many people.
        shift: what the person does between brackets, and when the cell asks.
    """

    order: Order = "random"
    pace: Span = (1.0, 1.0)
    pause_s: Span = (0.1, 0.5)
    retries: int = Field(default=2, ge=0, le=20)
    motion: MotionSettings = MotionSettings()
    grip: Grip = Grip()
    storage: Storage = Storage()
    lapses: Lapses = Lapses()
    screw: ScrewHabits = ScrewHabits()
    robot: BesideRobot = BesideRobot()
    handing: HandOvers = HandOvers()
    leaving: Leaving = Leaving()
    rest_m: Place | None = None
    other_hands: tuple[OtherHand, ...] = Field(default=(), max_length=5)
    shift: ShiftHabits = ShiftHabits()

    @property
    def absent(self) -> bool:
        """Whether nobody does anything."""
        return self.pause_s[0] >= NEVER_S


def sample(span: tuple[float, float], rng: np.random.Generator) -> float:
    """A value of a span; one without width takes nothing from the generator."""
    low, high = span
    return float(rng.uniform(low, high)) if low < high else low


def bernoulli(share: float, rng: np.random.Generator) -> bool:
    """Whether something of this probability happens; what never or always does takes nothing from the generator."""
    return share >= 1 or (share > 0 and float(rng.random()) < share)


_ORDINARY = Person(
    order="any",
    pace=(0.6, 2.0),
    pause_s=(0.0, 1.5),
    motion=MotionSettings(speed_spread=0.2, bow=0.08),
    grip=Grip(
        tilt_rad=(0.0, 0.35), roll_rad=(-0.06, 0.06), curl_rad=(-0.6, 0.35), open_m=(0.010, 0.018), thumb_m=0.105
    ),
    storage=Storage(bins="permuted", mixed=0.5, elsewhere=0.15, handed_over=0.15, from_tray=0.05),
    lapses=Lapses(holds=0.25, hesitates=0.1, regrips=0.08, wrong_part=0.03, takes_away=0.04),
    screw=ScrewHabits(
        duration_s=(1.5, 7.0),
        rate_hz=(0.5, 3.0),
        radius_m=(0.002, 0.010),
        yaw_rad=(0.05, 0.6),
        height_m=(0.003, 0.012),
        tool=0.3,
    ),
    robot=BesideRobot(waits=0.9, intrusions_per_min=0.5, intrusion_m_s=(0.4, 1.0), pulls=0.0),
)
_VARIED = _ORDINARY.model_copy(
    update={
        "grip": _ORDINARY.grip.model_copy(
            update={"tilt_rad": (0.0, 0.6), "roll_rad": (-0.2, 0.2), "from_middle_m": (-0.010, 0.029)}
        )
    }
)
_CARELESS = _ORDINARY.model_copy(
    update={
        "robot": BesideRobot(waits=0.3, intrusions_per_min=12.0),
        "lapses": _ORDINARY.lapses.model_copy(update={"overlooks": 0.3}),
    }
)
PERSONS = {
    "careful": Person(),
    "careful_brisk": Person(robot=BesideRobot(goes_on="leaving")),
    "absent": Person(pause_s=(NEVER_S, NEVER_S)),  # nobody does anything
    "ordinary": _ORDINARY,
    "ordinary_brisk": _ORDINARY.model_copy(update={"robot": _ORDINARY.robot.model_copy(update={"goes_on": "leaving"})}),
    "varied": _VARIED,  # for data made without physics: there, a pinch holds anywhere
    "careless": _CARELESS,
    "hasty": _CARELESS.model_copy(  # as fast as ISO 13855 has hands
        update={"robot": _CARELESS.robot.model_copy(update={"intrusion_m_s": (1.9, 2.0)})}
    ),
}


def load_person(name_or_file: str) -> Person:
    """One of the shipped persons by name, those of `config/people` among them, or one from a YAML file.

    Raises:
        InputError: there is none of this name, or the file is wrong.
    """
    if name_or_file in PERSONS:
        return PERSONS[name_or_file]
    folder = shipped("bracket_cell.config", "people")
    path = kept if (kept := folder / f"{name_or_file}.yaml").is_file() else Path(name_or_file)
    if not name_or_file or not path.exists():
        names = ", ".join([*PERSONS, *sorted(file.stem for file in folder.glob("*.yaml"))])
        raise InputError(f"no person and no file {name_or_file!r}; legal: {names}, or a YAML file")
    return load_yaml(path, Person)
