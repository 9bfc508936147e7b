"""How the planners are trained, and what the action detector takes for what."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path

from cell.commands.training.asked import Training
from cell.errors import InputError
from cell.wiring.tray_camera import tray_camera
from learned.semantic.confusions import Confusions, confirmed_reports
from learned.semantic.graph import Layout

Scores = Mapping[str, float]


def grasp(asked: Training, weights: Path) -> Scores:
    """Train the planner that judges graspability in clutter; goes on where an interrupted training stopped."""
    from learned.grasp.data import read_scenes
    from learned.grasp.train import train_grasp

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
    from learned.semantic.train import train_semantic

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
