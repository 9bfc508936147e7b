"""`cell train hands` and `cell eval hands`: the small tracker, against the simulator's truth, and MediaPipe's."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cell.commands.detectors import how_to_use
from cell.commands.terminal import (
    CONFIGURATION,
    ConfigOption,
    JsonOption,
    SeedOption,
    console,
    print_json,
    report_scores,
    table,
)
from cell.commands.things import Cameras, CamerasOption
from cell.commands.weights import OverwriteOption, need_torch, new_weights, writing
from cell.errors import InputError, ModelError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from cell.configuration import Configuration
    from cell.interfaces.bench import Bench
    from cell.interfaces.perception import HandTracker
    from cell.interfaces.product import Product

FIRST_VALIDATION_SEED = 800_000
DATA_S, EPOCH_S = 1.02, 0.556  # of processor time: to make a recording's frames, and to train on them once
LOOKS = {"people": (0.55, 0), "varied": (0.28, 300_000), "nominal": (0.17, 500_000)}  # share of data, first seed
VALIDATION_SHARE = 0.04


def train(
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File of weights; finder and refiner go beside it.")
    ] = None,
    data: Annotated[
        list[Path] | None,
        typer.Option(help="Folder of `cell data hands`; may be repeated. By default made anew, of several looks."),
    ] = None,
    budget: Annotated[str, typer.Option(help="Processor time for data and training, as in 90s, 30m or 2h.")] = "30m",
    epochs: Annotated[int, typer.Option(min=1, help="How often each frame is seen.")] = 9,
    overwrite: OverwriteOption = False,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Train the small hand tracker on simulated frames, and score it on frames that it never saw."""
    from cell.commands.budget import seconds
    from cell.configuration import load_configuration, load_product
    from learned.hands.data import rows_of
    from learned.hands.model import finder_file, refiner_file

    need_torch()
    recordings = max(4, int(seconds(budget) / (DATA_S + EPOCH_S * epochs)))
    configuration = load_configuration(config)
    product = load_product(configuration, config)
    weights = new_weights("hands", "slim", config, out)
    with writing(weights, finder_file(weights), refiner_file(weights), overwrite=overwrite):
        for folder in data or ():
            rows_of(folder)  # a wrong one is told before minutes go into frames for the scores
        folders, validation = _made(recordings, weights, config, data)
        from learned.hands.evaluate import score_readings
        from learned.hands.model import SlimReader
        from learned.hands.train import train_hands

        setup, types = configuration.bench.overhead, tuple(product.parts)
        scores = train_hands(
            folders,
            setup,
            product,
            weights,
            seed,
            score=lambda: score_readings(SlimReader(setup, types, weights), configuration.bench, validation),
            epochs=epochs,
            command=_command(budget, epochs, seed, data or ()),
        )
    report_scores(f"hand tracker in {weights}", scores, as_json=False)
    how_to_use("hands", "slim", weights, config)
    if as_json:
        print_json(scores)


def _made(recordings: int, weights: Path, config: Path, given: Sequence[Path] | None) -> tuple[Sequence[Path], Path]:
    """Folders of data to learn from, one for each look unless some are given, and one for the scores."""
    from cell.commands.made_data import make_data, require_usable

    validation = weights.with_suffix(".validation")
    folders = {} if given else {look: weights.with_suffix(f".{look}") for look in LOOKS}
    require_usable(validation, *folders.values())
    apart = {"--recordings": max(2, int(VALIDATION_SHARE * recordings)), "--first-seed": FIRST_VALIDATION_SEED}
    make_data("hands", validation, {"--look": "varied", **apart, "--config": config})
    for look, folder in folders.items():
        share, first_seed = LOOKS[look]
        of_look = {"--look": look, "--recordings": max(1, round(share * recordings)), "--first-seed": first_seed}
        make_data("hands", folder, {**of_look, "--config": config})
    return given or list(folders.values()), validation


def _command(budget: str, epochs: int, seed: int, data: Sequence[Path]) -> str:
    """What makes the same weights again."""
    given = [word for folder in data for word in ("--data", str(folder))]
    return shlex.join(
        ["cell", "train", "hands", "--budget", budget, "--epochs", str(epochs), "--seed", str(seed), *given]
    )


def evaluate(
    look: Annotated[str, typer.Option(help="What recordings look like: nominal, varied, hard, or a file.")] = "varied",
    first_seed: Annotated[int, typer.Option(min=0, help="Of seeds in a row; tests begin at 900000.")] = 900_000,
    recordings: Annotated[int, typer.Option(min=1, help="How many assemblies.")] = 10,
    stretches: Annotated[
        int | None,
        typer.Option(min=1, help="Only so many of 24 frames in a row, in each assembly; by default all its frames."),
    ] = None,
    kinds: Annotated[
        str, typer.Option(help="Which trackers, with commas between: slim, classical, mediapipe.")
    ] = "slim",
    only: Annotated[
        str, typer.Option(help="Which persons: all, or the same ones bare-right, left, second or gloves.")
    ] = "all",
    person: Annotated[str, typer.Option(help="Who assembles: a person's name or file.")] = "varied",
    physics: Annotated[
        bool, typer.Option(help="Move hand and parts by physics, or, eight times as fast, by rule.")
    ] = True,
    cameras: CamerasOption = Cameras.calibrated,
    weights: Annotated[Path | None, typer.Option(help="Weights of `slim`; the configured ones by default.")] = None,
    photos: Annotated[
        Path | None, typer.Option(help="Folder of photographs: score MediaPipe's networks on them.")
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(help=r"JSON for --photos: file in the folder -> hands, each 21 x \[x_px, y_px].")
    ] = None,
    size: Annotated[str, typer.Option(help="Of --photos, which of MediaPipe's networks: full or lite.")] = "full",
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> None:
    """Score hand trackers on simulated assemblies, or MediaPipe's networks on photographs."""
    if photos is not None or truth is not None:
        _photographs(photos, truth, size, as_json)
        return
    from cell.configuration import load_configuration, load_product, simulated
    from cell.lab.hands import ONLY, evaluate_hands
    from sim.data.splits import seeds

    if only not in ONLY:
        raise InputError(f"--only {only}: there is no such choice; legal: {', '.join(ONLY)}")
    chosen = [kind.strip() for kind in kinds.split(",")]
    if weights is not None and "slim" not in chosen:
        raise InputError(f"--weights {weights}: nothing reads them: they are those of --kinds slim, not {kinds}")
    configuration = simulated(load_configuration(config), look, person)
    product = load_product(configuration, config)
    _, wanted = seeds(first_seed, recordings)
    makers: dict[str, Callable[[Bench], HandTracker]] = {
        kind: _maker(configuration, product, kind, weights) for kind in chosen
    }
    found = evaluate_hands(
        configuration, product, makers, wanted, stretches=stretches, physics=physics, only=only, cameras=cameras.value
    )
    for name, one in found.items():
        console().print(table(f"{name}, {look}, {only}, cameras {cameras.value}", _rows(one)))
    if as_json:
        told = {"look": look, "only": only, "cameras": cameras.value, "first_seed": first_seed, "physics": physics}
        print_json({**told, "trackers": found})


def _maker(
    configuration: Configuration, product: Product, kind: str, weights: Path | None
) -> Callable[[Bench], HandTracker]:
    """Makes trackers of a kind, for a bench.

    A run takes weights of another product, and what is held has no type; a score of that would mislead.

    Raises:
        SettingError: there is no such kind, or its weights cannot be used.
        ModelError: its weights were trained for other parts.
    """
    from cell.wiring.detectors import Detectors
    from learned.inference.onnx_model import OnnxModel

    perception = configuration.perception.with_detector("hands", kind, weights if kind == "slim" else None)
    Detectors(configuration.bench, product, perception).make("hands")  # before minutes go into recordings
    if kind == "slim":
        path = perception.weights("hands")
        OnnxModel.card_of(path).require_vocabulary(path, {"parts": tuple(product.parts)})

    def make(bench: Bench) -> HandTracker:
        tracker: HandTracker = Detectors(bench, product, perception).make("hands")
        return tracker

    return make


def _rows(scores: dict[str, object]) -> dict[str, object]:
    """Figures with their intervals, for reading."""
    hidden = ("_low", "_high", "_n")
    return {
        name: f"{value} ({scores[f'{name}_low']} to {scores[f'{name}_high']})" if f"{name}_low" in scores else value
        for name, value in scores.items()
        if not name.endswith(hidden)
    }


def _photographs(photos: Path | None, truth: Path | None, size: str, as_json: bool) -> None:
    if photos is None or truth is None:
        raise InputError("--photos DIR and --truth FILE belong together")
    from learned.hands.mediapipe.hands import FETCH, SIZES, MediaPipeHands, model_folder
    from learned.lab.photographs import compare_photographs, load_truth

    if size not in SIZES:
        raise InputError(f"--size {size}: there is no such size; legal: {', '.join(SIZES)}")
    given = load_truth(truth, photos)
    try:
        networks = MediaPipeHands(model_folder(), "full" if size == "full" else "lite")
    except ModelError as error:
        raise ModelError(f"MediaPipe's networks are not shipped; fetch them once with: {FETCH} ({error})") from None
    scores = compare_photographs(networks, photos, given)
    console().print(table(f"MediaPipe's networks, {size}, on {photos}", scores))
    if as_json:
        print_json(scores)


hands_app = typer.Typer(no_args_is_help=True, help="MediaPipe's hand networks, which are not shipped.")


@hands_app.command()
def fetch(
    wheel: Annotated[Path | None, typer.Option(help="A wheel of mediapipe that is here already.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Fetch MediaPipe's hand networks with pip, and keep them as ONNX in the user's cache, with their licence."""
    from learned.hands.mediapipe.fetch import fetch as fetch_networks
    from learned.hands.mediapipe.hands import model_folder

    folder = model_folder()
    files = fetch_networks(folder, wheel)
    sizes = {file.name: f"{file.stat().st_size / 1e6:.1f} MB" for file in files}
    console().print(table(f"{folder} (Apache License 2.0, see LICENSE there)", sizes))
    if as_json:
        print_json({"folder": str(folder), "files": [file.name for file in files]})
