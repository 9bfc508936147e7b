"""One assembly by the simulated person as a camera could have taken it: moments, and the truth about each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.devices import TruthEvent
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_lab.drawing.placed import with_slips
from bracket_lab.drawing.without_physics import LONGEST_S, TAIL_S, KinematicBench
from bracket_sim.devices.arm import servo_lag_s
from bracket_sim.devices.clock import SimClock
from bracket_sim.rendering.camera import Delivery, SimCamera
from bracket_sim.rendering.photographer import Exposure, Photographer, SensorSetup
from bracket_sim.rendering.studio import visible_poses
from bracket_sim.scene.hand import Hand, add_hand
from bracket_sim.scene.look import Look
from bracket_sim.scene.settings import SimSettings
from bracket_sim.scene.storage import lay_out
from bracket_sim.scene.world import World, build_world
from bracket_sim.truth.labels import Label, guarded, labels
from bracket_sim.worker.event_log import ActionEvent
from bracket_sim.worker.handing import Giver, parts_in_tray
from bracket_sim.worker.worker import Worker

CAMERA = "overhead"
REACH_M = 0.10  # a held part's origin is so near to the fingertips
STAYS_M, MOVES_M = 0.012, 0.002  # from frame to frame: against the fingertips, and over the bench
RELEASE_S = 0.07


@dataclass(frozen=True, eq=False)
class Moment:
    """What was so when a frame was taken.

    Attributes:
        exposure: what the frame is made from.
        fingertips_m, palm_m: (3,) in the world frame.
        parts_m: (parts, 3) where every part of the world was, in the order of `World.bodies`.
        upright: (parts,) cosine of its tilt.
    """

    exposure: Exposure
    fingertips_m: Array
    palm_m: Array
    parts_m: Array
    upright: Array

    @property
    def time_s(self) -> float:
        """When the shutter closed."""
        return self.exposure.time_s


@dataclass(frozen=True)
class Assembly:
    """All moments of one assembly at the camera's rate, with their labels.

    Attributes:
        labels: class of each moment; a segment has the class of its last one.
        guarded: (moments,) whether a change of class is so near that nobody could name it.
        held: type of the part in the hand, by moment.
        robot_works: the controller moved the arm: where the arm is, is as true as where the hand is.
    """

    seed: int
    goal: str
    look: Look
    world: World
    moments: tuple[Moment, ...]
    labels: tuple[Label, ...]
    guarded: tuple[bool, ...]
    held: tuple[str | None, ...]
    robot_works: bool = False

    def photographer(self, bench: Bench) -> Photographer:
        """Who makes the frames of chosen moments, in their order; close it."""
        rng = np.random.default_rng([self.seed, 2])
        return Photographer(self.world.model, {CAMERA: SensorSetup(bench.overhead, self.look.camera, rng)})


@dataclass(frozen=True)
class Source:
    """Where rows come from: one assembly on one bench."""

    assembly: Assembly
    product: Product
    bench: Bench

    @property
    def name(self) -> str:
        """Of the recording, in rows and file names."""
        return f"seed{self.assembly.seed:06d}"

    @property
    def holes_m(self) -> Array:
        """(holes, 2) where they are on the bench."""
        holes = np.array([[*xy, 0.0] for xy in self.product.bracket.holes_m.values()])
        found: Array = self.bench.bracket.pose.transform(holes)[:, :2]
        return found


def record(product: Product, bench: Bench, settings: SimSettings, seed: int, *, physics: bool = False) -> Assembly:
    """One assembly; look, person's habits and goal are drawn from the seed.

    Args:
        physics: with friction, gravity and motion blur, 16 times real time at best; else by rule, much faster.
    """
    look, goal = settings.look.draw(seed), drawn_goal(product, seed)
    if physics:
        film, worker = _with_physics(product, bench, settings, look, goal, seed)
        by_fingers = film.assembly(seed, goal, look, worker.events, worker.acts)
        acts = with_slips(worker.acts, Source(by_fingers, product, bench))
        return film.assembly(seed, goal, look, worker.events, acts)
    table = KinematicBench(product, bench, settings.person, look)
    film = Film(table.world)
    taken = table.record(goal, seed, bench.overhead.rate_hz, film.expose)
    return film.assembly(seed, goal, look, taken.actions, taken.acts)


def drawn_goal(product: Product, seed: int) -> str:
    """What the person builds in a recording of this seed."""
    return sorted(product.goals)[int(np.random.default_rng([seed, 1]).integers(len(product.goals)))]


class Film:
    """Keeps exposures of a world with a hand, and where hand and parts were."""

    def __init__(self, world: World) -> None:
        self._world, self._hand = world, Hand(world.model, world.data)
        self._bodies = [part.body for part in world.bodies]
        self._moments: list[Moment] = []

    def expose(self, time_s: float) -> None:
        """Take the world as it is now."""
        pose = self._world.camera_pose(CAMERA)
        self._world.pose_hand()
        self.keep(Exposure(CAMERA, len(self._moments), time_s, pose, (visible_poses(self._world.data),)))

    def keep(self, exposure: Exposure) -> Frame:
        """Stands in for a photographer: frames are made later, and only those that are wanted."""
        data, hand = self._world.data, self._hand
        parts_m, upright = data.xpos[self._bodies].copy(), data.xmat[self._bodies][:, 8].copy()
        self._moments.append(Moment(exposure, hand.position_m, hand.palm_m, parts_m, upright))
        return Frame(CAMERA, exposure.sequence, exposure.time_s, np.zeros((0, 0, 3), np.uint8), Pose((0, 0, 0)))

    def assembly(
        self,
        seed: int,
        goal: str,
        look: Look,
        actions: Sequence[ActionEvent],
        acts: Sequence[TruthEvent],
        *,
        robot_works: bool = False,
    ) -> Assembly:
        """All exposures with their labels, by what the hand really did."""
        moments = tuple(self._moments)
        times_s: Array = np.array([moment.time_s for moment in moments])
        found = labels(actions, acts, times_s)
        near = tuple(bool(value) for value in guarded(found, times_s))
        held = _held(self._world, moments, acts)
        return Assembly(seed, goal, look, self._world, moments, tuple(found), near, held, robot_works)


def _with_physics(
    product: Product, bench: Bench, settings: SimSettings, look: Look, goal: str, seed: int
) -> tuple[Film, Worker]:
    """Parts are carried by friction, in the hand and in the gripper of an arm that hands some of them over."""
    streams = [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(4)]
    layout = lay_out(product, bench, settings.person.storage, streams[0], handing=True)
    hand = partial(add_hand, bench=bench, person=look.person, habits=settings.person)
    world = build_world(product, bench, layout.parts, settings.physics, hand, look, layout.bins)
    worker = Worker(world, product, bench, settings.person, product.goal_placements(goal), streams[1], streams[0])
    world.settle()
    giver = Giver(world, parts_in_tray(world), worker.has, streams[3])
    film = Film(world)
    camera = SimCamera(CAMERA, bench.overhead, world, film.keep, Delivery(look.camera, 0.0, streams[2]))
    clock = SimClock(world, [_Servos(world, giver), worker], [camera])
    while not (worker.done and giver.done) and clock.now_s() < LONGEST_S:
        clock.sleep_until(clock.now_s() + TAIL_S)
    clock.sleep_until(clock.now_s() + TAIL_S)
    return film, worker


class _Servos:
    """Drives the arm and the gripper as a script says."""

    def __init__(self, world: World, giver: Giver) -> None:
        self._world, self._giver, self._lag_s = world, giver, servo_lag_s(world)

    def update(self, time_s: float, dt_s: float) -> None:  # noqa: ARG002
        """Set the servos for one control period."""
        giver, world = self._giver, self._world
        giver.advance(dt_s)
        world.data.ctrl[world.arm_ctrl] = giver.joints_rad + giver.speeds_rad_s * self._lag_s
        world.drive_opening(giver.opening_m)


def _held(world: World, moments: Sequence[Moment], acts: Sequence[TruthEvent]) -> tuple[str | None, ...]:
    """The part in the hand, by moment: it moves with the fingertips, or stays with them, until it is let go."""
    released_s = [act.time_s for act in acts if act.fields.get("act") == "release"]
    found: list[int | None] = [None]
    for before, now in pairwise(moments):
        let_go = any(before.time_s - RELEASE_S < time_s <= now.time_s for time_s in released_s)
        seen_m, seen_before_m = now.parts_m - now.fingertips_m, before.parts_m - before.fingertips_m
        near = np.linalg.norm(seen_m, axis=1) < REACH_M
        stays = np.linalg.norm(seen_m - seen_before_m, axis=1) < STAYS_M
        moves = np.linalg.norm(now.parts_m - before.parts_m, axis=1) > MOVES_M
        moves |= np.arange(len(moves)) == (-1 if found[-1] is None else found[-1])
        carried = np.flatnonzero(near & stays & moves)
        found.append(None if let_go or not len(carried) else int(carried[0]))
    return tuple(None if index is None else world.bodies[index].part for index in found)
