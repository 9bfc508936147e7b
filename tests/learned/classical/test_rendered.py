"""Classical perception on frames of the simulated cell, against its truth."""

import numpy as np
import pytest

from bracket_cell.learned.classical.part_detector import ClassicalPartDetector
from bracket_sim.scene.clutter import full_set, sample_clutter
from bracket_sim.scene.settings import ClutterSettings
from bracket_sim.scene.unknown_objects import UNKNOWN
from bracket_sim.truth.labels import resting_parts
from tests.benchmarks.perception_accuracy import PartErrors, RunErrors, compare, look, open_sim, worker_run
from tests.learned.classical.scenes import BENCH, CONFIGURATION, PRODUCT, classical_bench_watcher


def test_parts_in_clutter_are_found_in_a_rendered_view() -> None:
    clutter = sample_clutter(PRODUCT, BENCH.tray, ["o1", "o2", "o3", "o1", "o2"], np.random.default_rng(4))
    cell = open_sim(CONFIGURATION, PRODUCT, 4, worker=False, clutter=clutter)
    cell.world.set_arm(BENCH.arm_look_rad)
    errors = {name: PartErrors() for name in PRODUCT.parts}
    truth = [(body.part, cell.world.part_pose(body)) for body in cell.world.bodies]
    compare(truth, ClassicalPartDetector(BENCH, PRODUCT).detect(look(cell)), errors)
    cell.close()
    assert sum(error.missed + error.extra for error in errors.values()) == 0
    assert max(distance for error in errors.values() for distance in error.position_m) < 0.002
    assert max(turn for error in errors.values() for turn in error.yaw_rad) < np.radians(2.0)


@pytest.mark.long
def test_what_lies_or_is_of_no_type_is_not_taken_for_a_standing_part() -> None:
    settings = ClutterSettings(lying_share=0.6, stacked_share=0.4, foreign_objects=1)
    lying = standing = 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        clutter = sample_clutter(PRODUCT, BENCH.tray, full_set(PRODUCT), rng, settings)
        cell = open_sim(CONFIGURATION, PRODUCT, seed, worker=False, clutter=clutter)
        cell.world.set_arm(BENCH.arm_look_rad)
        errors = {name: PartErrors() for name in PRODUCT.parts}
        resting = [resting_part for resting_part in resting_parts(cell.world) if resting_part.part != UNKNOWN]
        upright = [(one.part, one.world_from_part) for one in resting if one.posture == "upright"]
        compare(upright, ClassicalPartDetector(BENCH, PRODUCT).detect(look(cell)), errors)
        cell.close()
        assert sum(error.extra for error in errors.values()) == 0
        lying += len(resting) - len(upright)
        standing += len(upright) - sum(error.missed for error in errors.values())
    assert lying > 8
    assert standing > 3


def test_the_first_placement_is_seen_and_nothing_before_it() -> None:
    cell = open_sim(CONFIGURATION, PRODUCT, 5, clutter=[])
    assert cell.worker is not None
    watcher = classical_bench_watcher(BENCH, PRODUCT)
    clock, finished, sequence = cell.devices.clock, None, -1
    while finished is None and clock.now_s() < 8.0:
        frame = cell.devices.overhead.latest()
        if frame is not None and frame.sequence > sequence:
            sequence, action = frame.sequence, watcher.watch(frame).action
            finished = action if action.finished else None
        clock.sleep_until(clock.now_s() + 0.008)
    placed = next(event for event in cell.worker.events if event.kind == "assembly")
    cell.close()
    assert finished is not None
    assert (finished.part, finished.position) == (placed.part, placed.position)


@pytest.mark.slow
def test_whole_runs_of_the_person_alone_are_read_without_a_mistake() -> None:
    errors = RunErrors()
    for seed in range(100, 103):
        worker_run(CONFIGURATION, PRODUCT, seed, errors)
    assert errors.placed_seen == errors.placements == 3 * len(PRODUCT.positions)
    assert errors.false_placements == errors.false_screws == errors.wrong_holes == 0
    assert errors.screws_seen == errors.screws
