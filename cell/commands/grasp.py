"""`cell data grasp`, `cell train grasp` and `cell eval grasp`."""

from __future__ import annotations

import platform
from contextlib import AbstractContextManager, nullcontext
from datetime import date
from enum import StrEnum
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cell.commands.terminal import (
    CONFIGURATION,
    ConfigOption,
    JsonOption,
    SeedOption,
    console,
    product_of,
    report_scores,
)
from cell.commands.weights import OverwriteOption, need_torch, new_weights, shipped_weights, writing
from cell.errors import InputError
from cell.interfaces.product import Product

if TYPE_CHECKING:
    from learned.grasp.crops import TrayCamera

KEPT = Path("data") / "grasp"  # finished cells of experiments, a file for each product


class Clutter(StrEnum):
    """How close parts stand in drawn scenes."""

    DENSE = "dense"
    TRAY = "tray"


class Experiment(StrEnum):
    """Which tables `cell eval grasp --experiment` makes."""

    TABLE2 = "table2"
    TABLE3 = "table3"
    NOISE = "noise"
    PAPER = "paper"
    CURVE = "curve"
    ALL = "all"


def data(
    out: Annotated[Path, typer.Option(help="New file (JSON lines, learned/grasp/data.py).")],
    scenes: Annotated[int, typer.Option(min=1, help="Number of scenes.")] = 1000,
    clutter: Annotated[Clutter, typer.Option(help="How close parts stand.")] = Clutter.DENSE,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
) -> None:
    """Draw cluttered trays with detections, truth and labels."""
    if out.exists():
        raise InputError(f"--out {out}: is there already; name a new file")
    from rich.progress import track

    from learned.grasp.data import write_scenes
    from learned.grasp.scenes import draw_scenes
    from learned.grasp.settings import TRAY_SCENES, SceneSettings

    product = product_of(config)
    settings = TRAY_SCENES if clutter is Clutter.TRAY else SceneSettings()
    drawn = track(draw_scenes(product, seed, scenes, "train", settings), "drawing", scenes, console=console())
    source = f"cell data grasp --scenes {scenes} --clutter {clutter.value} --seed {seed}"
    try:
        count = write_scenes(out, drawn, product, source)
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror}") from error
    console().print(f"{count} scenes in {out}")


def train(
    kind: Annotated[str, typer.Option(help="paper or pairwise.")] = "pairwise",
    data: Annotated[Path | None, typer.Option(help="Scenes to learn from; drawn ones by default.")] = None,
    out: Annotated[Path | None, typer.Option(help="File to write; beside --config by default.")] = None,
    overwrite: OverwriteOption = False,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Train the planner that judges graspability in clutter; goes on where an interrupted training stopped."""
    need_torch()
    from cell.interfaces.planning import crops_file
    from learned.grasp.data import read_scenes
    from learned.grasp.train import train_grasp

    product, rendered = product_of(config), kind == "paper"
    path = new_weights("grasp", kind, config, out)
    with (
        writing(path, *[crops_file(path)] * rendered, overwrite=overwrite),
        _camera(product, config) if rendered else nullcontext() as camera,
    ):
        scores = train_grasp(
            product,
            path,
            seed,
            kind,
            scenes=None if data is None else read_scenes(data, product),
            camera=camera,
            command=f"cell train grasp --kind {kind} --seed {seed}" + ("" if data is None else f" --data {data}"),
        )
    report_scores(f"weights in {path}", scores, as_json)


def evaluate(
    kind: Annotated[str, typer.Option(help="paper, pairwise or rule.")] = "pairwise",
    weights: Annotated[Path | None, typer.Option(help="ONNX file; the shipped one by default.")] = None,
    experiment: Annotated[
        list[Experiment] | None,
        typer.Option(help="Compare all planners instead; may be repeated; finished cells are kept under data/."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="With --experiment: page to write, plots beside it.")] = None,
    config: ConfigOption = CONFIGURATION,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Of the test scenes; by default 0, and that of the pages in experiments.")
    ] = None,
    scenes: Annotated[int, typer.Option(min=4, help="Number of test scenes.")] = 1000,
    as_json: JsonOption = False,
) -> None:
    """Score the grasp planner, or run an experiment with all of them."""
    product = product_of(config)
    if experiment:
        _experiment(experiment, out, product, config, seed)
        return
    if out is not None:
        raise InputError("--out is for --experiment; scores of one planner go to the terminal, or --json")
    from cell.interfaces.planning import crops_file
    from learned.grasp.crops import load_crops
    from learned.grasp.evaluate import embedded, evaluate_grasp
    from learned.grasp.model import load_grasp_planner

    path = weights or shipped_weights("grasp", kind)
    planner = load_grasp_planner(kind, path, product)
    if kind != "paper":
        report_scores("grasp", evaluate_grasp(planner, product, seed or 0, scenes), as_json)
        return
    with _camera(product, config) as camera:
        look = partial(embedded, camera=camera, network=load_crops(crops_file(path)))
        report_scores("grasp", evaluate_grasp(planner, product, seed or 0, scenes, look=look), as_json)


def _camera(product: Product, config: Path) -> AbstractContextManager[TrayCamera]:
    from cell.configuration import load_configuration
    from cell.lab.tray_camera import tray_camera

    return tray_camera(product, load_configuration(config).bench)


def _experiment(
    experiments: list[Experiment], out: Path | None, product: Product, config: Path, seed: int | None
) -> None:
    if out is None:
        raise InputError("--experiment needs --out FILE, the page to write")
    need_torch(plots=True)
    import torch

    from learned.lab.experiments import kept, write_page
    from learned.lab.grasp_cells import TEST_SEED
    from learned.lab.grasp_page import HEAD
    from learned.lab.grasp_page import experiments as tables

    typed = " ".join(f"--experiment {experiment.value}" for experiment in experiments)
    test_seed = TEST_SEED if seed is None else seed
    facts = {
        "command": f"`cell eval grasp {typed} --seed {test_seed} --out {out}`",
        "date": date.today().isoformat(),
        "machine": f"{platform.machine()}, one thread, Python {platform.python_version()}, torch {torch.__version__}",
    }
    identity = sha256(product.model_dump_json().encode()).hexdigest()[:12]
    with _camera(product, config) as camera:
        every = tables(camera, test_seed)
        chosen = {name: some for name, some in every.items() if {Experiment.ALL, name} & {*experiments}}
        write_page(HEAD, chosen, product, kept(KEPT / f"experiments_{identity}.jsonl"), out, facts)
    console().print(f"{', '.join(chosen)} in {out}")
