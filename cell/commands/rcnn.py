"""Faster R-CNN, the baseline of `cell train parts` and `cell eval parts`."""

from __future__ import annotations

import shlex
import tempfile
from collections.abc import Sequence
from pathlib import Path

from cell.commands.made_data import make_data
from cell.commands.terminal import console, report_scores
from cell.commands.weights import folder_for, need_torch, writable
from cell.errors import InputError
from learned.parts.settings import BACKBONES


def file_of(backbone: str, config: Path, out: Path | None) -> Path:
    """Where its weights go: beside the configuration, or where `out` says.

    Raises:
        InputError: there is no such backbone, or no weights can be written there.
    """
    if backbone not in BACKBONES:
        raise InputError(f"--backbone {backbone}: there is no such one; legal: {', '.join(BACKBONES)}")
    return writable(out or folder_for(config) / f"parts_rcnn_{backbone}.pt", ".pt")


def train(
    folders: Sequence[Path], config: Path, out: Path, backbone: str, steps: int, seed: int, command: str, as_json: bool
) -> None:
    """Train on all images of some folders; interrupted and begun again, it goes on from its checkpoint."""
    from cell.commands.terminal import product_of
    from learned.parts.data import load_scenes
    from learned.parts.rcnn import RcnnTraining, train_rcnn, write_rcnn

    product, settings = product_of(config), RcnnTraining(backbone, steps)
    scenes = load_scenes(folders, product)
    checkpoint = out.with_name(f"{out.name}.checkpoint")
    network = train_rcnn(scenes, product, seed, settings, checkpoint=checkpoint, quiet=False)
    facts = write_rcnn(network, out, product, scenes, settings, seed, command)
    report_scores(f"Faster R-CNN, {backbone}, in {out}", facts, as_json)
    console().print(shlex.join(["cell", "eval", "parts", "--kind", "rcnn", "--weights", str(out)]), highlight=False)


def evaluate(
    look: str, first_seed: int, recordings: int, weights: Path | None, mixed: bool, steel: bool, config: Path
) -> dict[str, float]:
    """Scores of its boxes on the trays that other detectors are scored on.

    Raises:
        InputError: no weights are named, as none are shipped.
    """
    need_torch()
    if weights is None:
        raise InputError("--kind rcnn needs --weights FILE; none are shipped (cell train parts --kind rcnn)")
    from cell.commands.terminal import product_of
    from learned.parts.data import load_scenes
    from learned.parts.rcnn import load_rcnn, score_rcnn

    product = product_of(config)
    network = load_rcnn(weights, product)
    options = {
        "--look": look,
        "--recordings": recordings,
        "--first-seed": first_seed,
        "--steel-share": float(steel),
        "--config": config,
    }
    with tempfile.TemporaryDirectory(prefix="cell-eval-") as name:
        make_data("objects", Path(name) / "objects", options, *(["--mixed"] if mixed else []))
        scenes = load_scenes([Path(name) / "objects"], product)
    return score_rcnn(network, scenes, product)
