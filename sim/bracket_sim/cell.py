"""Opens the simulated cell: world, devices and the person at the bench on one clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np

from bracket_cell.remote.detecting import DetectByCamera
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.devices import Devices, EmptyPanel, TruthEvent
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.robot import RobotModel
from bracket_sim.devices.arm import SimArm
from bracket_sim.devices.clock import Actor, Observer, SimClock
from bracket_sim.devices.sensed_arm import SensedArm
from bracket_sim.devices.signal_node import SignalNode
from bracket_sim.devices.simulated_gripper import GripperNode, SimGripper
from bracket_sim.rendering.camera import Delivery, SimCamera
from bracket_sim.rendering.photographer import Photographer, SensorSetup
from bracket_sim.rendering.render_process import RenderProcess
from bracket_sim.scene.clutter import full_set, sample_clutter
from bracket_sim.scene.hand import add_hand
from bracket_sim.scene.jobs import Jobs
from bracket_sim.scene.look import Look
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.person import Storage
from bracket_sim.scene.settings import HARDWARE, SimSettings
from bracket_sim.scene.storage import at_places, begun, lay_out
from bracket_sim.scene.wholes import Joining
from bracket_sim.scene.world import World, build_world
from bracket_sim.truth.contacts import ContactMonitor
from bracket_sim.truth.ground_truth_perception import ground_truth_perception
from bracket_sim.truth.labels import resting_event, resting_parts
from bracket_sim.truth.score import Score
from bracket_sim.worker.hands import Hands
from bracket_sim.worker.mishaps import Mishaps
from bracket_sim.worker.stock import Stock
from bracket_sim.worker.worker import Worker, WorkerContext


class DrivenArm(Actor, Observer, Protocol):
    """What drives the joints once a control period, and measures them.

    Attributes:
        driven_rad_s: how fast the servos' set points move, (n,).
    """

    driven_rad_s: Array


class RandomStreams(NamedTuple):
    """A generator of its own for each purpose, so that none changes what another draws.

    Attributes:
        person: motions, and the order of work.
        habits: what not every person does, and where their parts lie.
        overhead, wrist: the sensors' noise.
        overhead_delivery, wrist_delivery: late and lost frames.
        stock: errands, answers, and how trays are filled again.
        other_hands: what hands beside the first one do.
    """

    jobs: np.random.Generator
    clutter: np.random.Generator
    person: np.random.Generator
    overhead: np.random.Generator
    wrist: np.random.Generator
    habits: np.random.Generator
    overhead_delivery: np.random.Generator
    wrist_delivery: np.random.Generator
    arm: np.random.Generator
    stock: np.random.Generator
    other_hands: np.random.Generator

    @classmethod
    def of(cls, seed: int) -> RandomStreams:
        """Those of a run."""
        return cls(*map(np.random.default_rng, np.random.SeedSequence(seed).spawn(len(cls._fields))))


class SimCell:
    """Everything that belongs to one simulated run.

    Args:
        goal: the configuration that the person assembles; "random" lets the seed choose.
        seed: the same seed gives the same scene, noise and person.
        worker: with the person and their parts in the bins, or the robot alone.
        clutter: parts in the tray; by default one product's set, cluttered at random.
        overlap: frames in a process of their own, detectors in another, beside the physics; what comes out is the same.
        detect: makes the detectors that run there; none by default.
        rendered: with images; without, `sight` tells what the cameras would have seen.
        watched: cameras make frames; without, faster.
        robot: the arm; by default the UR10.
        arm: makes what drives the joints; by default an arm that follows joint trajectories.

    Attributes:
        look: drawn by the seed from the settings' range.
        other_hands: of the person, and of who stands beside them.
        world, score, contacts, gripper_node, worker, sight: for tests and trials; the controller gets `devices` alone.
    """

    def __init__(
        self,
        product: Product,
        bench: Bench,
        settings: SimSettings,
        can_interface: str,
        can_channel: str,
        seed: int,
        goal: str,
        *,
        worker: bool = True,
        clutter: Sequence[ScenePart] | None = None,
        overlap: bool = False,
        rendered: bool = True,
        watched: bool = True,
        robot: RobotModel | None = None,
        detect: Callable[[], DetectByCamera] | None = None,
        arm: Callable[[World], DrivenArm] | None = None,
    ) -> None:
        chance = RandomStreams.of(seed)
        self._furnish(product, bench, settings, seed, goal, chance, clutter, robot, worker=worker)
        around = WorkerContext(self.stock, self._change, settings.shift, chance.stock, settings.people)
        wanted, person, hands = self._job.placements, settings.person, Hands()
        self.worker = (
            Worker(self.world, product, bench, person, wanted, chance.person, chance.habits, around, hands=hands)
            if worker
            else None
        )
        self.other_hands: list[Worker] = []
        for number, other in enumerate(person.other_hands if worker else (), 1):
            moves, does = chance.other_hands.spawn(2)
            hand = Worker(self.world, product, bench, person, wanted, moves, does, None, number, hands)
            hand.away = not other.acts
            self.other_hands.append(hand)
        self.world.settle()
        self._resting = [resting_event(resting_part) for resting_part in resting_parts(self.world)]
        self.arm = SimArm(self.world, trailing_s=settings.hardware.trailing_s)
        sensed = _sensed(self.arm, settings, chance.arm)
        driven: DrivenArm = self.arm if arm is None else arm(self.world)
        self.gripper_node = GripperNode(self.world, can_interface, can_channel)
        self.signal_node = None if settings.signals is None else SignalNode(settings.signals)
        self.score = Score(self.world, self._job)
        self.contacts = ContactMonitor(self.world, lambda: driven.driven_rad_s) if worker else None
        beside = self._open_eyes(bench, chance, worker, rendered, overlap, detect)
        cameras = self._cameras(bench, settings.hardware.camera_latency_s, chance)
        acting: Actor = sensed if arm is None else driven
        host = beside if beside is not None and beside.detects else None
        self.devices = self._devices(sensed, self._clock(acting, driven, cameras if watched else {}), cameras, host)

    def _furnish(
        self,
        product: Product,
        bench: Bench,
        settings: SimSettings,
        seed: int,
        goal: str,
        chance: RandomStreams,
        clutter: Sequence[ScenePart] | None,
        robot: RobotModel | None,
        *,
        worker: bool,
    ) -> None:
        """The first job, the look, and the world with what lies in it."""
        self.look = settings.look.draw(seed)
        self._jobs = Jobs(product, goal, settings.person.shift.new_goals if settings.shift else 0.0, chance.jobs)
        self._job = self._jobs.next()
        self._finished: list[dict[str, object]] = []
        self._nobody = worker and settings.person.absent  # then nobody says which bracket would be right
        if clutter is None:
            clutter = sample_clutter(product, bench.tray, full_set(product), chance.clutter, settings.clutter)
        wanted = self._job.placements if worker else {}
        self.world = _world(product, bench, settings, self.look, clutter, chance.habits, wanted, robot)
        self.stock = Stock(self.world, product, bench, settings.clutter, chance.stock)
        if (types := settings.person.storage.types) is not None:
            own = set(chance.stock.permutation(list(product.parts))[:types].tolist())
            theirs = (body for body in self.world.bodies if body.owner == "person")
            self.stock.take([body for body in theirs if body.part not in own])
        self._mishaps = Mishaps(self.world, self.stock)

    def _open_eyes(
        self,
        bench: Bench,
        chance: RandomStreams,
        hand: bool,
        rendered: bool,
        overlap: bool,
        detect: Callable[[], DetectByCamera] | None,
    ) -> RenderProcess | None:
        """Choose what takes the images; the process that renders them, where it is one of its own."""
        sensors = {
            "overhead": SensorSetup(bench.overhead, self.look.camera, chance.overhead),
            "wrist": SensorSetup(bench.wrist, self.look.camera, chance.wrist),
        }
        beside = RenderProcess(self.world.model, sensors, detect) if overlap and rendered else None
        self.sight = None if rendered else ground_truth_perception(self.world, sensors, hand=hand)
        self._photographer = self.sight or beside or Photographer(self.world.model, sensors)
        return beside

    def _cameras(self, bench: Bench, latency_s: float, chance: RandomStreams) -> dict[str, SimCamera]:
        """Overhead and wrist camera, each with its own chance of late and lost frames."""
        of = {"overhead": (bench.overhead, chance.overhead_delivery), "wrist": (bench.wrist, chance.wrist_delivery)}
        look, take = self.look.camera, self._photographer.take
        return {
            name: SimCamera(name, setup, self.world, take, Delivery(look, latency_s, rng))
            for name, (setup, rng) in of.items()
        }

    def _clock(self, arm: Actor, driven: DrivenArm, cameras: Mapping[str, SimCamera]) -> SimClock:
        """Simulated time, in which all that acts and samples goes on."""
        nodes = [node for node in (self.signal_node, self.worker) if node is not None] + self.other_hands
        samplers: list[Observer] = [driven, *([self.contacts] if self.contacts is not None else [])]
        actors: list[Actor] = [arm, self.gripper_node, self.stock, self._mishaps, Joining(self.world), *nodes]
        return SimClock(self.world, actors, [self.score, *cameras.values()], samplers)

    def _devices(
        self, arm: SimArm | SensedArm, clock: SimClock, cameras: Mapping[str, SimCamera], host: RenderProcess | None
    ) -> Devices:
        """What the controller gets."""
        return Devices(
            clock=clock,
            arm=arm,
            gripper=SimGripper(self.gripper_node),
            overhead=cameras["overhead"],
            wrist=cameras["wrist"],
            panel=self.worker or EmptyPanel(),
            report=self.report,
            close=self.close,
            truth=self.truth,
            host=host,
            pressed=self.worker.pressed if self.worker is not None else tuple,
            finished=lambda: self._finished,
            free_running=self._run_freely,
            upset=self._mishaps.begin,
        )

    def report(self) -> dict[str, object]:
        """Keys of `cell run --json` that only the truth can give."""
        report = self.score.report() | (self.contacts.report() if self.contacts is not None else {})
        return report | ({"correct": None, "wrong_placements": None} if self._nobody else {})

    def await_ready(self) -> None:
        """Until frames can be made and answered; raises CellError."""
        if isinstance(self._photographer, RenderProcess):
            self._photographer.await_ready()

    def _run_freely(self, free: bool) -> None:
        if isinstance(self._photographer, RenderProcess):
            self._photographer.hurried = free

    def _change(self) -> Mapping[str, str]:
        """The person takes the bracket out: judge it, and tell what is to be built next."""
        self._finished.append(self.report())
        self._job = self._jobs.next()
        self.score.begin(self._job)
        for other_hand in self.other_hands:
            other_hand.begin(self._job.placements)
        return self._job.placements

    def truth(self) -> list[TruthEvent]:
        """What happened at the bench since the last call, in order."""
        resting, self._resting = self._resting, []
        acts, contacts = self.worker.news() if self.worker else [], self.contacts.news() if self.contacts else []
        others = [replace(act, kind="other hand") for other_hand in self.other_hands for act in other_hand.news()]
        news = [*resting, *acts, *others, *contacts]
        return sorted(news, key=lambda event: event.time_s)

    def close(self) -> None:
        """Let go of the bus and of what makes the frames."""
        self.gripper_node.close()
        if self.signal_node is not None:
            self.signal_node.close()
        self._photographer.close()


def _world(
    product: Product,
    bench: Bench,
    settings: SimSettings,
    look: Look,
    clutter: Sequence[ScenePart],
    rng: np.random.Generator,
    wanted: Mapping[str, str],
    robot: RobotModel | None,
) -> World:
    """Bench and parts, with the hand where a person builds what is wanted; `rng` says where the person's parts lie."""
    worker, storage = bool(wanted), settings.person.storage if wanted else Storage()
    layout = lay_out(product, bench, storage, rng)
    parts = begun(product, bench, layout.parts, wanted, storage, rng) if worker else ()
    scene = (*parts, *clutter, *at_places(product, bench))
    hand = partial(add_hand, bench=bench, person=look.person, habits=settings.person) if worker else None
    return build_world(product, bench, scene, settings.physics, hand, look, layout.bins, robot)


def _sensed(arm: SimArm, settings: SimSettings, rng: np.random.Generator) -> SimArm | SensedArm:
    """The arm as the controller has it: through joint sensors and a network, unless these are ideal."""
    if settings.hardware == HARDWARE["ideal"]:
        return arm
    return SensedArm(arm, settings.hardware, settings.physics.control_period_s, rng)
