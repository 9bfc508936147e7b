"""`cell eval system` and `cell eval latency`: all detectors of a configuration together."""

from __future__ import annotations

from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Annotated

import typer

from cell.commands.detectors import Hung, HungOption, LookOption, PersonOption, TestSeedOption
from cell.commands.terminal import (
    CONFIGURATION,
    ConfigOption,
    JsonOption,
    RowsOption,
    SchedulerOption,
    WorkersOption,
    console,
    print_json,
    table,
)
from cell.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from cell.configuration import Configuration
    from cell.interfaces.bench import Bench
    from cell.interfaces.product import Product

KINDS = ("classical", "learned")

KindOption = Annotated[
    str | None, typer.Option(help="classical or learned for all detectors; by default as configured.")
]


def system(
    perception: KindOption = None,
    look: LookOption = "varied",
    person: PersonOption = "careful",
    goals: Annotated[list[int] | None, typer.Option(help="How many goals are possible; may be repeated.")] = None,
    runs: Annotated[int, typer.Option(min=1, help="Assemblies for each number of goals.")] = 4,
    first_seed: TestSeedOption = 900_000,
    cameras: HungOption = Hung.calibrated,
    out: RowsOption = None,
    workers: WorkersOption = 1,
    scheduler: SchedulerOption = None,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> int:
    """Whole assemblies: how often actions are detected, guidance is right, and the product is, by number of goals.

    Interrupted, it prints the table of what was run; with the same --out it goes on there.
    """
    from cell.configuration import detected_by, load_configuration, simulated
    from cell.files.row_store import RowStore
    from cell.fleet.engine import mapped
    from cell.lab.system import evaluate_system, table_1

    if perception not in (None, *KINDS):
        raise InputError(f"--perception {perception}: legal: {', '.join(KINDS)}")
    configuration = detected_by(simulated(load_configuration(config), look, person), perception)
    told = {"look": look, "person": person, "perception": configuration.perception.words, "cameras": cameras.value}
    wanted = [(count, seed) for seed in range(first_seed, first_seed + runs) for count in goals or [3]]
    kept = RowStore(out, ["goals", "seed"], {"command": "system", **told})
    rows = list(kept.rows_of([one for one in wanted if one in kept]))
    left = [one for one in wanted if one not in kept]
    status = 0
    try:
        work = partial(evaluate_system, configuration, config, calibrated=cameras is Hung.calibrated)
        for row in mapped(work, left, workers, scheduler):
            if row["end"] == "interrupted":  # the controller heard the signal; the seed is run again another time
                raise KeyboardInterrupt
            kept.add(row)
            rows.append(row)
            console().print(row, highlight=False)
    except KeyboardInterrupt:
        console().print(f"interrupted after {len(rows)} of {len(wanted)} assemblies")
        status = 1
    found = table_1(rows)
    for count, scores in found.items():
        title = f"{count} goals, look {look}, person {person}, perception {told['perception']}, cameras {cameras.value}"
        console().print(table(title, {name: _words(value) for name, value in scores.items()}))
    if as_json:
        print_json({**told, "first_seed": first_seed, "runs": runs, "goals": found})
    return status


def latency(
    perception: KindOption = None,
    look: LookOption = "varied",
    frames: Annotated[int, typer.Option(min=20, help="Of the overhead camera, in a row.")] = 200,
    trays: Annotated[int, typer.Option(min=10, help="Images of the wrist camera.")] = 30,
    first_seed: Annotated[int, typer.Option(min=0, help="Of the assembly, and of the first tray.")] = 800_000,
    note: Annotated[
        bool, typer.Option("--note", help="Write the 95th percentiles onto the cards of the trained detectors.")
    ] = False,
    untrained: Annotated[
        str | None,
        typer.Option(help="Actions by this kind of network, as in paper, whose weights nobody has trained."),
    ] = None,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> None:
    """How much processor time the detectors take for a frame, on one thread.

    In lock-step simulation answers come as late as the model cards tell (`perception.latency_s`).
    """
    from cell.configuration import detected_by, load_configuration, simulated
    from cell.lab.latency import answers_ms, note_latencies

    configuration: Configuration = detected_by(simulated(load_configuration(config), look), perception)
    if untrained is None:
        found = latencies_ms(configuration, config, frames, trays, first_seed)
    elif note:
        raise InputError("--note writes onto the cards of trained detectors; leave --untrained out")
    else:
        found = _untrained_ms(untrained, configuration, config, frames, trays, first_seed)
    rows = {name: f"{each['p50_ms']} / {each['p95_ms']} ms" for name, each in found.items()}
    words = configuration.perception.words + (f", actions {untrained} (weights not trained)" if untrained else "")
    console().print(table(f"median / 95 %, {words}, {look}", rows))
    if note:
        for path in note_latencies(configuration.perception, answers_ms(found)):
            console().print(f"noted in {path}", highlight=False)
    if as_json:
        print_json({"look": look, "perception": words, **found})


def latencies_ms(
    configuration: Configuration, config: Path, frames: int, trays: int, first_seed: int
) -> dict[str, dict[str, float]]:
    """Median and 95th percentile of each detector's processor time; "frame" and "tray": all that an image costs."""
    import numpy as np

    from cell.commands.frame_sources import open_source
    from cell.configuration import load_product
    from cell.lab.holes_and_parts import tray_frames
    from cell.lab.latency import finding_s, watching_s

    product, overhead = load_product(configuration, config), configuration.bench.overhead
    source = open_source(f"sim:{first_seed}", "overhead", configuration, product, overhead.mount.pose)
    spent = watching_s(configuration, product, islice(source.frames, frames))
    seeds = range(first_seed, first_seed + trays)
    spent |= finding_s(configuration, product, tray_frames(configuration, product, seeds))
    return {
        name: {f"p{percent}_ms": round(1e3 * float(np.percentile(values, percent)), 2) for percent in (50, 95)}
        for name, values in spent.items()
    }


def _untrained_ms(
    kind: str, configuration: Configuration, config: Path, frames: int, trays: int, first_seed: int
) -> dict[str, dict[str, float]]:
    """As `latencies_ms`, with a network of actions that learned nothing: answers are wrong, and take as long."""
    import tempfile
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context
    from pathlib import Path

    from cell.commands.weights import need_torch
    from cell.configuration import load_product
    from cell.interfaces.planning import weights_file
    from cell.wiring.detectors import TRAINED

    if kind not in TRAINED["actions"]:
        raise InputError(f"--untrained {kind}: there is no such one; legal: {', '.join(TRAINED['actions'])}")
    need_torch()
    with tempfile.TemporaryDirectory() as made:
        file = Path(made) / weights_file("actions", kind)
        product = load_product(configuration, config)
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:  # torch and software OpenGL do not mix
            pool.submit(_write_untrained, configuration.bench, product, kind, file).result()
        perception = configuration.perception.with_detector("actions", kind, file)
        timed = configuration.model_copy(update={"perception": perception})
        return latencies_ms(timed, config, frames, trays, first_seed)


def _write_untrained(bench: Bench, product: Product, kind: str, file: Path) -> None:
    from learned.actions.train import Task, write_untrained

    write_untrained(Task(bench, product), kind, file)


def _words(value: object) -> str:
    if isinstance(value, dict) and "share" in value:
        return f"{value['share']:.3f} of {value['n']} ({value['low']:.3f} - {value['high']:.3f})"
    return str(value)
