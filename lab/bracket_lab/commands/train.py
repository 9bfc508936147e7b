"""`cell train`: the networks that a product needs, or all that are shipped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from bracket_cell.commands.options import CONFIGURATION, ConfigOption, OverwriteOption, SeedOption, command_from
from bracket_cell.commands.terminal import console, product_of, report_scores
from bracket_cell.learned.semantic.records import load_demonstrations
from bracket_ground.errors import InputError
from bracket_ground.interfaces.product import Product
from bracket_lab.commands.training.shipped import Step, of_paper, scaled, steps_of_shipped, train_steps
from bracket_lab.commands.training.tasks import TASKS
from bracket_lab.commands.training.weights import Training, writing
from bracket_lab.learned.training.schedule import MOST_EPOCHS

OPTIONS = (
    *("network", "data", "simulated", "curve", "begin", "epochs", "every", "only", "plan", "budget"),
    *("recorded", "jobs", "out", "overwrite", "config", "seed"),
)
FOLDER, PAPER = Path("trained"), "paper"
OWN = ("hands", "holes", "parts", "actions")
FEWEST_DEMONSTRATIONS = 20  # fewer tell nothing of people's habits
GRASP_MINUTES, SEMANTIC_MINUTES = 1, 1  # of one CPU core
SCORES = {"grasp": "accuracy", "semantic": "success"}  # words of those that are shown


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """What `cell train` is asked for."""

    network: Annotated[
        str | None,
        Argument(help="One network to train on your own labelled pictures: " + ", ".join(OWN) + "; goes with --data."),
    ] = None
    data: Annotated[
        list[Path] | None, Option(help="Folder of `cell label`, or of segments for actions; may be repeated.")
    ] = None
    simulated: Annotated[bool, Option("--simulated", help="With --data: learn from simulated data, too.")] = False
    epochs: Annotated[int | None, Option(min=1, max=MOST_EPOCHS, help="With --data: passes through the data.")] = None
    curve: Annotated[
        bool, Option("--curve", help="With parts: learn from a quarter and half of the pictures too, to compare.")
    ] = False
    begin: Annotated[
        str | None, Option(metavar="shipped|FILE", help="With hands: go on with weights that were trained before.")
    ] = None
    recorded: Annotated[
        Path | None, Option(help="Folder of `cell log export --to training`: learn from these runs too.")
    ] = None
    every: Annotated[bool, Option("--all", help="Train all networks that are shipped, data included.")] = False
    only: Annotated[
        list[str] | None,
        Option(help=f"Train only {', '.join(TASKS)}, or {PAPER}, the paper's own system; may be repeated."),
    ] = None
    plan: Annotated[bool, Option("--plan", help="Say what would be done, and do nothing.")] = False
    budget: Annotated[
        str | None, Option(help="Processor time for all detectors together, like 2h; by default as on the model cards.")
    ] = None
    jobs: Annotated[int, Option("--jobs", "-j", min=1, help="Trainings at the same time, one core each.")] = 1
    out: Annotated[Path, Option("--out", "-o", help="With --all or --only: folder for weights and training data.")] = (
        FOLDER
    )
    overwrite: OverwriteOption = False
    config: ConfigOption = CONFIGURATION
    seed: SeedOption = 0


@command_from(TrainOptions, *OPTIONS)
def train(wanted: TrainOptions) -> None:
    """Train planners and detectors for a product.

    Without options, the planners that the product of the configuration needs, next to the configuration. With --all or
    --only, networks for the product, their data included, into a folder; interrupted, the same command goes on there.
    With the name of a network and --data, that one, on your own pictures.
    """
    if wanted.network is not None or wanted.data:
        _train_on_own(wanted)
        return
    if wanted.every or wanted.only:
        train_steps(_steps(wanted), wanted.out, wanted.config, jobs=wanted.jobs, plan=wanted.plan)
        return
    if wanted.budget is not None or wanted.out != FOLDER:
        raise InputError("--budget and --out go with --all or --only; planners take a minute, next to --config")
    _train_planners(wanted)


def _train_on_own(wanted: TrainOptions) -> None:
    """One network, on labelled pictures.

    Raises:
        InputError: the network or the data are not named, or options of other trainings are.
    """
    if wanted.network in TASKS and wanted.network not in OWN:
        raise InputError(f"cell train {wanted.network}: learns from no pictures; cell train --only {wanted.network}")
    if wanted.network not in OWN:
        raise InputError(f"cell train {wanted.network or ''}: name the network to train; legal: {', '.join(OWN)}")
    if not wanted.data:
        raise InputError(
            f"cell train {wanted.network}: learns from your own pictures, --data DIR of `cell label`; "
            f"from simulated ones: cell train --only {wanted.network}"
        )
    if wanted.every or wanted.only or wanted.plan or wanted.recorded:
        raise InputError("--all, --only, --plan and --recorded do not go with --data")
    if wanted.begin is not None and wanted.network != "hands":
        raise InputError(f"--begin {wanted.begin}: goes with hands; {wanted.network} are trained from nothing")
    if wanted.curve and wanted.network != "parts":
        raise InputError(f"--curve: goes with parts; not with {wanted.network}")
    task = TASKS[wanted.network]
    asked = Training(
        data=wanted.data,
        simulated=wanted.simulated,
        curve=wanted.curve,
        begin=wanted.begin,
        epochs=wanted.epochs,
        budget=wanted.budget or (task.defaults or {}).get("budget", ""),
        out=None if wanted.out == FOLDER else wanted.out,
        overwrite=wanted.overwrite,
        config=wanted.config,
        seed=wanted.seed,
    )
    task.train(asked)


def _steps(wanted: TrainOptions) -> list[Step]:
    """The trainings of --all or --only.

    Raises:
        InputError: there is no network of a name, or none of the budget.
    """
    if unknown := [name for name in wanted.only or () if name not in (*TASKS, PAPER)]:
        raise InputError(f"--only {unknown[0]}: unknown network; legal: {', '.join((*TASKS, PAPER))}")
    steps = [step for step in steps_of_shipped() if not wanted.only or _asked_for(step, wanted.only)]
    segments = _segments(wanted.recorded)
    if segments is not None and (not wanted.only or "noise" in wanted.only):
        steps.append(Step(("noise", "--data", str(segments)), ("confusions.json",), 1.0))
    elif "noise" in (wanted.only or ()):
        raise InputError("--only noise: is learned from recorded runs; name their folder with --recorded DIR")
    return scaled(steps, wanted.budget)


def _asked_for(step: Step, only: Sequence[str]) -> bool:
    return step.words[0] in only or (PAPER in only and of_paper(step))


def _train_planners(wanted: TrainOptions) -> None:
    product = product_of(wanted.config)
    habits = _demonstrations(wanted.recorded, product)
    learns_habits = habits >= FEWEST_DEMONSTRATIONS
    _say_plan(product, habits)
    if wanted.plan:
        return
    segments = _segments(wanted.recorded)
    tasks: dict[str, Training] = {"grasp": _asked(wanted, "pairwise", None)}
    if learns_habits and wanted.recorded is not None:
        tasks["semantic"] = _asked(wanted, "factored", wanted.recorded / "demonstrations.jsonl")
    if segments is not None:
        tasks["noise"] = _asked(wanted, "", segments)
    files = {name: TASKS[name].file(asked) for name, asked in tasks.items()}
    first, *others = files.values()
    with writing(first, *others, overwrite=wanted.overwrite, option="--config"):
        for name, asked in tasks.items():
            scores = TASKS[name].fit(asked, files[name])
            shown = {key: value for key, value in scores.items() if SCORES.get(name, "") in key}
            report_scores(f"{TASKS[name].title} in {files[name]}", shown, as_json=False)
    _say_lines(wanted.config, {name: path.name for name, path in files.items()})


def _say_plan(product: Product, habits: int) -> None:
    learns_habits = habits >= FEWEST_DEMONSTRATIONS
    minutes = GRASP_MINUTES + SEMANTIC_MINUTES * learns_habits
    say = console().print
    say(f"for {product.name}, about {minutes} minute{'s' * (minutes > 1)} of one CPU core:")
    say("- grasp planner `pairwise`, on drawn trays with parts of these sizes")
    if learns_habits:
        say(f"- semantic planner `factored`, on {habits} recorded assemblies")
    else:
        say(
            f"- semantic planner: nothing, `bayes` reads the goals from the product file; with {FEWEST_DEMONSTRATIONS} "
            f"recorded assemblies ({habits} here) people's habits can be learned (--recorded)"
        )


def _say_lines(config: Path, files: dict[str, str]) -> None:
    """The lines that take the planners into use."""
    semantic = ["kind: factored", f"weights: {files['semantic']}"] if "semantic" in files else ["kind: bayes"]
    semantic += [f"confusions: {files['noise']}"] if "noise" in files else []
    say = console().print
    say("its detectors: cell train --all --plan", highlight=False)
    say(f"in {config}:")
    say("planners:", highlight=False)
    for planner, lines in (("semantic", semantic), ("grasp", ["kind: pairwise", f"weights: {files['grasp']}"])):
        say(f"  {planner}:", *(f"    {line}" for line in lines), sep="\n", highlight=False)


def _asked(wanted: TrainOptions, kind: str, data: Path | None) -> Training:
    return Training(kind=kind, data=None if data is None else [data], config=wanted.config, seed=wanted.seed)


def _segments(recorded: Path | None) -> Path | None:
    path = None if recorded is None else recorded / "segments.jsonl"
    return path if path is not None and path.exists() else None


def _demonstrations(recorded: Path | None, product: Product) -> int:
    """How many recorded assemblies there are.

    Raises:
        InputError: the folder holds no training data of runs, or the file is wrong.
    """
    if recorded is None:
        return 0
    if not any((recorded / name).is_file() for name in ("manifest.json", "demonstrations.jsonl", "segments.jsonl")):
        raise InputError(f"--recorded {recorded}: holds no data of `cell log export --to training`")
    path = recorded / "demonstrations.jsonl"
    if not path.exists():  # no run's goal is known
        return 0
    return sum(demonstration.goal in product.goals for demonstration in load_demonstrations(path, product))
