"""One simulated assembly beside a person, opened for a trial: with images, or without."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bracket_cell.configuration import Configuration, load_configuration, load_faults, load_product, simulated
from bracket_cell.running.operator import OperatorChannel
from bracket_cell.running.supervisor import Supervisor, make_supervisor
from bracket_cell.runs.assembled import tool_on_bench_m
from bracket_cell.runs.options import Files
from bracket_cell.runs.run import run_controller
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.watching.observer import Observer, Outcome
from bracket_cell.watching.statistics import Fluency
from bracket_cell.wiring.detectors import with_detectors_for
from bracket_cell.wiring.devices import attached
from bracket_cell.wiring.services import load_planners
from bracket_ground.files.files import shipped
from bracket_ground.files.row_store import Row
from bracket_ground.interfaces.faults import FaultTable
from bracket_ground.interfaces.product import Product
from bracket_sim.cell import SimCell
from bracket_sim.faults.injection import Injection, Injections, attended
from bracket_sim.process.no_render_host import without_pixels
from bracket_sim.process.opening import open_simulation
from bracket_sim.scene.settings import settings_of

DRAWS = 10_000  # of pairs, for an interval
OF_PERSON = ("hand_near", "hand_too_near", "blind_area")


def timed_pair(path: Path, tree: Path, person: str, seed: int) -> Row:
    """Two brackets with the same seed; a time is None where the bracket was not finished.

    Returns:
        `with_s` and `without_s`; of the one with separation `held_s`, `interventions` and `least_distance_m` as
        `Fluency` has them.
    """
    table = load_faults(load_configuration(path))
    rows = [row.model_copy(update={"action": "run"}) if row.signal in OF_PERSON else row for row in table.faults]
    without = table.model_copy(update={"faults": tuple(rows)})
    with_s, fluency = _timed(path, tree, person, seed, table)
    found = {name: fluency[name] for name in ("held_s", "interventions", "least_distance_m")}
    without_s, _ = _timed(path, tree, person, seed, without)
    return {"seed": seed, "with_s": with_s, "without_s": without_s, **found}


def cost_of_separation(rows: Sequence[Row]) -> Row:
    """The sum of times with separation over the sum without, of pairs that were finished both.

    Returns:
        `ratio` with its 95 % interval from drawing pairs again, `low` to `high`; the mean time `with_s` with its own,
        and `without_s`; `n` pairs, and how many more were `unfinished`; of all with separation the mean `held_s` and
        `interventions`, and `least_distance_m`, the median over brackets.
    """
    finished = [(row["with_s"], row["without_s"]) for row in rows if None not in (row["with_s"], row["without_s"])]
    counts = {"n": len(finished), "unfinished": len(rows) - len(finished)}
    if not finished:
        return {"ratio": None, **counts}
    times = np.array(finished, dtype=float)
    sums, (with_s, without_s) = np.random.default_rng(0).choice(times, (DRAWS, len(times))).sum(axis=1), times.mean(0)
    low, high = np.percentile(sums[:, 0] / sums[:, 1], (2.5, 97.5))
    low_s, high_s = np.percentile(sums[:, 0] / len(times), (2.5, 97.5))
    least_m = [row["least_distance_m"] for row in rows if row["least_distance_m"] is not None]
    found = {"ratio": with_s / without_s, "low": low, "high": high, "with_s": with_s, "with_low_s": low_s}
    found |= {"with_high_s": high_s, "without_s": without_s, "least_distance_m": np.median(least_m or [np.nan])}
    found |= {name: np.mean([row[name] for row in rows]) for name in ("held_s", "interventions")}
    return {**{name: round(float(value), 3) for name, value in found.items()}, **counts}


def _timed(path: Path, tree: Path, person: str, seed: int, table: FaultTable) -> tuple[float | None, dict[str, Any]]:
    with assembly(path, person, seed, table, tree=tree) as opened:
        fluency = Fluency(partial(tool_on_bench_m, opened.motion.kinematics))
        outcome = opened.run([fluency], None)
    return round(outcome.sim_time_s, 2) if outcome.end == "finished" else None, fluency.report()


ALGORITHM_1 = shipped("bracket_cell.trees", "assemble.xml")
Injected = Injection | Injections | None


@dataclass(frozen=True)
class Assembly:
    """A cell with its person; `run` works on one bracket."""

    cell: SimCell
    motion: MotionPlanner
    run: Callable[[Sequence[Observer], Injected], Outcome]


@contextmanager
def assembly(
    path: Path,
    person: str,
    seed: int,
    table: FaultTable | None = None,
    *,
    tree: Path = ALGORITHM_1,
    rendered: bool = False,
    depth: bool = False,
    supervised: Callable[[FaultTable, MotionPlanner], Supervisor] = make_supervisor,
) -> Iterator[Assembly]:
    """A simulated cell beside a person who builds one of the product's goals.

    Args:
        path: of the configuration.
        person: a kind of person, or a file.
        table: what the supervisor does about faults; the configured one by default.
        tree: file of the tree that is run.
        depth: the overhead camera sends depths, too.
    """
    configuration = simulated(load_configuration(path), None, person)
    if depth:
        overhead = configuration.bench.overhead.model_copy(update={"depth": True})
        bench = configuration.bench.model_copy(update={"overhead": overhead})
        configuration = configuration.model_copy(update={"bench": bench})
    product = load_product(configuration, path)
    configuration, _ = with_detectors_for(configuration, product)
    with opened(configuration, product, tree, seed, table, rendered=rendered, supervised=supervised) as found:
        yield found


@contextmanager
def opened(
    configuration: Configuration,
    product: Product,
    tree: Path,
    seed: int,
    table: FaultTable | None = None,
    *,
    rendered: bool,
    supervised: Callable[[FaultTable, MotionPlanner], Supervisor] = make_supervisor,
) -> Iterator[Assembly]:
    """The same in a cell of this configuration as it is; the seed draws the goal. In a shift somebody answers."""
    gc.collect()  # what a cell was made of is in cycles: left alone, each one before stays, 40 MB
    loaded, planners = load_tree(tree, node_registry(product)), load_planners(configuration, product)
    motion = MotionPlanner(product, configuration.bench, configuration.motion)
    files = Files(configuration, product, loaded, planners, table or load_faults(configuration))
    cell = open_simulation(configuration, product, seed, rendered=rendered)

    def run(observers: Sequence[Observer], injected: Injected = None) -> Outcome:
        own = cell.devices if rendered else without_pixels(cell, configuration, product)
        with attached(configuration, product, own) as devices:
            operator = OperatorChannel(product.goals, present=settings_of(configuration.devices.simulation).shift)
            return run_controller(
                files,
                attended(devices),
                motion,
                observers,
                injection=injected,
                operator=operator,
                supervised=supervised,
            )

    try:
        yield Assembly(cell, motion, run)
    finally:
        cell.close()
