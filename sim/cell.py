"""Opens the simulated cell: world, devices and the person at the bench on one clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from cell.interfaces.bench import Bench
from cell.interfaces.command import Display
from cell.interfaces.devices import Devices
from cell.interfaces.product import Product
from cell.interfaces.truth import TruthEvent
from sim.arm import SimArm
from sim.bare_sight import bare_sight
from sim.camera import Delivery, SimCamera
from sim.clock import Actor, Observer, SimClock
from sim.clutter import ScenePart, full_set, sample_clutter
from sim.contacts import ContactMonitor
from sim.gripper_node import GripperNode
from sim.hand import add_hand
from sim.hardware import HARDWARE
from sim.jobs import Jobs
from sim.person import Storage
from sim.photographer import Photographer, SensorSetup
from sim.render_process import RenderProcess
from sim.score import Score
from sim.sensed_arm import SensedArm
from sim.settings import SimSettings
from sim.signal_node import SignalNode
from sim.stock import Stock
from sim.storage import lay_out
from sim.tray_truth import resting_event, resting_parts
from sim.worker import Around, Worker
from sim.world import build_world


class EmptyPanel:
    """A panel that nobody reads."""

    def show(self, display: Display) -> None:
        """Nothing happens."""

    def alarm(self, text: str) -> None:
        """Nothing happens."""


class SimCell:
    """Everything that belongs to one simulated run.

    Args:
        goal: the configuration that the person assembles; "random" lets the seed choose.
        seed: the same seed gives the same scene, noise and person.
        worker: with the person and their parts in the bins, or the robot alone.
        clutter: parts in the tray; by default one product's set, cluttered at random.
        overlap: frames and detectors in a process of their own, beside the physics; what comes out is the same.
        rendered: with images; without, `sight` tells what the cameras would have seen.

    Attributes:
        look: drawn by the seed from the settings' range.
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
    ) -> None:
        streams = [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(10)]
        self._jobs = Jobs(product, goal, settings.person.shift.new_goals if settings.shift else 0.0, streams[0])
        self._job = self._jobs.next()
        self._finished: list[dict[str, object]] = []
        if clutter is None:
            clutter = sample_clutter(product, bench.tray, full_set(product), streams[1], settings.clutter)
        self.look = settings.look.draw(seed)
        person = settings.person
        layout = lay_out(product, bench, person.storage if worker else Storage(), streams[5])
        scene = (*layout.parts, *clutter) if worker else tuple(clutter)
        hand = partial(add_hand, bench=bench, person=self.look.person, habits=person) if worker else None
        self.world = build_world(product, bench, scene, settings.physics, hand, self.look, layout.bins)
        self.stock = Stock(self.world, product, bench, settings.clutter, streams[9])
        around = Around(self.stock, self._change, settings.shift, streams[9])
        wanted = self._job.placements
        self.worker = (
            Worker(self.world, product, bench, person, wanted, streams[2], streams[5], around) if worker else None
        )
        self.world.settle()
        self._resting = [resting_event(one) for one in resting_parts(self.world)]
        hardware = settings.hardware
        self.arm = SimArm(self.world, trailing_s=hardware.trailing_s)
        arm: SimArm | SensedArm = self.arm
        if hardware != HARDWARE["ideal"]:
            arm = SensedArm(self.arm, hardware, settings.physics.control_period_s, streams[8])
        self.gripper_node = GripperNode(self.world, can_interface, can_channel)
        self.score = Score(self.world, self._job)
        self.contacts = ContactMonitor(self.world, lambda: self.arm.driven_rad_s) if worker else None
        sensors = {
            "overhead": SensorSetup(bench.overhead, self.look.camera, streams[3]),
            "wrist": SensorSetup(bench.wrist, self.look.camera, streams[4]),
        }
        beside = RenderProcess(self.world.model, sensors) if overlap and rendered else None
        self.sight = None if rendered else bare_sight(self.world, sensors, hand=worker)
        self._photographer = self.sight or beside or Photographer(self.world.model, sensors)
        deliveries = [Delivery(self.look.camera, hardware.camera_latency_s, stream) for stream in streams[6:8]]
        overhead = SimCamera("overhead", bench.overhead, self.world, self._photographer.take, deliveries[0])
        wrist = SimCamera("wrist", bench.wrist, self.world, self._photographer.take, deliveries[1])
        self.signal_node = None if settings.signals is None else SignalNode(settings.signals)
        actors: list[Actor] = [arm, self.gripper_node, self.stock]
        if self.signal_node is not None:
            actors.append(self.signal_node)
        if self.worker is not None:
            actors.append(self.worker)
        samplers: list[Observer] = [self.arm, *([self.contacts] if self.contacts is not None else [])]
        clock = SimClock(self.world, actors, [self.score, overhead, wrist], samplers)
        panel = self.worker or EmptyPanel()
        self.devices = Devices(
            clock,
            overhead,
            wrist,
            arm,
            panel,
            self.report,
            self.close,
            self.truth,
            host=beside,
            pressed=self.worker.pressed if self.worker is not None else tuple,
            finished=lambda: self._finished,
            free_running=self._run_freely,
        )

    def report(self) -> dict[str, object]:
        """Keys of `cell run --json` that only the truth can give."""
        return self.score.report() | (self.contacts.report() if self.contacts is not None else {})

    def _run_freely(self, free: bool) -> None:
        if isinstance(self._photographer, RenderProcess):
            self._photographer.hurried = free

    def _change(self) -> Mapping[str, str]:
        """The person takes the bracket out: judge it, and tell what is to be built next."""
        self._finished.append(self.report())
        self._job = self._jobs.next()
        self.score.begin(self._job)
        return self._job.placements

    def truth(self) -> list[TruthEvent]:
        """What happened at the bench since the last call, in order."""
        resting, self._resting = self._resting, []
        acts, contacts = self.worker.news() if self.worker else [], self.contacts.news() if self.contacts else []
        news = [*resting, *acts, *contacts]
        return sorted(news, key=lambda event: event.time_s)

    def close(self) -> None:
        """Let go of the bus and of what makes the frames."""
        self.gripper_node.close()
        if self.signal_node is not None:
            self.signal_node.close()
        self._photographer.close()


def open_cell(
    product: Product, bench: Bench, settings: SimSettings, can_interface: str, can_channel: str, seed: int, goal: str
) -> Devices:
    """What the configuration names as the factory of devices: a simulated cell with a person; see SimCell."""
    overlap = settings.overlap
    return SimCell(product, bench, settings, can_interface, can_channel, seed, goal, overlap=overlap).devices
