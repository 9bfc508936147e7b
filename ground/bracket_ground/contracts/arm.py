"""What every `Arm` must do, simulated, or real behind its wires; run by the tests of each; of any number of joints."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bracket_ground.contracts import TICK_S, require_prompt
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.devices import Arm
from bracket_ground.interfaces.observation import ArmState
from bracket_ground.interfaces.pose import Array

OFF_PATH_RAD = 0.025  # what the supervisor allows; figures of one's own are measured elsewhere
ON_PATH_RAD = 0.002
WAY_RAD = (0.5, -0.3, 0.4, 0.8, -0.4, 1.6)  # of the first joints; a seventh and later ones begin again
WAY_S = 2.0  # for all of it: at most 1.5 rad/s and 2.8 rad/s2
SAMPLE_S = 0.008


@dataclass
class Bench:
    """An arm with its clock.

    Attributes:
        stop_by_itself: the arm has a protective stop from now on; None where nothing can cause it.
        share: of speed that each tick allows; None: no tick calls it.
        joints: of the robot; 0 where nobody says.
    """

    arm: Arm
    clock: Clock
    stop_by_itself: Callable[[], None] | None = None
    share: float | None = 1.0
    joints: int = 0

    @property
    def at_rad(self) -> Array:
        """Where the joints are."""
        return np.array(self.arm.state().positions_rad)

    def tick(self) -> ArmState:
        """One tick of a controller."""
        if self.share is not None:
            self.arm.pace(self.share)
        self.clock.sleep_until(self.clock.now_s() + TICK_S)
        return self.arm.state()

    def until(self, done: Callable[[ArmState], bool], limit_s: float = 8.0) -> list[ArmState]:
        """Tick until a state is as wanted; all states on the way."""
        states = [self.tick()]
        until_s = self.clock.now_s() + limit_s
        while not done(states[-1]):
            assert self.clock.now_s() < until_s, f"never: {states[-1]}"
            states.append(self.tick())
        return states

    def rest(self) -> ArmState:
        """Until the arm follows nothing and stands."""
        self.until(lambda state: not state.moving)
        return self.stand()

    def stand(self) -> ArmState:
        """Until the arm has stood for a while."""
        stood = [0]

        def stands(state: ArmState) -> bool:
            stood[0] = stood[0] + 1 if state.stands else 0
            return stood[0] > 3

        return self.until(stands)[-1]

    def way(self, share: float = 1.0) -> JointTrajectory:
        """A motion from here, there or back."""
        here = self.at_rad
        sign = 1.0 if here[-1] < 0 else -1.0
        duration_s = WAY_S * max(share, 0.5)
        times_s = np.linspace(0.0, duration_s, round(duration_s / SAMPLE_S) + 1)
        part = times_s / duration_s
        shares = part**3 * (10 - 15 * part + 6 * part**2)  # from rest to rest, as its acceleration is
        return JointTrajectory(times_s, here + sign * share * np.outer(shares, np.resize(WAY_RAD, len(here))))

    def half_way(self) -> JointTrajectory:
        """Follow a motion to about its middle."""
        path = self.arm.follow(self.way())
        self.until(lambda state: state.path_s is not None and state.path_s > path.duration_s / 3)
        return path


def off_rad(path: JointTrajectory, at_rad: Array) -> float:
    """How far joints are from the nearest place of a path."""
    places = path.along(np.linspace(0.0, path.duration_s, 4001))
    return float(np.abs(places - at_rad).max(axis=1).min())


def check_standing(bench: Bench) -> None:
    """A standing arm tells where it is, and follows nothing."""
    first, state = bench.arm.state(), bench.tick()
    assert isinstance(state, ArmState), f"state gives {state!r}, must give an ArmState"
    count, at_rad = bench.joints or len(first.positions_rad), state.positions_rad
    assert len(at_rad) == count > 0, f"tells {len(at_rad)} joints, the robot has {count}"
    assert len(state.velocities_rad_s) == count
    assert np.isfinite(at_rad).all(), f"tells no number of each joint: {at_rad}"
    assert state.time_s > first.time_s
    assert state.time_s <= bench.clock.now_s() + 0.01
    assert (state.moving, state.mode, state.path_s) == (False, "normal", None)


def check_no_call_waits(bench: Bench) -> None:
    """No call waits: the tree ticks every 40 ms."""
    arm, way = bench.arm, bench.way(0.0)
    assert isinstance(path := arm.follow(way), JointTrajectory), f"follow gives {path!r}, must give the path it follows"
    require_prompt(state=arm.state, pace=lambda: arm.pace(1.0), samples=arm.samples)
    require_prompt(follow=lambda: arm.follow(way), stop=arm.stop)
    bench.rest()


def check_arrival(bench: Bench) -> None:
    """It goes along the path, tells where on it, and is not moving once it is there."""
    path = bench.arm.follow(bench.way())
    states = bench.until(lambda state: not state.moving)
    known = [(state.path_s, state) for state in states if state.path_s is not None and state.moving]
    places = [path_s for path_s, _ in known]
    assert len(known) > 5
    assert all(later >= earlier - 1e-9 for earlier, later in itertools.pairwise(places))
    for path_s, state in known:
        assert np.abs(path.at(path_s) - state.positions_rad).max() < OFF_PATH_RAD
    assert np.abs(bench.at_rad - path.at(path.duration_s)).max() < 0.006
    assert not bench.tick().moving


def check_hold(bench: Bench) -> None:
    """A share of 0 stands on the path, which stays its own; a share above goes on."""
    path, bench.share = bench.half_way(), 0.0
    held = bench.stand()
    assert held.moving
    assert held.path_s is not None
    assert held.path_s < path.duration_s
    assert off_rad(path, bench.at_rad) < ON_PATH_RAD
    bench.share = 0.5
    bench.rest()
    assert np.abs(bench.at_rad - path.at(path.duration_s)).max() < 0.006


def check_silence(bench: Bench) -> None:
    """An arm that hears nothing stands by itself on its path, and goes on when it is spoken to."""
    path, bench.share = bench.half_way(), None
    held = bench.stand()
    assert held.moving
    assert off_rad(path, bench.at_rad) < ON_PATH_RAD
    bench.share = 1.0
    bench.rest()
    assert np.abs(bench.at_rad - path.at(path.duration_s)).max() < 0.006


def check_stop(bench: Bench) -> None:
    """A stop ends on the path, gives it up, and is harmless where the arm stands."""
    path = bench.half_way()
    bench.arm.stop()
    bench.arm.stop()
    bench.rest()
    at_rad = bench.at_rad
    assert off_rad(path, at_rad) < ON_PATH_RAD
    assert np.abs(at_rad - path.at(path.duration_s)).max() > 0.05
    bench.arm.stop()
    for _ in range(5):
        state = bench.tick()
    assert (state.moving, state.path_s) == (False, None)
    assert np.abs(bench.at_rad - at_rad).max() < ON_PATH_RAD


def check_samples(bench: Bench) -> None:
    """Samples increase, and none comes twice."""
    bench.arm.samples()
    bench.arm.follow(bench.way(0.3))
    taken = []
    for _ in range(10):
        bench.tick()
        if (samples := bench.arm.samples()) is not None:
            taken.append(samples)
    bench.rest()
    times = np.concatenate([joint_samples.times_s for joint_samples in taken])
    assert len(times) > 20
    assert (np.diff(times) > 0).all()
    assert all(
        joint_samples.positions_rad.shape
        == joint_samples.velocities_rad_s.shape
        == (len(joint_samples.times_s), len(bench.at_rad))
        for joint_samples in taken
    )


def check_protective_stop(bench: Bench) -> None:
    """It stands, refuses paths, takes orders without a word, and follows again once somebody has acknowledged."""
    assert bench.stop_by_itself is not None
    bench.half_way()
    bench.stop_by_itself()
    stopped = bench.until(lambda state: state.mode != "normal")[-1]
    assert (stopped.mode, bool(stopped.reason)) == ("protective_stop", True)
    bench.stand()
    here = bench.at_rad
    standing = JointTrajectory(np.zeros(1), here[None])
    try:
        bench.arm.follow(standing)
    except DeviceFault:
        pass
    else:
        raise AssertionError("it takes a path after a protective stop that nobody has acknowledged")
    bench.arm.stop()
    bench.arm.acknowledge()
    recovered = bench.until(lambda state: state.mode == "normal", 20.0)[-1]
    assert (recovered.moving, recovered.path_s) == (False, None)
    assert np.abs(bench.at_rad - here).max() < 0.01
    check_arrival(bench)


CHECKS = (
    check_standing, check_no_call_waits, check_arrival, check_hold, check_silence, check_stop, check_samples,
    check_protective_stop,
)  # fmt: skip
