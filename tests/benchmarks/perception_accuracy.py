"""Measures classical perception against the simulator's truth: `python -m tests.benchmarks.perception_accuracy`.

Part poses from the wrist camera, alone and in clutter; worker-only runs (placements, screws, holes, actions by class,
time a frame); and holes with the arm over them.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from bracket_cell.configuration import Configuration, load_configuration, load_product, simulated
from bracket_cell.learned.bench_watcher import DetectorChain
from bracket_cell.learned.classical.part_detector import ClassicalPartDetector
from bracket_cell.skills.motion.grasp_pose import tool_down
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import BenchView, PartDetection
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.cell import SimCell
from bracket_sim.rendering.camera import SimCamera
from bracket_sim.scene.clutter import sample_clutter, standing
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.settings import settings_of
from bracket_sim.scene.world import WorldPart
from bracket_sim.worker.event_log import ActionEvent
from tests.learned.classical.scenes import classical_bench_watcher

LONGEST_RUN_S = 200.0
FOUND_M = 0.005
LATE_S = 2.5  # a placement that is reported later counts as missed
SCREW_LATE_S = 1.5
FAR_AWAY = Pose((3.0, 3.0, 0.1))
TRAY_EDGE_M = 0.05
ASKED_AGAIN_S = 0.4


@dataclass
class PartErrors:
    """Errors of found parts and how many were missed or imagined."""

    position_m: list[float] = field(default_factory=list)
    yaw_rad: list[float] = field(default_factory=list)
    missed: int = 0
    extra: int = 0

    def row(self, name: str) -> str:
        """One line of the table: median and 95th percentile."""
        position, yaw = np.array(self.position_m) * 1e3, np.degrees(self.yaw_rad)
        return (
            f"{name:12} found {len(position):4d}  missed {self.missed:3d}  extra {self.extra:3d}  "
            f"position {quantile(position, 50):5.2f} / {quantile(position, 95):5.2f} mm  "
            f"yaw {quantile(yaw, 50):5.2f} / {quantile(yaw, 95):5.2f} deg"
        )


@dataclass
class RunErrors:
    """What was detected in worker-only runs."""

    placements: int = 0
    placed_seen: int = 0
    false_placements: int = 0
    screws: int = 0
    screws_seen: int = 0
    false_screws: int = 0
    screw_delays_s: list[float] = field(default_factory=list)
    placement_delays_s: list[float] = field(default_factory=list)
    confusion: Counter[tuple[str, str]] = field(default_factory=Counter)
    holes: int = 0
    wrong_holes: int = 0
    frame_ms: list[float] = field(default_factory=list)


def quantile(values: Sequence[float] | Array, percent: float) -> float:
    """A percentile; not a number where there is no value."""
    return float(np.percentile(values, percent)) if len(values) else math.nan


def open_sim(
    configuration: Configuration,
    product: Product,
    seed: int,
    *,
    worker: bool = True,
    clutter: Sequence[ScenePart] | None = None,
    looking: bool = False,
) -> SimCell:
    """A simulated cell of its own; its arm stands still, on request over the tray."""
    settings, bench = settings_of(configuration.devices.simulation), configuration.bench
    if looking:
        bench = bench.model_copy(update={"arm_park_rad": bench.arm_look_rad})
    channel = f"perception-{seed}"
    return SimCell(product, bench, settings, "virtual", channel, seed, "random", worker=worker, clutter=clutter)


def look(cell: SimCell) -> Frame:
    """One frame of the wrist camera; where it is lost, the next one."""
    camera, clock = cell.devices.wrist, cell.devices.clock
    before = camera.latest()
    while (frame := camera.latest()) is None or frame is before:
        camera.trigger()
        clock.sleep_until(clock.now_s() + ASKED_AGAIN_S)
    return frame


def compare(truth: Sequence[tuple[str, Pose]], found: Sequence[PartDetection], errors: dict[str, PartErrors]) -> None:
    """Match each true part to the nearest detection of its type within FOUND_M."""
    left = list(found)
    for name, pose in truth:
        near = [
            (distance_m(detection.world_from_part, pose), index)
            for index, detection in enumerate(left)
            if detection.part == name
        ]
        if not near or min(near)[0] > FOUND_M:
            errors[name].missed += 1
            continue
        nearest_m, index = min(near)
        turn = left.pop(index).world_from_part.yaw_rad - pose.yaw_rad
        errors[name].position_m.append(nearest_m)
        errors[name].yaw_rad.append(abs((turn + math.pi / 2) % math.pi - math.pi / 2))
    for detection in left:
        errors[detection.part].extra += 1


def distance_m(first: Pose, second: Pose) -> float:
    """Along the bench."""
    return math.hypot(*(a - b for a, b in zip(first.position_m[:2], second.position_m[:2], strict=True)))


def parts_alone(configuration: Configuration, product: Product, poses: int) -> dict[str, PartErrors]:
    """Every type alone at random poses over the whole tray."""
    bench, rng = configuration.bench, np.random.default_rng(7)
    reach = np.array(bench.tray.size_m) / 2 - TRAY_EDGE_M
    scene = [standing(product, bench.tray, name, bench.tray.centre_m[:2], 0.0) for name in product.parts]
    cell = open_sim(configuration, product, 0, worker=False, clutter=scene, looking=True)
    detector = ClassicalPartDetector(bench, product)
    errors = {name: PartErrors() for name in product.parts}
    for body in cell.world.bodies:
        for other in cell.world.bodies:
            cell.world.place(other, FAR_AWAY)
        for _ in range(poses):
            centre = np.array(bench.tray.centre_m[:2]) + rng.uniform(-reach, reach)
            spot = standing(product, bench.tray, body.part, centre, rng.uniform(-math.pi, math.pi))
            cell.world.place(body, spot.world_from_part)
            found = detector.detect(look(cell))
            compare([(body.part, cell.world.part_pose(body))], found, errors)
    cell.close()
    return errors


def parts_in_clutter(configuration: Configuration, product: Product, scenes: int) -> dict[str, PartErrors]:
    """Scenes of 3 to 6 parts."""
    bench, rng = configuration.bench, np.random.default_rng(8)
    detector = ClassicalPartDetector(bench, product)
    errors = {name: PartErrors() for name in product.parts}
    names = [name for name, part in product.parts.items() for _ in range(part.quantity)]
    for seed in range(scenes):
        types = [names[i] for i in rng.choice(len(names), int(rng.integers(3, 7)), replace=False)]
        clutter = sample_clutter(product, bench.tray, types, rng, settings_of(configuration.devices.simulation).clutter)
        cell = open_sim(configuration, product, seed, worker=False, clutter=clutter, looking=True)
        truth = [(body.part, cell.world.part_pose(body)) for body in cell.world.bodies]
        compare(truth, detector.detect(look(cell)), errors)
        cell.close()
    return errors


def worker_run(configuration: Configuration, product: Product, seed: int, errors: RunErrors) -> None:
    """The person alone; every frame is watched and compared."""
    cell = open_sim(configuration, product, seed, clutter=[])
    watcher = classical_bench_watcher(configuration.bench, product)
    assert cell.worker is not None
    views: list[BenchView] = []
    clock, camera = cell.devices.clock, cell.devices.overhead
    over_s = LONGEST_RUN_S
    while clock.now_s() < over_s:
        frame = camera.latest()
        if frame is not None and (not views or frame.sequence > views[-1].sequence):
            start = time.perf_counter()
            views.append(watcher.watch(frame))
            errors.frame_ms.append((time.perf_counter() - start) * 1e3)
        if cell.worker.done:
            over_s = min(over_s, clock.now_s() + 1.5)
        clock.sleep_until(clock.now_s() + 0.008)
    judge_holes(cell, product, views[-1], errors)
    judge_actions(cell.worker.events, views, errors)
    cell.close()


def judge_holes(cell: SimCell, product: Product, last: BenchView, errors: RunErrors) -> None:
    """The occupancy at the end of a run."""
    truth = cell.score.report()["placements"]
    assert isinstance(truth, dict)
    for position in product.positions:
        view = last.holes.get(position)
        errors.holes += 1
        errors.wrong_holes += view is None or view.part != truth.get(position)


def judge_actions(events: Sequence[ActionEvent], views: Sequence[BenchView], errors: RunErrors) -> None:
    """Placements and screws as events, and the action of every frame."""
    ended = [event for event in events if event.kind == "assembly" and event.edge == "end"]
    reports = changes([str(view.action) if view.action.finished else None for view in views], views)
    for event in ended:
        errors.placements += 1
        name = f"{event.part} at {event.position}"
        match = next((one for one in reports if one[0] == name and -0.2 < one[1] - event.time_s < LATE_S), None)
        if match is not None:
            errors.placed_seen += 1
            errors.placement_delays_s.append(match[1] - event.time_s)
            reports.remove(match)
    errors.false_placements += len(reports)
    screws = spans(events, "screw")
    seen = changes([view.action.kind if view.action.kind == "screw" else None for view in views], views)
    for start_s, end_s in screws:
        errors.screws += 1
        match = next((one for one in seen if start_s - 0.3 < one[1] < end_s), None)
        if match is not None:
            errors.screw_delays_s.append(match[1] - start_s)
            errors.screws_seen += match[1] - start_s <= SCREW_LATE_S
    errors.false_screws += sum(not any(a - 0.3 < at_s < b for a, b in screws) for _, at_s in seen)
    for view in views:
        errors.confusion[kind_at(events, view.time_s), view.action.kind] += 1


def changes(labels: Sequence[str | None], views: Sequence[BenchView]) -> list[tuple[str, float]]:
    """Where a label begins, with its time."""
    before = [None, *labels]
    return [
        (label, view.time_s)
        for label, last, view in zip(labels, before, views, strict=False)
        if label and label != last
    ]


def spans(events: Sequence[ActionEvent], kind: str) -> list[tuple[float, float]]:
    """From start to end of each action of a kind."""
    starts = [event.time_s for event in events if event.kind == kind and event.edge == "start"]
    ends = [event.time_s for event in events if event.kind == kind and event.edge == "end"]
    return [(start, next((end for end in ends if end >= start), math.inf)) for start in starts]


def kind_at(events: Sequence[ActionEvent], time_s: float) -> str:
    """The true action at a time."""
    started = [event.kind for event in events if event.edge == "start" and event.time_s <= time_s]
    return started[-1] if started else "idle"


def holes_under_arm(configuration: Configuration, product: Product, poses: int) -> tuple[int, int]:
    """(readings, wrong ones) while the arm stands at random places over a half-filled bracket.

    In every second scene a part is in the gripper, over a hole that is empty; it must never be read as placed.
    """
    bench, rng = configuration.bench, np.random.default_rng(9)
    names = list(product.parts)
    scene = [standing(product, bench.tray, name, bench.tray.centre_m[:2], 0.0) for name in (*names, *names)]
    cell = open_sim(configuration, product, 1, worker=False, clutter=scene)
    kinematics = Kinematics(configuration.motion)
    readings = wrong = 0
    for index in range(poses):
        watcher = classical_bench_watcher(bench, product)
        cell.world.set_arm(bench.arm_park_rad)
        truth = fill_holes(cell, product, rng)
        watch_still(cell, watcher, 6)
        hole = hole_m(configuration, product, str(rng.choice([name for name, part in truth.items() if part is None])))
        spread = (0.006, 0.006, 0.0) if index % 2 else (0.08, 0.08, 0.06)
        tool = hole + np.array([0.0, 0.0, 0.11]) + rng.uniform(-1, 1, 3) * np.array(spread)
        joints = kinematics.inverse(tool_down(tool, math.pi / 2 * rng.integers(2)))
        if joints is None:
            continue
        cell.world.set_arm(joints)
        if index % 2:
            held = cell.world.bodies[len(names) + int(rng.integers(len(names)))]
            body_m = product.parts[held.part].size_m[2]
            cell.world.place(held, Pose((float(tool[0]), float(tool[1]), float(tool[2]) - body_m + 0.02)))
        for position, view in watch_still(cell, watcher, 8).holes.items():
            readings += 1
            wrong += view.part != truth[position]
    cell.close()
    return readings, wrong


def fill_holes(cell: SimCell, product: Product, rng: np.random.Generator) -> dict[str, str | None]:
    """One part of each type in some hole; the second set far away."""
    truth: dict[str, str | None] = dict.fromkeys(product.positions)
    chosen = rng.permutation(len(product.positions))
    bodies: Sequence[WorldPart] = cell.world.bodies
    bracket = cell.world.bench.bracket.pose
    for index, body in enumerate(bodies):
        if index >= len(product.parts):
            cell.world.place(body, Pose((3.0, 3.0 + index, 0.1)))
            continue
        position = product.positions[chosen[index]]
        truth[position] = body.part
        spot = bracket.transform(np.array([*product.bracket.holes_m[position], 0.0]))
        cell.world.place(body, Pose.from_yaw(list(spot), float(rng.choice([0.0, 0.05, math.pi]))))
    return truth


def hole_m(configuration: Configuration, product: Product, position: str) -> Array:
    """Middle (3,) of a hole on the plate."""
    xy = product.bracket.holes_m[position]
    return configuration.bench.bracket.pose.transform(np.array([*xy, 0.0]))


def watch_still(cell: SimCell, watcher: DetectorChain, frames: int) -> BenchView:
    """Frames of a world that does not move."""
    camera = cell.devices.overhead
    assert isinstance(camera, SimCamera)
    for _ in range(frames):
        before = camera.latest()
        camera.observe(0.0 if before is None else (before.sequence + 1) / overhead_rate_hz(cell))
        frame = camera.latest()
        assert frame is not None
        view = watcher.watch(frame)
    return view


def overhead_rate_hz(cell: SimCell) -> float:
    """Frames per second of the overhead camera."""
    return cell.world.bench.overhead.rate_hz


def report(configuration: Configuration, product: Product, poses: int, scenes: int, seeds: int) -> None:
    """Print the whole table."""
    for title, table in (
        ("alone", parts_alone(configuration, product, poses)),
        ("clutter", parts_in_clutter(configuration, product, scenes)),
    ):
        for name, errors in table.items():
            print(errors.row(f"{title} {name}"))
    runs = RunErrors()
    for seed in range(seeds):
        worker_run(configuration, product, seed, runs)
    print(
        f"placements {runs.placed_seen} of {runs.placements} seen, {runs.false_placements} false, "
        f"median {quantile(runs.placement_delays_s, 50):.2f} s after release\n"
        f"screws {runs.screws_seen} of {runs.screws} within {SCREW_LATE_S} s, {runs.false_screws} false, "
        f"median {quantile(runs.screw_delays_s, 50):.2f} s, latest {quantile(runs.screw_delays_s, 100):.2f} s\n"
        f"holes at the end: {runs.wrong_holes} of {runs.holes} wrong\n"
        f"time a frame: median {np.median(runs.frame_ms):.2f} ms, 99 % {np.percentile(runs.frame_ms, 99):.2f} ms"
    )
    for kind in ("assembly", "screw", "transit", "idle"):
        right = runs.confusion[kind, kind]
        said = sum(count for (_, answer), count in runs.confusion.items() if answer == kind)
        true = sum(count for (truth, _), count in runs.confusion.items() if truth == kind)
        print(f"frames {kind:9} precision {right / max(said, 1):.3f}  recall {right / max(true, 1):.3f}  of {true}")
    readings, wrong = holes_under_arm(configuration, product, poses)
    print(f"holes under the arm: {wrong} of {readings} readings wrong")


def main() -> None:
    """Parse options and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=30)
    parser.add_argument("--scenes", type=int, default=30)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--look", help="nominal, varied, hard, PRESET:SECTION or a look file")
    options = parser.parse_args()
    configuration = simulated(load_configuration(), options.look)
    report(configuration, load_product(configuration), options.poses, options.scenes, options.seeds)


if __name__ == "__main__":
    main()
