"""A record for each network that can be trained, and the one way in which all of them are."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import typer

from bracket_cell.commands.options import command_from, folder_for, told_in, writable
from bracket_cell.commands.terminal import console, print_json, report_scores
from bracket_cell.learned.actions.settings import TRAINABLE
from bracket_cell.learned.hands.model import finder_file, refiner_file
from bracket_cell.learned.parts.model import pose_file
from bracket_cell.learned.parts.stacked import stacked_file
from bracket_cell.learned.semantic.confusions import Confusions, confirmed_reports
from bracket_cell.learned.semantic.graph import Layout
from bracket_ground.errors import InputError
from bracket_ground.interfaces.planning import crops_file
from bracket_lab.commands.training import networks
from bracket_lab.commands.training import tasks as planners
from bracket_lab.commands.training.shares import require_apart
from bracket_lab.commands.training.weights import Training, new_weights, seconds, writing
from bracket_lab.learned.parts.boxes import head_file
from bracket_lab.learned.parts.settings import BACKBONES, NARROW
from bracket_lab.pictures.scoring import objection
from bracket_lab.wiring.drawn_frames import tray_camera

Scores = Mapping[str, float]
Paths = tuple[Path, ...]
FitFunction = Callable[[Training, Path], Mapping[str, float]]
_BUDGET = {"budget": "30m"}
_PLANNER = "planners: {name}: {{kind: {kind}, weights: {file}}}"


def grasp(asked: Training, weights: Path) -> Scores:
    """Train the planner that judges graspability in clutter; goes on where an interrupted training stopped."""
    from bracket_lab.learned.grasp.data import read_scenes
    from bracket_lab.learned.grasp.train import train_grasp

    configuration, product = asked.cell()
    data = _only(asked)
    images = asked.kind == "paper"
    with tray_camera(product, configuration.bench) if images else nullcontext() as camera:
        return train_grasp(
            product,
            weights,
            asked.seed,
            asked.kind,
            scenes=None if data is None else read_scenes(data, product),
            camera=camera,
            command=asked.command("grasp"),
        )


def semantic(asked: Training, weights: Path) -> Scores:
    """Train the planner that infers the goal and what remains to be done; goes on where a training stopped."""
    from bracket_lab.learned.semantic.train import train_semantic

    _, product = asked.cell()
    data, how = _only(asked), {"ratio": asked.ratio, "augment": asked.augment}
    return train_semantic(product, weights, asked.seed, asked.kind, data=data, **how)  # type: ignore[arg-type]


def noise(asked: Training, path: Path) -> Scores:
    """Learn the action detector's confusion matrix, from actions that the holes confirmed."""
    if not asked.data:
        raise InputError("noise is learned from recorded runs: name their segments.jsonl with --data FILE")
    _, product = asked.cell()
    layout = Layout.of(product)
    reports = [report for file in asked.data for report in confirmed_reports(file)]
    try:
        learned = Confusions.learned(layout, reports)
    except ValueError as error:
        raise InputError(f"{asked.data[0]}: segments of another product: {error}") from error
    learned.save(path, layout, len(reports), asked.command("noise"))
    return {"confirmed actions": len(reports), "wrongly detected": sum(true != said for true, said in reports)}


def _only(asked: Training) -> Path | None:
    """The one file of data.

    Raises:
        InputError: several are named.
    """
    if asked.data and len(asked.data) > 1:
        raise InputError(f"--data {asked.data[1]}: planners learn from one file")
    return asked.data[0] if asked.data else None


@dataclass(frozen=True)
class LearnedTask:
    """A network, or a few of them that are trained together.

    Attributes:
        title: in words.
        kinds: that can be trained, the usual one first.
        options: of Training, besides those that all have.
        fit: trains and writes the file; returns the scores.
        beside: further files that it writes.
        defaults: of its options, where they are not Training's.
        use: the line that takes it into use, in the configuration; of {name}, {kind} and {file}.
        torch: it needs torch.
    """

    name: str
    title: str
    kinds: tuple[str, ...]
    options: tuple[str, ...]
    fit: FitFunction
    beside: Callable[[Path, str], Paths] = lambda *_: ()
    defaults: Mapping[str, Any] | None = None
    use: str = "perception: {name}: {{kind: {kind}, weights: {file}}}"
    torch: bool = True

    def file(self, asked: Training) -> Path:
        """What it writes.

        Raises:
            InputError: it cannot be written.
        """
        folder = folder_for(asked.config)
        if self.name == "noise":
            return writable(asked.out or folder / "confusions.json", ".json")
        return new_weights(self.name, asked.kind, asked.config, asked.out)

    def chosen(self, asked: Training) -> Training:
        """What is asked for, with a kind.

        Raises:
            InputError: there is none of this name, or the budget is no time.
        """
        if asked.kind and asked.kind not in self.kinds:
            raise InputError(f"--kind {asked.kind}: unknown kind of {self.name}; legal: {', '.join(self.kinds)}")
        if "budget" in self.options:
            seconds(asked.budget)
        if asked.kind == "rcnn" and asked.backbone not in BACKBONES:
            raise InputError(f"--backbone {asked.backbone}: unknown backbone; legal: {', '.join(BACKBONES)}")
        if asked.kind == "rcnn" and asked.share != 1 and asked.backbone != NARROW:
            raise InputError(f"--share {asked.share:g}: goes with --backbone {NARROW}; {asked.backbone} is whole")
        if self.name == "actions":
            require_apart(asked.data or (), asked.validation)
        return replace(asked, kind=asked.kind or (self.kinds or ("",))[0])

    def train(self, asked: Training) -> Mapping[str, float]:
        """Train it, write it and say how good it is; returns the scores."""
        asked = self.chosen(asked)
        path = self.file(asked)
        with writing(path, *self.beside(path, asked.kind), overwrite=asked.overwrite):
            scores = self.fit(asked, path)
        report_scores(f"{self.title} in {path}", scores, as_json=False)
        if (why := objection(scores)) is not None:
            console().print(f"not recommended: {why}; {asked.config} stays as it is", highlight=False)
        elif asked.kind == "stacked":
            console().print("the part detector uses it whose centre net is beside it", highlight=False)
        else:
            line = self.use.format(name=self.name, kind=asked.kind, file=told_in(asked.config, path))
            console().print(f"to use it, in {asked.config}: {line}", highlight=False)
        if asked.as_json:
            print_json(scores)
        return scores


def _beside_parts(file: Path, kind: str) -> Paths:
    """What a part detector is beside its first file."""
    beside: dict[str, Paths] = {"rcnn": (head_file(file),), "stacked": ()}
    return beside.get(kind, (pose_file(file), stacked_file(file)))


TASKS = {
    task.name: task
    for task in (
        LearnedTask(
            "hands",
            "hand tracker",
            ("slim",),
            ("data", "simulated", "begin", "budget", "epochs"),
            networks.hands,
            lambda file, _: (finder_file(file), refiner_file(file)),
            _BUDGET,
        ),
        LearnedTask(
            "actions",
            "action detector",
            TRAINABLE,
            ("kind", "data", "validation", "look", "tracker", "budget", "epochs", "share"),
            networks.actions,
            lambda file, _: (networks.confusions_of(file),),
            {"budget": "20m"},
        ),
        LearnedTask(
            "holes",
            "hole reader",
            ("plate",),
            ("data", "simulated", "budget", "epochs"),
            networks.holes,
            defaults=_BUDGET,
        ),
        LearnedTask(
            "parts",
            "part detector",
            ("centre", "rcnn", "stacked"),
            ("kind", "data", "simulated", "look", "budget", "epochs", "backbone", "share", "steps"),
            networks.parts,
            _beside_parts,
            _BUDGET,
        ),
        LearnedTask(
            "grasp",
            "grasp planner",
            ("pairwise", "paper"),
            ("kind", "data"),
            planners.grasp,
            lambda file, kind: (crops_file(file),) if kind == "paper" else (),
            use=_PLANNER,
        ),
        LearnedTask(
            "semantic",
            "semantic planner",
            ("factored", "paper"),
            ("kind", "data", "ratio", "augment"),
            planners.semantic,
            use=_PLANNER,
        ),
        LearnedTask(
            "noise",
            "confusions of the action detector",
            (),
            ("data",),
            planners.noise,
            use="planners.semantic.confusions: {file}",
            torch=False,
        ),
    )
}


def train_app() -> typer.Typer:
    """A command for each network."""
    made = typer.Typer(no_args_is_help=True, help="Train one network, with all its options.")
    for task in TASKS.values():
        common = ("out", "overwrite", "config", *(["seed"] * task.torch), "as_json")
        command = command_from(Training, *task.options, *common, **(task.defaults or {}))(partial(_train, task=task))
        kinds = f" Kinds: {', '.join(task.kinds)}." if len(task.kinds) > 1 else ""
        made.command(task.name, help=f"{task.fit.__doc__}{kinds}")(command)
    return made


def _train(asked: Training, *, task: LearnedTask) -> None:
    task.train(asked)


app = train_app()  # what `cell train` calls in a process of its own
