"""`cell train holes|parts` and `cell eval holes|parts|cameras`."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cell.commands import rcnn
from cell.commands.detectors import (
    BudgetOption,
    DataOption,
    LookOption,
    OutOption,
    TestSeedOption,
    WeightsOption,
    how_to_use,
)
from cell.commands.made_data import make_data, require_usable
from cell.commands.terminal import (
    CONFIGURATION,
    ConfigOption,
    JsonOption,
    SeedOption,
    report_scores,
)
from cell.commands.weights import OverwriteOption, need_torch, new_weights, writing
from cell.errors import InputError

if TYPE_CHECKING:
    from cell.lab.holes_and_parts import Task

STILLS, VIEWS = 14, 3  # images of a look of the plate, and of a tray
LOOK_S, TRAY_S = 1.4, 0.45  # of processor time, to make these
HOLES_SHARE, PARTS_SHARE = 0.42, 0.4  # of the budget, for the data
STILL_S, IMAGE_S, THING_S = 0.005, 0.018, 0.0021  # to learn from one once
LOOKS = {"wide": (0.55, 0), "varied": (0.3, 300_000), "nominal": (0.15, 500_000)}  # share of the data, and first seed
STEEL_SHARE = 0.25  # of looks
ASTRAY_SHARE, LYING_SHARE = 0.4, 0.35  # of parts on the plate and in the tray, far more than are met with


class Cameras(StrEnum):
    """Which cameras detectors believe in."""

    calibrated = "calibrated"
    believed = "believed"
    true = "true"


EpochsOption = Annotated[int | None, typer.Option(min=1, help="How often each image is seen; by the budget else.")]
CamerasOption = Annotated[
    Cameras, typer.Option(help="Mounts and lenses that are believed: calibrated in each look, of the bench file, true.")
]
SteelOption = Annotated[bool, typer.Option("--steel", help="All parts are of bare steel.")]


def train_holes(
    out: OutOption = None,
    data: DataOption = None,
    budget: BudgetOption = "30m",
    epochs: EpochsOption = None,
    overwrite: OverwriteOption = False,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Train the hole reader on stills of the plate, and calibrate what it says."""
    from cell.commands.budget import seconds
    from cell.configuration import load_configuration, load_product

    need_torch()
    budget_s, weights = seconds(budget), new_weights("holes", "plate", config, out)
    with writing(weights, overwrite=overwrite):
        looks = max(4, int(HOLES_SHARE * budget_s / LOOK_S))
        drawn = {"--stills": STILLS, "--person": "varied", "--astray-share": ASTRAY_SHARE}
        folders = data or _made("plates", looks, drawn, weights, config)
        from learned.holes.data import load_plates
        from learned.holes.settings import HoleTraining
        from learned.holes.train import train_holes as train

        plates = load_plates(folders)
        by_budget = int((1 - HOLES_SHARE) * budget_s / (STILL_S * len(plates)))
        settings = HoleTraining(epochs=epochs or min(30, max(2, by_budget)))
        configuration = load_configuration(config)
        product = load_product(configuration, config)
        command = _command("holes", budget, settings.epochs, seed, data or ())
        scores = train(plates, configuration.bench, product, weights, seed, settings, command=command, quiet=False)
        report_scores(f"hole reader in {weights}", scores, as_json)
        how_to_use("holes", "plate", weights, config)


def train_parts(
    kind: Annotated[str, typer.Option(help="centre, or rcnn for Faster R-CNN, a baseline of detection.")] = "centre",
    out: OutOption = None,
    data: DataOption = None,
    budget: BudgetOption = "30m",
    epochs: EpochsOption = None,
    backbone: Annotated[str, typer.Option(help="Of rcnn: resnet101, resnet50, resnet18 or mobilenet.")] = "resnet101",
    steps: Annotated[int, typer.Option(min=1, help="Of rcnn, each of 4 images.")] = 2000,
    overwrite: OverwriteOption = False,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Train the part detector's two networks on images of trays; goes on where a training stopped."""
    from cell.commands.budget import seconds
    from learned.parts.model import pose_file

    need_torch()
    if kind not in ("centre", "rcnn"):
        raise InputError(f"--kind {kind}: there is no such one; legal: centre, rcnn")
    weights = new_weights("parts", kind, config, out) if kind == "centre" else rcnn.file_of(backbone, config, out)
    trays = max(4, int(PARTS_SHARE * seconds(budget) / TRAY_S))
    drawn: dict[str, object] = {"--views": VIEWS, "--lying-share": LYING_SHARE}
    with writing(weights, *[pose_file(weights)] * (kind == "centre"), overwrite=overwrite):
        folders = data or _made("objects", trays, drawn, weights, config, "--mixed")
        if kind == "rcnn":
            more = ["--kind", kind, "--backbone", backbone, "--steps", str(steps)]
            command = _command("parts", budget, None, seed, data or (), *more)
            rcnn.train(folders, config, weights, backbone, steps, seed, command, as_json)
            return
        scores = _train_centre(folders, data or (), weights, budget, epochs, config, seed)
        report_scores(f"part detector in {weights}", scores, as_json)
        how_to_use("parts", "centre", weights, config)


def _train_centre(
    folders: Sequence[Path],
    given: Sequence[Path],
    weights: Path,
    budget: str,
    epochs: int | None,
    config: Path,
    seed: int,
) -> dict[str, float]:
    """Train both networks; of the folders to learn from, some or none were given."""
    from cell.commands.budget import seconds
    from cell.configuration import load_configuration, load_product
    from learned.parts.data import load_scenes
    from learned.parts.train import train_parts as train

    configuration = load_configuration(config)
    product = load_product(configuration, config)
    scenes = load_scenes(folders, product)
    things = sum(len(scene.labels) for scene in scenes)
    an_epoch_s = IMAGE_S * len(scenes) + THING_S * things
    times = epochs or min(20, max(1, int((1 - PARTS_SHARE) * seconds(budget) / an_epoch_s)))
    command = _command("parts", budget, times, seed, given)
    floor_m = configuration.bench.tray.centre_m[2]
    return train(scenes, product, floor_m, weights, seed, epochs=times, command=command, quiet=False)


def evaluate_holes(
    look: LookOption = "varied",
    first_seed: TestSeedOption = 900_000,
    recordings: Annotated[int, typer.Option(min=1, help="How many looks.")] = 20,
    stills: Annotated[int, typer.Option(min=1, help="Images of each look.")] = 10,
    kind: Annotated[str, typer.Option(help="plate or classical.")] = "plate",
    weights: WeightsOption = None,
    cameras: CamerasOption = Cameras.calibrated,
    steel: SteelOption = False,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> None:
    """Score a hole reader on stills: any parts in the holes, hand or arm over them or not."""
    from cell.lab.holes_and_parts import score_holes
    from sim.data.splits import seeds

    _require_possible(kind, ("plate",), weights)
    _, wanted = seeds(first_seed, recordings)
    task = _task(look, kind, weights, cameras, steel, config, "varied")
    task.detectors(task.configuration.bench, "holes").make("holes")  # before minutes go into stills
    scores = score_holes(task, wanted, stills)
    report_scores(f"holes, {kind}, {look}, cameras {cameras.value}", scores, as_json)


def evaluate_parts(
    look: LookOption = "varied",
    first_seed: TestSeedOption = 900_000,
    recordings: Annotated[int, typer.Option(min=1, help="How many trays.")] = 50,
    kind: Annotated[str, typer.Option(help="centre, classical, or rcnn (boxes alone, --weights needed).")] = "centre",
    mixed: Annotated[bool, typer.Option(help="Some parts lie or are stacked, some objects are unknown.")] = True,
    weights: WeightsOption = None,
    cameras: CamerasOption = Cameras.calibrated,
    steel: SteelOption = False,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> None:
    """Score a part detector on images of trays."""
    from sim.data.splits import seeds

    _require_possible(kind, ("centre", "rcnn"), weights)
    _, wanted = seeds(first_seed, recordings)
    if kind == "rcnn":
        scores = rcnn.evaluate(look, first_seed, recordings, weights, mixed, steel, config)
        report_scores(f"parts, {kind}, {look}", scores, as_json)
        return
    from cell.lab.holes_and_parts import score_parts

    task = _task(look, kind, weights, cameras, steel, config)
    task.detectors(task.configuration.bench, "parts").make("parts")  # before minutes go into trays
    scores = score_parts(task, wanted, mixed)
    report_scores(f"parts, {kind}, {look}, cameras {cameras.value}", scores, as_json)


def evaluate_cameras(
    look: LookOption = "varied",
    first_seed: TestSeedOption = 900_000,
    recordings: Annotated[int, typer.Option(min=1, help="How many looks, each with mounts of its own.")] = 20,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> None:
    """Score calibration: how far the cameras see holes, and points in the tray, off before and after it."""
    from cell.lab.holes_and_parts import score_calibration
    from sim.data.splits import seeds

    _, wanted = seeds(first_seed, recordings)
    scores = score_calibration(_task(look, "", None, Cameras.calibrated, False, config), wanted)
    report_scores(f"cameras, {look}", scores, as_json)


def _require_possible(kind: str, trained: Sequence[str], weights: Path | None) -> None:
    """Check that there is a kind of detector, and that it reads the weights that are named.

    Raises:
        InputError: there is none, or it reads none.
    """
    legal = ("classical", *trained)
    if kind not in legal:
        raise InputError(f"--kind {kind}: there is no such one; legal: {', '.join(legal)}")
    if kind == "classical" and weights is not None:
        raise InputError(f"--weights {weights}: nothing reads them: they go with --kind {' or '.join(trained)}")


def _task(
    look: str, kind: str, weights: Path | None, cameras: Cameras, steel: bool, config: Path, person: str | None = None
) -> Task:
    from cell.configuration import load_configuration, load_product, simulated
    from cell.lab.holes_and_parts import Task

    configuration = simulated(load_configuration(config), look, person)
    product = load_product(configuration, config)
    return Task(configuration, product, kind, weights, cameras.value, float(steel))


def _command(what: str, budget: str, epochs: int | None, seed: int, data: Sequence[Path], *more: str) -> str:
    """What makes the same weights again."""
    given = [word for folder in data for word in ("--data", str(folder))]
    times = [] if epochs is None else ["--epochs", str(epochs)]
    return shlex.join(["cell", "train", what, "--budget", budget, *times, "--seed", str(seed), *given, *more])


def _made(what: str, count: int, options: dict[str, object], weights: Path, config: Path, *flags: str) -> list[Path]:
    """Folders of data, one for each look."""
    folders = [weights.with_suffix(f".{what}-{look}") for look in LOOKS]
    require_usable(*folders)
    for folder, (look, (share, first_seed)) in zip(folders, LOOKS.items(), strict=True):
        recordings = max(1, round(share * count))
        of_look = {"--look": look, "--recordings": recordings, "--first-seed": first_seed}
        make_data(what, folder, {**of_look, **options, "--steel-share": STEEL_SHARE, "--config": config}, *flags)
    return folders
