"""`cell train actions` and `cell eval actions`."""

from __future__ import annotations

import shlex
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cell.commands.budget import seconds as budget_s
from cell.commands.detectors import Hung, HungOption, LookOption, PersonOption, TestSeedOption, how_to_use
from cell.commands.made_data import make_data, require_usable
from cell.commands.terminal import (
    CONFIGURATION,
    ConfigOption,
    JsonOption,
    RowsOption,
    SeedOption,
    console,
    print_json,
    table,
)
from cell.commands.weights import OverwriteOption, need_torch, new_weights, writable, writing
from cell.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from cell.files.row_store import Row, RowStore
    from cell.interfaces.product import Product
    from cell.lab.actions import Tally
    from learned.semantic.confusions import Reported


@dataclass(frozen=True)
class Kind:
    """Some of the recordings to learn from: share of all, and first seed."""

    look: str
    share: float
    first_seed: int
    physics: bool = False


KINDS = (
    Kind("people", 0.28, 0),
    Kind("varied", 0.20, 300_000),
    Kind("nominal", 0.10, 500_000),
    Kind("people", 0.25, 100_000, physics=True),
    Kind("varied", 0.12, 400_000, physics=True),
    Kind("nominal", 0.05, 450_000, physics=True),
)
DATA_S, PHYSICS_S = 3.0, 3.5  # processor time of a recording
DATA_SHARE = 0.66  # of a budget
PIECE = 50  # recordings that are made at once: an interrupted training goes on with the next piece
VALIDATION_SEED, VALIDATION_SHARE = 800_000, 0.1
STEEL_SHARE = 0.25  # of recordings to learn from; those for the scores show the product as it is

KindsOption = Annotated[list[str] | None, typer.Option("--kind", help="slim, paper or classical; may be repeated.")]


def train(
    kind: Annotated[str, typer.Option(help="slim, paper, cnn_lstm, hand, lrcn or track.")] = "slim",
    data: Annotated[
        list[Path] | None, typer.Option(help="Folder of `cell data actions` or `cell data --from`; may be repeated.")
    ] = None,
    validation: Annotated[Path | None, typer.Option(help="Another such folder, for the scores.")] = None,
    look: Annotated[
        str | None,
        typer.Option(help="Of all recordings that are made where no --data is given; else of several looks."),
    ] = None,
    budget: Annotated[str, typer.Option(help="Processor time for data and training, as in 30m or 90s.")] = "20m",
    epochs: Annotated[int, typer.Option(min=1, help="Passes through the data, as far as the budget goes.")] = 14,
    share: Annotated[float, typer.Option(min=0.05, max=1, help="Of VGG16's channels, where it is used.")] = 1.0,
    out: Annotated[Path | None, typer.Option(help="File to write; beside --config by default.")] = None,
    overwrite: OverwriteOption = False,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Train a detector of actions; makes its own recordings by the simulated person unless --data is given.

    They are kept beside the weights; interrupted and begun again, it goes on where it was.
    """
    need_torch()
    from cell.configuration import load_configuration, load_product
    from learned.actions.data import load_segments
    from learned.actions.settings import TRAINABLE, ActionTraining
    from learned.actions.train import Task, train_actions

    configuration = load_configuration(config)
    task = Task(configuration.bench, load_product(configuration, config))
    _require_apart(data or (), validation)
    if kind not in TRAINABLE:
        raise InputError(f"no action detector {kind!r} can be trained; legal: {', '.join(TRAINABLE)}")
    path, seconds = new_weights("actions", kind, config, out), budget_s(budget)
    command = _command(kind, data, validation, look, budget, epochs, share, seed)
    settings = ActionTraining(epochs=epochs, share=share)
    fit = partial(train_actions, seed=seed, command=command, quiet=False)
    confusions = path.with_name(f"{path.stem}_confusions.json")
    with writing(path, confusions, overwrite=overwrite):
        if not data or validation is None:
            data, validation = _recordings(path, look, config, seconds, frames=kind == "lrcn")
            seconds *= 1 - DATA_SHARE
        learned, kept = load_segments(data, task.classes), load_segments([validation], task.classes)
        console().print(f"{len(learned)} segments to learn from, {len(kept)} for the scores")
        scores = fit(task, learned, kept, path, kind, settings=settings, budget_s=seconds)
        _note_confusions(path, kind, task.product, command, confusions)
    console().print(table(f"weights in {path}; what is taken for what in {confusions.name}", scores))
    how_to_use("actions", kind, path, config)
    if as_json:
        print_json(scores)


def evaluate(
    kind: KindsOption = None,
    look: LookOption = "varied",
    person: PersonOption = "varied",
    pace: Annotated[
        float | None, typer.Option(min=0.2, max=5, help="How fast the person moves: 2 for twice the usual speed.")
    ] = None,
    recordings: Annotated[int, typer.Option(min=1, help="How many assemblies.")] = 4,
    first_seed: TestSeedOption = 900_000,
    true_track: Annotated[bool, typer.Option("--true-track", help="A tracker without error.")] = False,
    physics: Annotated[bool, typer.Option("--physics", help="Hand and parts moved by physics; frames blur.")] = False,
    quick: Annotated[
        bool, typer.Option("--quick", help="Only the segments' last frames; true track with a tracker's noise.")
    ] = False,
    weights: Annotated[Path | None, typer.Option(help="Of the only --kind, instead of the configured file.")] = None,
    cameras: HungOption = Hung.calibrated,
    confusions: Annotated[
        Path | None, typer.Option(help="Write what the first kind takes for what, for planners.semantic.confusions.")
    ] = None,
    out: RowsOption = None,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> int:
    """Let detectors of actions watch whole assemblies, tracker in the loop, and compare with the truth.

    Interrupted, it prints the tables of what was run and ends with status 1; with the same --out it goes on there.
    """
    from cell.configuration import load_configuration, load_product, simulated
    from cell.files.row_store import RowStore
    from cell.lab.actions import at_pace, evaluate_actions, evaluate_segments
    from sim.data.splits import seeds

    configuration = at_pace(simulated(load_configuration(config), look, person), pace)
    product = load_product(configuration, config)
    kinds = kind or [configuration.perception.chosen("actions").kind]
    _require_possible(kinds, weights, confusions, quick=quick)
    split, wanted = seeds(first_seed, recordings)
    told: dict[str, object] = {"look": look, "person": person, "pace": pace}
    if quick:
        scores = evaluate_segments(configuration, product, kinds[0], wanted, weights)
        print_json({**told, "first_seed": first_seed, "recordings": recordings, **scores})
        return 0
    tracker = "truth" if true_track else configuration.perception.chosen("hands").kind
    told |= {"tracker": tracker, "physics": physics, "cameras": cameras.value}
    of_weights = {} if weights is None else {kinds[0]: weights}
    kept = RowStore(out, ["seed"], {"command": "actions", **told, "kinds": kinds, "weights": weights and str(weights)})
    watch = partial(
        evaluate_actions,
        *(configuration, product, kinds),
        true_track=true_track,
        physics=physics,
        weights=of_weights,
        calibrated=cameras is Hung.calibrated,
    )
    rows = _watched(watch, wanted, kept)
    if not rows:
        return 1
    title = f"look {look}, person {person}, seeds {wanted[0]}-{wanted[-1]} ({split})"
    source = f"cell eval actions --look {look} --person {person} --first-seed {first_seed}"
    found = _reported(product, kinds, rows, title, source, confusions)
    if as_json:
        print_json({**told, "first_seed": first_seed, "recordings": len(rows), "kinds": found})
    return 0 if len(rows) == len(wanted) else 1


def _require_possible(kinds: Sequence[str], weights: Path | None, confusions: Path | None, *, quick: bool) -> None:
    """Check that options of `evaluate` go together.

    Raises:
        InputError: they do not, or what is to be written is there already.
    """
    from learned.actions.settings import TRAINABLE

    if weights is not None and len(kinds) != 1:
        raise InputError("--weights are of one --kind")
    if weights is not None and kinds[0] == "classical":
        raise InputError(f"--weights {weights}: nothing reads them: they go with --kind {', '.join(TRAINABLE)}")
    if confusions is not None and writable(confusions, ".json", option="--confusions").exists():
        raise InputError(f"--confusions {confusions}: is there already; name another file, or remove it")
    if quick and (len(kinds) != 1 or kinds[0] == "classical"):
        raise InputError("--quick asks one trained --kind about single segments; classical ones need every frame")


def _reported(
    product: Product, kinds: Sequence[str], rows: Sequence[Row], title: str, source: str, confusions: Path | None
) -> dict[str, dict[str, object]]:
    """Print a table for each kind, write what the first one takes for what, and return all figures by kind."""
    from cell.lab.actions import summed
    from learned.actions.settings import Classes

    tallies = summed(kinds, rows)
    if confusions is not None:
        _save_confusions(confusions, product, tallies[kinds[0]].reports(Classes.of(product)), source)
    found = {name: tally.summary(Classes.of(product)) for name, tally in tallies.items()}
    for name, scores in found.items():
        words = {key: _words(value) for key, value in scores.items() if key != "confusions"}
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


def _require_apart(data: Sequence[Path], validation: Path | None) -> None:
    """Check that scores are of other segments than those that are learned from.

    Raises:
        InputError: they are of the same folder, or of the same log.
    """
    if bool(data) != bool(validation):
        raise InputError("--data and --validation go together: scores on what was learned from say nothing")
    if validation is None:
        return
    from cell.log.training.manifest import logs_by_hash

    kept, why = logs_by_hash(validation), "scores on what was learned from say nothing"
    for folder in data:
        if folder.resolve() == validation.resolve():
            raise InputError(f"--validation {validation}: is --data, too; {why}")
        if both := kept.keys() & logs_by_hash(folder).keys():
            log = kept[min(both)]
            raise InputError(f"--validation {validation}: was made from {log}, as --data {folder} was; {why}")


def _note_confusions(weights: Path, kind: str, product: Product, command: str, path: Path) -> None:
    """Write what the card says of assemblies taken for others, as the planner reads it."""
    import numpy as np

    from learned.actions.settings import Classes
    from learned.inference.onnx_model import OnnxModel

    told = OnnxModel.load(weights, f"actions.{kind}").card.config["confusion"]
    reports = Classes.of(product).reports(np.array(told["counts"]))  # type: ignore[call-overload, index]
    _save_confusions(path, product, reports, command)


def _save_confusions(path: Path, product: Product, reports: Sequence[Reported], source: str) -> None:
    """Write what reports say is taken for what, as `planners.semantic.confusions` reads it."""
    from learned.semantic.confusions import Confusions
    from learned.semantic.graph import Layout

    layout = Layout.of(product)
    Confusions.learned(layout, reports).save(path, layout, len(reports), source)


def _command(
    kind: str,
    data: list[Path] | None,
    validation: Path | None,
    look: str | None,
    budget: str,
    epochs: int,
    share: float,
    seed: int,
) -> str:
    """What makes the same weights again."""
    words = ["cell", "train", "actions", "--kind", kind, "--budget", budget, "--epochs", str(epochs)]
    words += ["--share", str(share)] if share != 1 else []
    words += [word for folder in data or () for word in ("--data", str(folder))]
    words += ["--validation", str(validation)] if validation is not None else []
    words += ["--look", look] if look is not None else []
    return shlex.join([*words, "--seed", str(seed)])


def _recordings(
    weights: Path, look: str | None, config: Path, seconds: float, *, frames: bool = False
) -> tuple[list[Path], Path]:
    """Make recordings to learn from and for the scores."""
    kinds = KINDS if look is None else (Kind(look, 1.0, 0),)
    each_s = sum(kind.share * (PHYSICS_S if kind.physics else DATA_S) for kind in kinds)
    count = max(4, int(DATA_SHARE * seconds / each_s))
    kept = max(2, int(VALIDATION_SHARE * count))
    validation = weights.with_suffix(".validation")
    flags = ["--thin", "--gaps", *(["--frames"] if frames else [])]
    wanted: dict[Path, tuple[dict[str, object], list[str]]] = {}
    for kind in kinds:
        of_kind = round(kind.share * count)
        by_physics = ["--physics"] * kind.physics
        for first in range(0, of_kind, PIECE):
            name = "-".join([Path(kind.look).stem, *(["physics"] * kind.physics), f"{first:06d}"])
            options = {
                "--look": kind.look,
                "--recordings": min(PIECE, of_kind - first),
                "--first-seed": kind.first_seed + first,
                "--steel-share": STEEL_SHARE,
                "--config": config,
            }
            wanted[weights.with_suffix(".data") / name] = options, [*flags, *by_physics]
    apart = {"--look": look or "varied", "--recordings": kept, "--first-seed": VALIDATION_SEED, "--config": config}
    require_usable(*wanted, validation)
    for folder, (options, words) in {**wanted, validation: (apart, flags)}.items():
        make_data("actions", folder, options, *words)
    return list(wanted), validation


def _words(value: object) -> str:
    if isinstance(value, dict) and "share" in value:
        return f"{value['share']:.3f} of {value['n']} ({value['low']:.3f} - {value['high']:.3f})"
    return str(value)
