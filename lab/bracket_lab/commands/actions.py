"""`cell lab eval actions`: detectors of actions watch whole assemblies, tracker in the loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated

from typer import Option

from bracket_cell.commands.options import command_from, writable
from bracket_cell.commands.terminal import console, print_json, table
from bracket_cell.learned.actions.settings import TRAINABLE, Classes
from bracket_ground.errors import InputError
from bracket_ground.files.row_store import Row, RowStore
from bracket_ground.interfaces.product import Product
from bracket_lab.commands.shared import Cameras, Shared, share_words
from bracket_lab.commands.training.networks import save_confusions
from bracket_lab.evaluations import actions as scoring
from bracket_lab.evaluations.actions import Tally, at_pace, evaluate_segments, summed

_OPTIONS = ("kind", "weights", "data", "look", "person", "seeds", "physics", "cameras", "out", "config", "as_json")


@command_from(Shared, *_OPTIONS, seeds="900000:900004")
def evaluate(
    shared: Shared,
    pace: Annotated[
        float | None, Option(min=0.2, max=5, help="How fast the person moves: 2 for twice the usual speed.")
    ] = None,
    quick: Annotated[
        bool,
        Option("--quick", help="Score only the last frames of segments, on the true track with a tracker's noise."),
    ] = False,
    confusions: Annotated[
        Path | None, Option(help="Write the confusion matrix of the first kind, for planners.semantic.confusions.")
    ] = None,
) -> int:
    """Score action detectors on whole assemblies, tracker in the loop. Kinds: slim, paper, classical.

    Interrupted, it prints the tables of what was run and ends with status 1; with the same --out it goes on there.
    """
    if shared.data:
        shared.score_pictures("actions", shared.one_kind(TRAINABLE), shared.data)
        return 0
    configuration, product = shared.cell()
    configuration = at_pace(configuration, pace)
    kinds = shared.kind or [configuration.perception.chosen("actions").kind]
    _require_possible(kinds, shared.weights, confusions, quick=quick)
    split, wanted = shared.split()
    fields: dict[str, object] = {"look": shared.look, "person": shared.person, "pace": pace}
    if quick:
        scores = evaluate_segments(configuration, product, kinds[0], wanted, shared.weights)
        print_json({**fields, "seeds": shared.seeds, **scores})
        return 0
    perception = configuration.perception
    fields |= {"tracker": perception.chosen("hands").kind, "physics": shared.physics, "cameras": shared.cameras.value}
    used = [*perception.files("hands").values(), *perception.files("holes").values()]
    used += [perception.with_detector("actions", kind).weights("actions") for kind in kinds if kind in TRAINABLE]
    used += [shared.weights] if shared.weights is not None else []
    there = [path for path in used if path.is_file()]
    kept = shared.rows(["seed"], {"command": "actions", **fields, "kinds": kinds}, scoring, *there)
    watch = partial(
        scoring.evaluate_actions,
        *(configuration, product, kinds),
        physics=shared.physics,
        weights={} if shared.weights is None else {kinds[0]: shared.weights},
        calibrated=shared.cameras is Cameras.calibrated,
    )
    rows = _watched(watch, wanted, kept)
    if not rows:
        return 1
    title = f"look {shared.look}, person {shared.person}, seeds {shared.seeds} ({split})"
    source = f"cell lab eval actions --look {shared.look} --person {shared.person} --seeds {shared.seeds}"
    found = _reported(product, kinds, rows, title, source, confusions)
    if shared.as_json:
        print_json({**fields, "seeds": shared.seeds, "recordings": len(rows), "kinds": found})
    return 0 if len(rows) == len(wanted) else 1


def _require_possible(kinds: Sequence[str], weights: Path | None, confusions: Path | None, *, quick: bool) -> None:
    """Check that options of `evaluate` go together.

    Raises:
        InputError: they do not, or what is to be written is there already.
    """
    if weights is not None and len(kinds) != 1:
        raise InputError("--weights are of one --kind")
    if weights is not None and kinds[0] == "classical":
        raise InputError(f"--weights {weights}: nothing reads them: they go with --kind {', '.join(TRAINABLE)}")
    if confusions is not None and writable(confusions, ".json", option="--confusions").exists():
        raise InputError(f"--confusions {confusions}: exists already; name another file, or remove it")
    if quick and (len(kinds) != 1 or kinds[0] == "classical"):
        raise InputError("--quick asks one trained --kind about single segments; classical ones need every frame")


def _reported(
    product: Product, kinds: Sequence[str], rows: Sequence[Row], title: str, source: str, confusions: Path | None
) -> dict[str, dict[str, object]]:
    """Print a table for each kind, write what the first one takes for what, and return all figures by kind."""
    tallies = summed(kinds, rows)
    if confusions is not None:
        save_confusions(confusions, product, tallies[kinds[0]].reports(Classes.of(product)), source)
    found = {name: tally.summary(Classes.of(product)) for name, tally in tallies.items()}
    for name, scores in found.items():
        words = {key: share_words(value) for key, value in scores.items() if key != "confusions"}
        console().print(table(f"{name}, {title}", words))
    return found


def _watched(watch: Callable[[list[int]], Mapping[str, Tally]], seeds: Sequence[int], kept: RowStore) -> list[Row]:
    """Rows of these seeds; those that are not in the file yet are run, until somebody interrupts."""
    try:
        for seed in (seed for seed in seeds if seed not in kept):
            kept.add({"seed": seed, "kinds": {name: asdict(tally) for name, tally in watch([seed]).items()}})
    except KeyboardInterrupt:
        count = sum(row["seed"] in seeds for row in kept.rows)
        console().print(f"interrupted after {count} of {len(seeds)} assemblies")
    return [row for row in kept.rows if row["seed"] in seeds]
