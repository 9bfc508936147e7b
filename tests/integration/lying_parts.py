"""Sets lone lying parts upright in the simulator and counts: `python -m tests.integration.lying_parts --parts 60`.

Each part, side and heading is drawn from the seed. What the skill is told is the true pose with noise, or, with
`--pixels`, what the detectors say of a rendered image; then a part may be turned as often as it takes, up to `--turns`.
"""

from __future__ import annotations

import argparse
import math
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bracket_cell.configuration import load_configuration
from bracket_cell.fleet.intervals import wilson
from bracket_cell.skills.lying import SetUpright
from bracket_cell.skills.motion.lying_grasp import laid_out
from bracket_cell.skills.move_to import MoveTo
from bracket_cell.wiring.detectors import part_finder
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.command import Command, GripperCommand
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.resting_pose import SIDES, side_up
from bracket_ground.interfaces.skill import SkillStatus
from bracket_sim.rendering.photographer import Exposure, Photographer, SensorSetup
from bracket_sim.rendering.studio import visible_poses
from bracket_sim.scene.world import WorldPart
from tests.integration.robot_alone import CONFIG, RobotAlone, tray_poses

SIGMA_M, SIGMA_RAD = 0.001, math.radians(1.5)
SETTLING_S = 0.5
STANDS = math.cos(math.radians(5))


class Bench:
    """One robot and its parts, and the eyes to find them."""

    def __init__(self, robot: RobotAlone, rng: np.random.Generator, pixels: bool) -> None:
        self.robot, self._rng = robot, rng
        self._find = part_finder(robot.bench, robot.product, load_configuration().perception) if pixels else None
        sensors = {"wrist": SensorSetup(robot.bench.wrist, robot.world.look.camera, rng)} if pixels else {}
        self._photographer = Photographer(robot.world.model, sensors) if pixels else None

    def lay(self, part: WorldPart, up: str) -> bool:
        """Let a part fall onto a side somewhere in the tray; false where it did not stay there."""
        robot = self.robot
        found = laid_out(robot.product.parts[part.part], up)
        assert found is not None
        x, y, yaw = tray_poses(robot.bench, 1, self._rng)[0]
        spot = Pose.from_yaw((x, y, robot.bench.tray.centre_m[2] + 0.001), yaw)
        robot.world.place(part, spot @ found[0])
        robot.wait(SETTLING_S)
        return side_up(robot.world.part_pose(part)) == up

    def seen(self, part: WorldPart) -> PartDetection | None:
        """What is told of a lone part; None where it is not told how it lies."""
        return self._guessed(part) if self._find is None else self._looked()

    def _guessed(self, part: WorldPart) -> PartDetection:
        true, rng = self.robot.world.part_pose(part), self._rng
        x, y, z = true.position_m
        turned = Pose.from_yaw((0, 0, 0), rng.normal(0, SIGMA_RAD)) @ Pose((0, 0, 0), true.quaternion_wxyz)
        lies = Pose((x + rng.normal(0, SIGMA_M), y + rng.normal(0, SIGMA_M), z), turned.quaternion_wxyz)
        size = self.robot.product.parts[part.part].size_m
        return PartDetection(part.part, 1.0, Pose((x, y, z)), size, (0, 0, 0, 0), upright=False, lies=lies)

    def _looked(self) -> PartDetection | None:
        assert self._find is not None
        assert self._photographer is not None
        world = self.robot.world
        exposure = Exposure("wrist", 0, 0.0, world.camera_pose("wrist"), (visible_poses(world.data),))
        others = self._find(self._photographer.take(exposure)).others
        return next((other for other in others if other.lies is not None), None)

    def stands(self, part: WorldPart) -> bool:
        """Whether it stands on its peg in the tray, in truth."""
        pose, tray = self.robot.world.part_pose(part), self.robot.bench.tray
        inside = np.abs(np.subtract(pose.position_m, tray.centre_m))[:2] < np.array(tray.size_m) / 2
        return bool(pose.rotation[2, 2] > STANDS and inside.all())


def attempt(bench: Bench, part: WorldPart, turns: int) -> tuple[str, int]:
    """Turn a part until it stands; what went wrong, or nothing, and how many turns it took."""
    robot = bench.robot
    reason = ""
    for turn in range(turns):
        if robot.run(MoveTo(robot.planner, "look")).status is not SkillStatus.SUCCESS:
            return "the arm does not reach its look", turn
        if (seen := bench.seen(part)) is None:
            return "not told how it lies", turn
        progress = robot.run(SetUpright(robot.planner, seen, ()))
        robot.act(Command(gripper=GripperCommand(0.085)))
        robot.wait(SETTLING_S)
        if bench.stands(part):
            return "", turn + 1
        reason = progress.reason
    return reason, turns


def measure(product: Product | None, count: int, seed: int, turns: int, pixels: bool) -> None:
    """Print a line for each failure, and shares by part and side."""
    rng = np.random.default_rng(seed)
    right: dict[str, list[bool]] = defaultdict(list)
    needed: list[int] = []
    with RobotAlone(("o1", "o2", "o3"), f"lying {seed}", product=product) as robot:
        bench = Bench(robot, rng, pixels)
        while len(needed) < count:
            part, up = robot.parts[len(needed) % len(robot.parts)], SIDES[int(rng.integers(len(SIDES)))]
            if not bench.lay(part, up):
                robot.put_away(part)
                continue
            wrong, taken = attempt(bench, part, turns)
            needed.append(taken)
            for key in ("all", part.part, f"{up} up"):
                right[key].append(not wrong)
            if wrong:
                print(f"{len(needed)} {part.part} {up} up: {wrong}", flush=True)
            robot.put_away(part)
    for key, good in sorted(right.items()):
        low, _, high = wilson(sum(good), len(good))
        print(f"{key:6} {sum(good)} of {len(good)}: {sum(good) / len(good):.3f} ({low:.3f} - {high:.3f})")
    print(f"quarter turns: {np.mean(needed):.2f}")


def main(arguments: Sequence[str] | None = None) -> None:
    """Parse and measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--parts", type=int, default=60, help="how many lone parts")
    parser.add_argument("--seed", type=int, default=8_000_001)
    parser.add_argument("--turns", type=int, default=3, help="most quarter turns of one part")
    parser.add_argument("--steel", action="store_true", help="the product in bare steel")
    parser.add_argument("--pixels", action="store_true", help="what is told comes from a rendered image")
    chosen = parser.parse_args(arguments)
    product = load_yaml(Path(CONFIG) / "products_steel.yaml", Product) if chosen.steel else None
    measure(product, chosen.parts, chosen.seed, chosen.turns, chosen.pixels)


if __name__ == "__main__":
    main()
