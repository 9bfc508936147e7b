"""The simulated robot without cameras and without a person, driven by skills on ground-truth poses."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType

import numpy as np

from bracket_cell.configuration import load_configuration
from bracket_cell.skills.drivers.can_gripper import CanGripper
from bracket_cell.skills.drivers.settings import CanSettings
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.skill import Progress, Skill, SkillStatus
from bracket_sim.devices.arm import SimArm
from bracket_sim.devices.clock import Observer, SimClock
from bracket_sim.devices.simulated_gripper import GripperNode
from bracket_sim.scene.clutter import standing
from bracket_sim.scene.settings import PhysicsSettings
from bracket_sim.scene.world import World, WorldPart, build_world

CONFIG = Path(__file__).resolve().parents[2] / "config"
TICK_S = 0.040


class RobotAlone:
    """A world with the given parts in its tray, its arm and gripper, and a motion planner."""

    def __init__(
        self,
        types: Sequence[str],
        channel: str,
        watch: Callable[[World], Observer] | None = None,
        product: Product | None = None,
        configuration: Path = CONFIG / "cell.yaml",
    ) -> None:
        """Args:
        types: one part of each stands aside on the table until a test puts it somewhere.
        channel: name of the virtual CAN bus, one for each robot.
        watch: makes something that looks at the world after every control period.
        product: the shipped one by default.
        configuration: of another cell.
        """
        cell = load_configuration(configuration)
        self.bench = cell.bench
        self.product = product or load_yaml(cell.product, Product)
        scene = [
            standing(self.product, self.bench.tray, name, (0.0, 0.7 + 0.1 * i), 0.0) for i, name in enumerate(types)
        ]
        self.world = build_world(self.product, self.bench, scene, PhysicsSettings(), robot=cell.robot)
        self.arm = SimArm(self.world)
        self.node = GripperNode(self.world, "virtual", channel)
        self.clock = SimClock(self.world, [self.arm, self.node], [] if watch is None else [watch(self.world)])
        settings = CanSettings(channel=channel)
        self.gripper = CanGripper(settings, self.clock)
        self.planner = MotionPlanner(self.product, self.bench, cell.motion)
        self.tick = 0

    def __enter__(self) -> RobotAlone:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.gripper.close()
        self.node.close()

    @property
    def parts(self) -> tuple[WorldPart, ...]:
        """All parts in the order of `types`."""
        return self.world.bodies

    def observe(self) -> Observation:
        """What the devices say now."""
        return Observation(self.tick, self.clock.now_s(), self.arm.state(), self.gripper.state())

    def run(
        self, skill: Skill, timeout_s: float = 30.0, watch: Callable[[Observation, Command], None] | None = None
    ) -> Progress:
        """Poll a skill in lock-step until it ends."""
        for _ in range(round(timeout_s / TICK_S)):
            observation, command = self.observe(), Command()
            progress = skill.poll(observation, command)
            if watch is not None:
                watch(observation, command)
            self.act(command)
            if progress.status is not SkillStatus.RUNNING:
                return progress
        raise AssertionError(f"still running after {timeout_s} s: {progress.reason}")

    def act(self, command: Command) -> None:
        """Carry a command out and advance by one tick."""
        self.arm.pace(1.0)
        if command.stop_arm:
            self.arm.stop()
        elif command.follow is not None:
            self.arm.follow(command.follow)
        if command.activate_gripper:
            self.gripper.activate()
        if command.gripper is not None:
            self.gripper.command(command.gripper)
        self.tick += 1
        self.clock.sleep_until(self.tick * TICK_S)

    def wait(self, duration_s: float) -> None:
        """Let time pass."""
        for _ in range(round(duration_s / TICK_S)):
            self.observe()
            self.act(Command())

    def stand(self, part: WorldPart, xy_m: Sequence[float], yaw_rad: float) -> None:
        """Put a part into the tray."""
        self.world.place(part, standing(self.product, self.bench.tray, part.part, xy_m, yaw_rad).world_from_part)

    def put_away(self, part: WorldPart) -> None:
        """Put a part back beside the bench."""
        index = self.parts.index(part)
        peg_m = self.product.parts[part.part].peg_length_m
        self.world.place(part, Pose((0.0, 0.7 + 0.1 * index, peg_m)))

    def detection(self, part: WorldPart, rng: np.random.Generator, sigma_m: float, sigma_rad: float) -> PartDetection:
        """A part as seen with noise; a long box looks the same turned by half a turn."""
        pose = self.world.part_pose(part)
        x, y, z = pose.position_m
        seen = Pose.from_yaw(
            (x + rng.normal(0, sigma_m), y + rng.normal(0, sigma_m), z),
            pose.yaw_rad + rng.normal(0, sigma_rad) + math.pi * rng.integers(2),
        )
        return PartDetection(part.part, 1.0, seen, self.product.parts[part.part].size_m, (0, 0, 0, 0))

    def seated(self, part: WorldPart, position: str) -> str | None:
        """None where a part stands upright in a hole, otherwise what is wrong."""
        product, bench = self.product, self.bench
        x, y = product.bracket.holes_m[position]
        in_hole = (bench.bracket.pose @ Pose((x, y, 0.0))).inverse() @ self.world.part_pose(part)
        offset_m = math.hypot(*in_hole.position_m[:2])
        tilt_rad = math.acos(min(1.0, in_hole.rotation[2, 2]))
        if offset_m > product.bracket.hole_clearance_m + 0.002:
            return f"{offset_m * 1000:.1f} mm beside the hole, {in_hole.position_m[2] * 1000:.1f} mm high"
        if abs(in_hole.position_m[2]) > 0.003 or tilt_rad > math.radians(5):
            return f"{in_hole.position_m[2] * 1000:.1f} mm high, tilted {math.degrees(tilt_rad):.1f} degrees"
        return None


def load_cell() -> tuple[Product, Bench]:
    """The shipped product and bench."""
    return load_yaml(CONFIG / "products.yaml", Product), load_configuration().bench


def tray_poses(
    bench: Bench, count: int, rng: np.random.Generator, margin_m: float = 0.07
) -> list[tuple[float, float, float]]:
    """Random (x, y, yaw) in the tray, a margin away from its rim."""
    half = np.array(bench.tray.size_m) / 2 - margin_m
    middle = np.array(bench.tray.centre_m[:2])
    return [
        (float(x), float(y), float(rng.uniform(-math.pi, math.pi)))
        for x, y in (middle + rng.uniform(-half, half) for _ in range(count))
    ]
