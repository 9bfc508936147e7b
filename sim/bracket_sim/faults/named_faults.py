"""The faults that have names: what is wrong, and how a run may end with it, as the table of faults promises."""

from __future__ import annotations

from dataclasses import dataclass

from bracket_ground.errors import InputError
from bracket_sim.faults.signal_faults import SignalFault

PASSES_S, SHORT_S, LOSS_S = 1.5, 0.4, 2.0


@dataclass(frozen=True)
class FaultKind:
    """One fault with a name.

    Attributes:
        what: in words.
        ends: how a run may end with it, by names of `Outcome.end`: what the table of faults promises.
        signals: what is wrong, as `SignalFault.parse` reads it.
        lasts_s: after so long it goes away by itself; None for never.
        holding_ends: as `ends`, where a part is between the fingers; None for no difference.
        unseen_in: states of the trial after which no motion shows it: the run finishes.
        acknowledged: somebody acknowledges it, and an arm's mode is normal then.
        states: in which it can come; empty for all. One with states is of the world, a mishap with a part.
        promise: how the cell answers a mishap, in words.
    """

    what: str
    ends: tuple[str, ...]
    signals: tuple[str, ...] = ()
    lasts_s: float | None = None
    holding_ends: tuple[str, ...] | None = None
    unseen_in: tuple[str, ...] = ()
    acknowledged: bool = False
    states: tuple[str, ...] = ()
    promise: str = ""

    @property
    def of_world(self) -> bool:
        """No device has the fault."""
        return bool(self.states)


STOPS, RECOVERS, EITHER = ("fault",), ("finished",), ("fault", "finished")
ASKING = "waiting_for_help"
STANDS = ("arm.follow:refused", "arm.pace:scaled:0")  # by itself, in some modes
RESTARTS = ("bus.GripperCommand:foreign:rACT=0", "bus.GripperHeartbeat:foreign:NodeState=0")


def _passes(what: str, *signals: str, lasts_s: float = PASSES_S) -> FaultKind:
    return FaultKind(what, RECOVERS, signals, lasts_s)


def _mishap(what: str, states: str, promise: str, *, asks: bool = False) -> FaultKind:
    """With the part that is held or about to be taken; where a person is asked and does not answer, the tree fails."""
    return FaultKind(what, (*RECOVERS, "failed") if asks else RECOVERS, states=tuple(states.split()), promise=promise)


def _lost(what: str, *signals: str) -> FaultKind:
    """For a while, and somebody acknowledges it."""
    return FaultKind(what, RECOVERS, signals, LOSS_S, acknowledged=True)


def _stops(what: str, *signals: str, unseen_in: str = "") -> FaultKind:
    return FaultKind(what, STOPS, signals, unseen_in=tuple(unseen_in.split()))


FAULTS: dict[str, FaultKind] = {
    "arm_frozen": _stops("the arm's state does not change any more, its time stamp neither", "arm.answer:stuck"),
    "arm_restamped": _stops("the arm's state does not change any more, but has new stamps", "arm.state:stuck"),
    "arm_nan": _stops("the arm's joints are not numbers", "arm.positions_rad:nan"),
    "arm_velocity_nan": _stops("one joint's speed is not a number", "arm.velocities_rad_s.3:lost"),
    "arm_five_joints": _stops("the arm reports a joint too few", "arm.positions_rad:cut"),
    "arm_offset": _stops(
        "the arm reports its base joint 0.03 rad off", "arm.positions_rad.0:offset:0.03", unseen_in=ASKING
    ),
    "arm_lost": _stops("reading the arm raises", "arm.answer:refused"),
    "arm_deaf": _stops(
        "reading and commanding the arm raise",
        *("arm.answer:refused", "arm.follow:refused", "arm.stop:refused", "arm.pace:refused"),
    ),
    "arm_silent_short": _lost("the arm tells nothing new for 2 s", "arm.answer:stuck"),
    "arm_deaf_short": _lost(
        "reading and commanding the arm raise for 2 s",
        *("arm.answer:refused", "arm.follow:refused", "arm.stop:refused", "arm.pace:refused"),
    ),
    "arm_percent": FaultKind(
        "the arm takes its share of speed for percent", ("failed",), ("arm.pace:scaled:0.01",), unseen_in=(ASKING,)
    ),
    "arm_refuses": _stops("the arm refuses trajectories", "arm.follow:refused", unseen_in=f"leave {ASKING}"),
    "arm_ignores": _stops("the arm ignores trajectories", "arm.follow:lost", unseen_in=f"leave {ASKING}"),
    "arm_protective_stop": FaultKind(
        "protective stop until it is acknowledged",
        RECOVERS,
        ("arm.mode:foreign:protective_stop", "arm.stop:foreign", *STANDS),
        acknowledged=True,
    ),
    "arm_safeguard": FaultKind(
        "the safeguard opens and closes, then it is acknowledged",
        RECOVERS,
        ("arm.mode:foreign:safeguard_stop", *STANDS),
        lasts_s=PASSES_S,
        acknowledged=True,
    ),
    "arm_emergency": FaultKind(
        "an emergency stop is pressed, until it is acknowledged",
        RECOVERS,
        ("arm.mode:foreign:emergency_stop", "arm.stop:foreign", *STANDS),
        acknowledged=True,
    ),
    "arm_not_controlled": FaultKind(
        "somebody stops the arm's program, until it is acknowledged",
        RECOVERS,
        ("arm.mode:foreign:not_controlled", "arm.stop:foreign", *STANDS),
        acknowledged=True,
    ),
    "arm_reduced": _passes("reduced mode for a while", "arm.mode:foreign:reduced"),
    "heartbeat_lost": _stops("no heartbeat of the gripper", "bus.GripperHeartbeat:lost"),
    "status_lost": _stops("no status of the gripper, although its heartbeat comes", "bus.GripperStatus:lost"),
    "status_gap": _passes("no status of the gripper for 0.4 s", "bus.GripperStatus:lost", lasts_s=SHORT_S),
    "bus_silent": _stops("nothing comes over the bus, and nothing goes", "bus.frames:lost"),
    "bus_off": _stops("reading the bus raises", "bus.frames:refused"),
    "bus_silent_short": _lost("nothing comes over the bus, and nothing goes, for 2 s", "bus.frames:lost"),
    "bus_off_short": _lost("reading the bus raises for 2 s, and nothing goes", "bus.frames:refused", "bus.frames:lost"),
    "bus_deaf": _stops("what is sent is lost", "bus.GripperCommand:lost"),
    "status_cut": _passes(
        "the gripper's status is cut to three bytes for 0.4 s", "bus.GripperStatus:cut", lasts_s=SHORT_S
    ),
    "status_twice": _passes("every frame comes twice", "bus.frames:repeated"),
    "gripper_fault": _stops("gFLT 0x0E, overcurrent", "bus.gFLT:foreign:14"),
    "gripper_refuses": _stops("gFLT 7, not activated", "bus.gFLT:foreign:7"),
    "gripper_stopped": _stops("the gripper's node says that it is stopped", "bus.NodeState:foreign:4"),
    "gripper_reboots": FaultKind(
        "the gripper's node starts again; empty, it is acknowledged",
        RECOVERS,
        RESTARTS,
        holding_ends=STOPS,
        acknowledged=True,
    ),
    "camera_dead": _passes("the overhead camera sends nothing for a while", "overhead.frame:lost"),
    "camera_raises": _passes("the overhead camera raises for a while", "overhead.frame:refused"),
    "camera_frozen": _passes("the same image with new numbers and stamps for a while", "overhead.image:stuck"),
    "camera_black": _passes("black images for a while", "overhead.image:lost"),
    "camera_swapped": _passes("red and blue swapped for a while", "overhead.image:flipped:2"),
    "camera_future": _passes("stamps of the future for a while", "overhead.time_s:offset:1000"),
    "sigint": FaultKind("SIGINT", ("interrupted",)),
    "sigterm_twice": FaultKind("SIGTERM, twice", ("interrupted",)),
    "sighup": FaultKind("SIGHUP", ("interrupted",)),
    "observer_raises": FaultKind("an observer raises in every tick", RECOVERS),
    "part_falls": _mishap(
        "the held part slips out of the fingers", "lift carry lower", "noticed by the fingers; another one is fetched"
    ),
    "part_sticks": _mishap(
        "the part stays at a finger that opens, until somebody takes it",
        "lift carry lower",
        "the hole is seen empty, the fingers close and feel the part: it is asked to be taken",
        asks=True,
    ),
    "part_jams": _mishap(
        "the peg does not go into its hole, until it was pulled out again",
        "lift carry",
        "felt; pulled out, and tried once more",
    ),
    "tray_pushed": _mishap(
        "all parts in the tray slide 3 cm", "look above down", "the fingers meet nothing or something else; seen anew"
    ),
    "hole_covered": _mishap(
        "another part comes to lie over the hole as the part is brought",
        "lift carry",
        "felt, or seen; nothing is let go, and it is asked to be cleared",
        asks=True,
    ),
    "part_missing": _mishap(
        "all parts of the type are gone from the tray", "look above down", "seen; it is asked for more", asks=True
    ),
    "part_broken": _mishap(
        "the peg of the part is bent and goes into no hole",
        "look above",
        "felt; after a second try it goes back, and another one is fetched",
    ),
    "part_wrong": _mishap(
        "another type stands where the part was seen", "look above down", "the fingers meet it, or feel its width"
    ),
}


AS_DATA = FaultKind("as data", EITHER)


def signals_of(fault: str, joints: int | None = None) -> tuple[SignalFault, ...]:
    """What is wrong with devices in a fault: one with a name, or one as data.

    Raises:
        InputError: it is neither, or in a joint that an arm of so many does not have.
    """
    if not fault or fault in FAULTS:
        return tuple(SignalFault.parse(text) for text in (FAULTS[fault].signals if fault else ()))
    if ":" not in fault:
        raise InputError(f"unknown fault {fault!r}; legal: {', '.join(FAULTS)}, or DEVICE.SIGNAL:KIND[:SIZE]")
    found = SignalFault.parse(fault)
    if joints is not None and found.joint is not None and found.joint >= joints:
        raise InputError(f"{fault!r}: the arm has joints 0 to {joints - 1}")
    return (found,)
