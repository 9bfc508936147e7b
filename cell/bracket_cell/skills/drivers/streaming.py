"""An arm whose controller takes a set point in each of its periods: what every driver of such an arm needs.

Set points are streamed by a process of its own, which stands on the path by itself when nobody speaks to it; samples
are received by a thread. A driver says how both connect, and how an arm is brought back that stopped.

States, as `ArmState` tells them, and how one leads to the next:

    normal, standing --follow--> normal, moving --end or stop--> normal, standing
    normal --pace(0), or nobody speaks for KEEP_ALIVE_S--> normal, moving, at rest on its path --pace--> goes on
    normal --samples do not come--> the newest state, old, with `reason`: a hold --they come--> normal
    normal --the controller stops, or the link is lost--> its mode, or not_controlled: `let_go`, the path is given up
    stopped --acknowledge--> `bring_back`, beside the loop --done--> normal, standing; else stopped, why in `reason`
    safeguard_stop --the safeguard closes--> safeguard_closed --acknowledge--> normal, on the path that it was held on
"""

from __future__ import annotations

import math
import pickle
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bracket_cell.remote.channel import Channel, Message
from bracket_cell.remote.child import Child
from bracket_cell.skills.drivers import stream as said
from bracket_cell.skills.drivers.samples import Connection, Sample, SampleReceiver
from bracket_cell.skills.drivers.speed_limits import SpeedLimits, share_at
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.observation import STALE_ARM_S, ArmMode, ArmState, JointSamples
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.robot import RobotModel

SILENT_S = 0.1  # a process that sends nothing for this long sends no set points
OPENING_S, LEAVING_S = 10.0, 3.0
SETTLED_RAD_S, SETTLES_S = 0.01, 0.5  # an arm whose set points stand has come to rest when it is so slow, or then
PROJECTED_S, UNSURE_RAD = 0.02, 0.002  # how far time and joints may err where a sample's place on the path is told
MAY_MOVE = ("normal", "reduced")


@dataclass
class Stream:
    """A running process that streams, and what it told.

    Attributes:
        sent: newest set points of the path that was begun last, oldest first.
        paths: how many were begun.
        lost: why it streams no more; empty while it does.
        heard_s: time of the machine of the newest set point.
        listened_s: time of the machine when it was listened to last; what came after a long time says that it lives.
        begun: one was told.
        made_s: time of the machine when it began.
        took: the controller took set points once.
    """

    child: Child
    channel: Channel[Any]
    sent: deque[said.Sent] = field(default_factory=lambda: deque(maxlen=512))
    paths: int = 0
    lost: str = ""
    heard_s: float = field(default_factory=time.monotonic)
    listened_s: float = field(default_factory=time.monotonic)
    begun: bool = False
    made_s: float = field(default_factory=time.monotonic)
    took: bool = False

    def hear(self, slower: float) -> None:
        """Take what it told; notice when it is silent, stopped or gone."""
        if self.lost:
            return
        before_s, self.listened_s, came = self.listened_s, time.monotonic(), False
        try:
            while (message := self.channel.taken()) is not None:
                came = True
                if isinstance(message, said.Lost):
                    self.lost = message.reason
                    return
                if isinstance(message, said.Sent):
                    self.heard_s, self.begun = message.time_s, True
                    if message.path == self.paths:
                        self.sent.append(message)
        except EOFError:
            self.lost = f"the {self.child.name} died"
            return
        if came and self.listened_s - before_s > SILENT_S * slower:  # what it told last had no room
            self.heard_s = self.listened_s
        silent_s = (self.listened_s - self.heard_s) / slower
        if silent_s > (SILENT_S if self.begun else 3 * SILENT_S):
            self.lost = f"the {self.child.name} sent no set point for {silent_s:.2f} s"

    def paused(self, sample: Sample, slower: float) -> bool:
        """Whether the controller's program takes no set points; it may begin to a moment after the link was made."""
        self.took = self.took or sample.takes or time.monotonic() - self.made_s > SETTLES_S * slower
        return self.took and not sample.takes

    def begin(self, trajectory: JointTrajectory, from_s: float = 0.0) -> None:
        """Let it follow a path; what it told of the one before says nothing about this one."""
        self.paths += 1
        self.sent.clear()
        self.say(said.Begin(trajectory, from_s))

    def say(self, message: Message) -> None:
        """Tell it something; a process that is gone shows in `hear`."""
        with suppress(EOFError, TimeoutError):
            self.channel.send(message, 0.01)

    def close(self, limit_s: float) -> None:
        """Let it stand on the path and leave."""
        self.say(said.Leave())
        self.child.code(limit_s)
        self.child.close()


class StreamingArm(ABC):
    """Implements `Arm`; a driver's class adds `connect`, `link`, and what its arm needs to be brought back.

    Attributes:
        goes_on_s: for so long it goes on along its path without further set points, as one that has pieces of it.

    Args:
        at: where the controller is, for messages.
        lag_s: by how much the joints trail their set points.

    Raises:
        DeviceFault: the controller does not answer, or somebody must do something at the arm first.
    """

    goes_on_s = 0.0

    def __init__(self, clock: Clock, robot: RobotModel, at: str, lag_s: float) -> None:
        self.slower: float = getattr(clock, "slower", 1.0)
        self._clock, self._lag_s = clock, lag_s
        self._acceleration_rad_s2 = np.array(robot.acceleration_rad_s2)
        self._speed_limits = SpeedLimits(robot)
        self._asked, self._shares = 0.0, dict[str, Array]()  # of the speed, as asked for and as limited on the path
        self._stream: Stream | None = None
        self._path: JointTrajectory | None = None
        self._path_s: float | None = None  # where on it the arm was last seen
        self._stopped: tuple[ArmMode, str] | None = None  # until it is brought back
        self._letting_go = self._bringing = threading.Thread()
        self._last_s = -np.inf
        self._receiver = SampleReceiver(self.connect, clock, at, self.slower)
        try:
            if (sample := self._receiver.newest).mode not in MAY_MOVE:
                raise DeviceFault("arm", f"{sample.reason}: see to that at the pendant, then run again")
            self._open()
        except DeviceFault:
            self._receiver.close()
            raise

    @property
    def period_s(self) -> float:
        """In which the controller wants set points."""
        return self._receiver.period_s

    @abstractmethod
    def connect(self) -> Connection[Sample]:
        """A connection on which the controller tells its samples.

        Raises:
            OSError: nobody answers.
            DeviceFault: it is no such controller.
        """

    @abstractmethod
    def link(self) -> Callable[[], said.Link]:
        """What connects in the process that streams; it goes there pickled, so that it is no lambda."""

    def another_way(self, refused: str) -> bool:  # noqa: ARG002 - for drivers that have one
        """Whether `link` has another way, now that the first was refused for this reason."""
        return False

    def let_go(self) -> None:  # noqa: B027 - a hook that most arms need not
        """The arm stopped: see to it that nothing goes on by itself; beside the loop, raises nothing."""

    def bring_back(self) -> None:  # noqa: B027 - likewise
        """Make the arm ready for set points again after a stop; beside the loop, may take seconds.

        Raises:
            DeviceFault: a person must do something first; the words say what.
        """

    def load(self, mass_kg: float, centre_m: tuple[float, float, float]) -> None:
        """Tell the controller what hangs on the flange."""
        if self._stream is not None:
            self._stream.say(said.Payload(mass_kg, centre_m))

    def state(self) -> ArmState:
        """Joints of the newest sample; where none comes it is old, and `reason` says why."""
        sample = self._receiver.newest
        mode, reason = self._mode(sample)
        if not reason and self._clock.now_s() - sample.time_s > STALE_ARM_S:
            reason = self._receiver.trouble or "no sample came"
        moving, path_s = self._followed(sample)
        positions, speeds = tuple(sample.positions_rad.tolist()), tuple(sample.velocities_rad_s.tolist())
        x, y, z = sample.force_n.tolist()
        return ArmState(sample.time_s, positions, speeds, moving, mode, path_s, reason, (x, y, z))

    def follow(self, trajectory: JointTrajectory) -> JointTrajectory:
        """Start now; raises DeviceFault while the arm takes no commands."""
        mode, reason = self._mode(self._receiver.newest)
        if mode not in MAY_MOVE or self._stream is None:
            raise DeviceFault("arm", reason or f"it is in the mode {mode}")
        self._path, self._path_s = trajectory, 0.0
        self._shares = self._speed_limits.shares(trajectory)
        self._stream.say(said.Share(self._share))
        self._stream.begin(trajectory)
        return trajectory

    def pace(self, share: float) -> None:
        """Go on at this share of the speed, within the controller's limits, and as slow as the pendant's slider."""
        self._asked = share
        if self._stream is not None:
            self._stream.say(said.Share(self._share))

    @property
    def _share(self) -> float:
        """Of the path's own speed, that is sent."""
        sample, path_s = self._receiver.newest, self._path_s
        shares = self._shares.get(sample.mode)
        limited = 1.0 if shares is None or self._path is None or path_s is None else share_at(shares, path_s)
        return min(self._asked, limited, sample.speed_share)

    def stop(self) -> None:
        """Stop on the path and give it up."""
        if self._stream is not None:
            self._stream.say(said.Stop())
        if self._stopped is not None:
            self._path = None

    def acknowledge(self) -> None:
        """Begin to bring an arm back that stopped, but for an open safeguard; its mode stays until that is done."""
        held = self._stopped is None or self._stopped[0] == "safeguard_stop" or self._bringing.is_alive()
        if not held:
            self._bringing = threading.Thread(target=self._brought_back, name="bring back", daemon=True)
            self._bringing.start()

    def samples(self) -> JointSamples | None:
        """Every sample since the last call; moments are what the controller reckons."""
        taken = [sample for sample in self._receiver.taken() if sample.time_s > self._last_s]
        if not taken:
            return None
        self._last_s = taken[-1].time_s
        columns = (
            [getattr(sample, name) for sample in taken] for name in ("positions_rad", "velocities_rad_s", "moments_nm")
        )
        return JointSamples(np.array([sample.time_s for sample in taken]), *map(np.array, columns))

    def close(self) -> None:
        """The arm stands on its path, its program ends; harmless when repeated."""
        for thread in (self._letting_go, self._bringing):
            if thread.is_alive():
                thread.join(LEAVING_S * self.slower)
        if self._stream is not None:
            self._stream.close(LEAVING_S * self.slower)
            self._stream = None
        self._receiver.close()

    def _mode(self, sample: Sample) -> tuple[ArmMode, str]:
        """The mode as it is told, with why; an arm that stopped keeps its mode until it is brought back."""
        stopped = self._why_stopped(sample)
        if stopped is not None and (self._stopped is None or stopped[0] != self._stopped[0]):
            self._note(*stopped)
        if self._stopped is None:
            return sample.mode, ""
        if self._stopped[0] == "safeguard_stop" and sample.mode in MAY_MOVE:
            self._stopped = "safeguard_closed", "the safeguard is closed again"
        return self._stopped

    def _why_stopped(self, sample: Sample) -> tuple[ArmMode, str] | None:
        """What keeps the arm from moving, the gravest first; None where nothing new does."""
        if sample.mode not in (*MAY_MOVE, "not_controlled"):
            return sample.mode, sample.reason
        if self._stopped is not None:
            return None
        if sample.mode == "not_controlled":
            return sample.mode, sample.reason
        if self._stream is not None:
            self._stream.hear(self.slower)
        lost = "no program runs" if self._stream is None else self._stream.lost
        if lost or (self._stream is not None and self._stream.paused(sample, self.slower)):
            return "not_controlled", lost or "somebody stopped or paused its program"
        return None

    def _note(self, mode: ArmMode, reason: str) -> None:
        """The arm stopped: nothing may go on by itself, whoever presses play."""
        began, self._stopped = self._stopped is None, (mode, reason)
        if mode != "safeguard_stop":
            self._path = None
        if began:
            stream, self._stream = self._stream, None
            self._letting_go = threading.Thread(target=self._let_go, args=(stream,), daemon=True)
            self._letting_go.start()

    def _let_go(self, stream: Stream | None) -> None:
        self.let_go()
        if stream is not None:
            stream.close(1.0)

    def _brought_back(self) -> None:
        """Beside the loop, once at a time."""
        assert self._stopped is not None
        mode = self._stopped[0]
        if self._letting_go.is_alive():
            self._letting_go.join()
        try:
            self.bring_back()
            self._open()
        except DeviceFault as error:
            self._stopped = mode, error.reason
            return
        self._stopped = None

    def _open(self) -> None:
        """A process that streams from where the arm stands, and goes on with a path that it was held on.

        Raises:
            DeviceFault: the controller takes no program.
        """
        stream = self._opened()
        if stream.lost and self.another_way(stream.lost):
            stream = self._opened()
        if stream.lost:
            raise DeviceFault("arm", f"the controller takes no program: {stream.lost}")
        sample = self._receiver.newest
        stream.say(said.Start(sample.positions_rad, self._acceleration_rad_s2))
        path, path_s = self._path, self._path_s
        if path is not None and path_s is not None:
            stream.begin(path, path_s)
        stream.heard_s = stream.made_s = time.monotonic()
        self._stream = stream

    def _opened(self) -> Stream:
        serve = partial(said.serve, pickle.dumps(self.link()), _folder(type(self)), self.period_s, self.slower)
        child = Child("process that streams set points", serve, outlives=True)
        stream = Stream(child, Channel(child.socket, said.FromStream))
        try:
            first = stream.channel.receive(OPENING_S * self.slower)
            stream.lost = first.reason if isinstance(first, said.Lost) else ""
        except (EOFError, TimeoutError) as error:
            stream.lost = str(error) or f"it is not ready after {OPENING_S:g} s"
        if stream.lost:
            child.close()
        return stream

    def _followed(self, sample: Sample) -> tuple[bool, float | None]:
        """Whether the arm is on its way, and where on its path it was when the sample was taken.

        The joints trail the set points by a time that belongs to the controller, and grows where the pendant's slider
        goes down. The place is the nearest one on the path between where the arm was seen before and the set point.
        """
        path = self._path
        if path is None:
            return False, None
        if self._stopped is not None:  # it comes to rest without set points
            at_s = self._path_s or 0.0
            self._path_s = nearest_s(path, (at_s, at_s), at_s, sample)
            return True, self._path_s
        stream = self._stream
        if stream is None or not stream.sent:
            return True, self._path_s
        now_s, machine_s = self._clock.now_s(), time.monotonic()
        times_s = np.array([now_s - (machine_s - sent.time_s) / self.slower for sent in stream.sent])
        rates = max(self._receiver.newest.speed_share, 0.05)
        lag_s = self._lag_s / rates
        newest = stream.sent[-1]
        ended = newest.path_s is None
        places_s = [sent.path_s for sent in stream.sent if sent.path_s is not None]
        about_s, farthest_s = self._places_s(sample.time_s - np.array([lag_s, 0.0]), times_s, places_s, newest.moving)
        done_s = next((t for t, sent in zip(times_s, stream.sent, strict=True) if not sent.moving), np.inf)
        settled = float(np.abs(sample.velocities_rad_s).max()) < SETTLED_RAD_S and sample.time_s > done_s + lag_s
        moving = newest.moving or not (settled or sample.time_s > done_s + SETTLES_S)
        if ended and not moving:
            self._path = self._path_s = None
            return False, None
        farthest_s = min(path.duration_s, path.duration_s if ended else max(*places_s, farthest_s))
        self._path_s = nearest_s(path, (self._path_s or 0.0, farthest_s), about_s, sample)
        return moving, self._path_s

    def _places_s(self, at_s: Array, times_s: Array, places_s: list[float], moving: bool) -> tuple[float, float]:
        """Places on the path at two times, by set points; an arm that goes on by itself does so at their last pace."""
        if not places_s:
            return 0.0, 0.0
        times_s, places = times_s[: len(places_s)], np.array(places_s)
        if moving and self.goes_on_s and len(places) > 1 and times_s[-1] > times_s[-2]:
            rate = min(max((places[-1] - places[-2]) / (times_s[-1] - times_s[-2]), 0.0), 1.0)
            times_s = np.append(times_s, times_s[-1] + self.goes_on_s)
            places = np.append(places, places[-1] + rate * self.goes_on_s)
        first, last = np.interp(at_s, times_s, places).tolist()
        return first, last


def _folder(driver: type) -> str:
    """Where a module lies that is none of a package: the process that streams looks for it there; else empty."""
    file = getattr(sys.modules[driver.__module__], "__file__", None)
    return "" if file is None or "." in driver.__module__ else str(Path(file).resolve().parent)


def nearest_s(path: JointTrajectory, between_s: tuple[float, float], about_s: float, sample: Sample) -> float:
    """The place on the path where the arm is, by joints and time: where the path hardly moves, joints tell little.

    Args:
        between_s: where it may be, give or take 20 ms.
        about_s: where time has it.
    """
    first_s, last_s = np.clip([between_s[0] - PROJECTED_S, between_s[1] + PROJECTED_S], 0.0, path.duration_s)
    about_s = min(max(about_s, first_s), last_s)
    marks_s = np.linspace(first_s, last_s, math.ceil((last_s - first_s) / PROJECTED_S) + 1)
    off = np.linalg.norm(path.along(marks_s) - sample.positions_rad, axis=1) / UNSURE_RAD
    near_s = float(marks_s[np.hypot(off, (marks_s - about_s) / PROJECTED_S).argmin()])
    before, here, after = path.along(near_s + np.array([-0.5, 0.0, 0.5]) * PROJECTED_S)
    speed = (after - before) / PROJECTED_S / UNSURE_RAD
    ahead = speed @ (sample.positions_rad - here) / UNSURE_RAD + (about_s - near_s) / PROJECTED_S**2
    return float(np.clip(near_s + ahead / (speed @ speed + PROJECTED_S**-2), first_s, last_s))
