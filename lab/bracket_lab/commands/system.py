"""`cell lab eval system` and `cell lab eval latency`: all detectors of a configuration together."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

from typer import Option

from bracket_cell.commands.options import command_from
from bracket_cell.commands.terminal import console, print_json, table
from bracket_cell.configuration import Configuration, detected_by
from bracket_cell.fleet.engine import mapped
from bracket_cell.kinds import DETECTORS
from bracket_ground.errors import InputError
from bracket_ground.files.files import shipped
from bracket_lab.commands.shared import Cameras, Shared, share_words
from bracket_lab.evaluations import system as scoring
from bracket_lab.wiring.latency import answers_ms, latencies_ms, note_latencies

KINDS = ("classical", "learned")
TREE = shipped("bracket_cell.trees", "assemble.xml")
_SYSTEM = ("perception", "look", "person", "seeds", "cameras", "out", "workers", "scheduler", "config", "as_json")


@command_from(Shared, *_SYSTEM, person="careful", seeds="900000:900004")
def system(
    shared: Shared,
    goals: Annotated[list[int] | None, Option(help="Number of possible goals; may be repeated.")] = None,
    tree: Annotated[Path, Option(help="Tree file.")] = TREE,
    at_most: Annotated[
        float | None, Option(min=1, help="End after N simulated seconds; by default as configured.")
    ] = None,
    by_hand: Annotated[
        bool, Option("--by-hand", help="Read no holes; placements come from the hand alone, as in the paper.")
    ] = False,
    pixels: Annotated[
        bool,
        Option(
            "--pixels/--no-pixels",
            help="Render what cameras see; else planner, tree and arm alone are scored, of trees that read holes.",
        ),
    ] = True,
) -> int:
    """Score whole assemblies by number of goals: shares of detected actions, right guidance and right products.

    Interrupted, it prints the table of what was run; with the same --out it goes on there.
    """
    configuration, cameras = _configured(shared, by_hand=by_hand, at_most=at_most), shared.cameras.value
    fields = {"look": shared.look, "person": shared.person, "perception": configuration.perception.words}
    fields |= {
        "cameras": cameras,
        "tree": tree.name,
        "at_most_s": f"{configuration.controller.max_duration_s:g}",
        "pixels": "rendered" if pixels else "none",
    }
    wanted = [(count, seed) for seed in shared.numbers for count in goals or [3]]
    used = [path for task in DETECTORS for path in configuration.perception.files(task).values() if path.is_file()]
    kept = shared.rows(["goals", "seed"], {"command": "system", **fields}, scoring, *used)
    rows = list(kept.rows_of(key for key in wanted if key in kept))
    left = [key for key in wanted if key not in kept]
    status = 0
    try:
        calibrated = shared.cameras is Cameras.calibrated
        work = partial(
            scoring.evaluate_system, configuration, shared.config, tree, calibrated=calibrated, pixels=pixels
        )
        for row in mapped(work, left, shared.workers, shared.scheduler):
            if row["end"] == "interrupted":  # the controller heard the signal; the seed is run again another time
                raise KeyboardInterrupt
            kept.add(row)
            rows.append(row)
            console().print(row, highlight=False)
    except KeyboardInterrupt:
        console().print(f"interrupted after {len(rows)} of {len(wanted)} assemblies")
        status = 1
    found = scoring.table_1(rows)
    for count, scores in found.items():
        title = f"{count} goals, " + ", ".join(f"{name} {value}" for name, value in fields.items())
        console().print(table(title, {name: share_words(value) for name, value in scores.items()}))
    if shared.as_json:
        print_json({**fields, "seeds": shared.seeds, "goals": found})
    return status


def _configured(shared: Shared, *, by_hand: bool, at_most: float | None) -> Configuration:
    """The configuration with the detectors and the time that are asked for.

    Raises:
        InputError: there are no such detectors.
    """
    if shared.perception not in (None, *KINDS):
        raise InputError(f"--perception {shared.perception}: legal: {', '.join(KINDS)}")
    configuration = detected_by(shared.cell()[0], shared.perception)
    configuration = configuration.by_hand() if by_hand else configuration
    if at_most is None:
        return configuration
    controller = configuration.controller.model_copy(update={"max_duration_s": at_most})
    return configuration.model_copy(update={"controller": controller})


@command_from(Shared, "perception", "look", "seed", "config", "as_json", seed=800_000)
def latency(
    shared: Shared,
    frames: Annotated[int, Option(min=20, help="Frames of the overhead camera, in a row.")] = 200,
    trays: Annotated[int, Option(min=10, help="Images of the wrist camera.")] = 30,
    note: Annotated[
        bool, Option("--note", help="Write the 95th percentiles onto the cards of the trained detectors.")
    ] = False,
) -> None:
    """Measure the detectors' processor time for a frame, on one thread.

    In lock-step simulation answers come as late as the model cards say (`perception.latency_s`).
    """
    configuration, product = shared.cell(person=False)
    configuration = detected_by(configuration, shared.perception)
    found = latencies_ms(configuration, product, frames, trays, shared.seed)
    rows = {name: f"{each['p50_ms']} / {each['p95_ms']} ms" for name, each in found.items()}
    words = configuration.perception.words
    console().print(table(f"median / 95 %, {words}, {shared.look}", rows))
    if note:
        for path in note_latencies(configuration.perception, answers_ms(found)):
            console().print(f"noted in {path}", highlight=False)
    if shared.as_json:
        print_json({"look": shared.look, "perception": words, **found})
