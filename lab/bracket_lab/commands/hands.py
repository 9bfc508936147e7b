"""`cell lab eval hands` and `cell lab hands`: hand trackers against the simulator's truth, and MediaPipe's networks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from bracket_cell.commands.options import CONFIGURATION, ConfigOption, JsonOption, SeedOption, command_from
from bracket_cell.commands.terminal import console, print_json, table
from bracket_cell.configuration import Configuration, load_configuration, load_product
from bracket_cell.learned.hands.mediapipe.hands import MediaPipeHands, model_folder
from bracket_cell.learned.hands.model import SlimReader
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_cell.wiring.detectors import Detectors
from bracket_ground.errors import InputError
from bracket_ground.files.data_folder import DataFolder
from bracket_ground.files.files import whole_folder
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.perception import HandTracker
from bracket_ground.interfaces.product import Product
from bracket_lab.commands.shared import Shared
from bracket_lab.evaluations.hands import ONLY, evaluate_hands
from bracket_lab.experiments.mediapipe_fetch import fetch as fetch_networks
from bracket_lab.learned.hands.data import frames_of
from bracket_lab.pictures.handless import Compositor, write_handless
from bracket_lab.pictures.origins import WITHOUT_HANDS, by_source, photographs_of
from bracket_lab.pictures.photographs import write_photographs

_OPTIONS = ("kind", "weights", "data", "look", "person", "seeds", "physics", "only", "cameras", "config", "as_json")


def compose(
    out: Annotated[Path, Option("--out", "-o", help="New folder.")],
    photographs: Annotated[Path | None, Argument(help="Folder of photographs of hands.")] = None,
    without: Annotated[
        list[Path] | None, Option(help="Folder of photographs without hands, as negatives; may be repeated.")
    ] = None,
    onto: Annotated[
        list[Path] | None,
        Option(help="Frames of the bench, of `cell lab data hands` or `cell label`; may be repeated."),
    ] = None,
    copies: Annotated[int, Option(min=1, help="Images of each hand, and of each photograph without.")] = 2,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Real hands on the bench: found in photographs by MediaPipe, cut out, and laid onto frames.

    With --without, photographs that show no hand, too: whole, and pieces of them on frames. Each folder in a FOLDER is
    a source; its licence is what FOLDER/REUSE.toml says.
    """
    configuration = load_configuration(config)
    setup = configuration.bench.overhead
    files = [] if photographs is None else photographs_of(photographs)
    empty = [photograph for folder in without or () for photograph in photographs_of(folder, WITHOUT_HANDS)]
    if not files and not empty:
        raise InputError("photographs: none are given; legal are a folder of hands, --without FOLDER, or both")
    frames = [frame for folder in onto or () for frame in frames_of(folder)]
    hands = MediaPipeHands(model_folder(), "full")
    with whole_folder(out) as partial:
        given = [*([] if photographs is None else [str(photographs)]), *(f"--without {path}" for path in without or ())]
        folder = DataFolder(partial, " ".join(["cell lab data photographs", *given]))
        compositor = Compositor(hands, setup, folder, frames, copies, seed)
        used = write_photographs(files, compositor)
        if files and not used:
            raise InputError(f"{photographs}: MediaPipe finds no hand in {len(files)} photographs")
        fields: dict[str, object] = {"photographs": len(files), "with hands": len(used)}
        if empty:
            weights = configuration.perception.with_detector("hands", "slim", None).weights("hands")
            tracker = SlimReader(setup, tuple(load_product(configuration).parts), weights)
            plain = write_handless(empty, tracker, compositor)
            left_out = len(empty) - len(plain)
            fields |= {"without hands": len(plain), "left out, as MediaPipe sees a hand": left_out}
            used += plain
        fields["sources"] = by_source((each.source, each.licence) for each in used)
        fields["images"] = folder.counts["hands"]
        folder.close({name.replace(" ", "_"): count for name, count in fields.items()})
    if as_json:
        print_json(fields)
    else:
        console().print(table(str(out), fields))


@command_from(Shared, *_OPTIONS, physics=True)
def evaluate(
    shared: Shared,
    stretches: Annotated[
        int | None, Option(min=1, help="Number of 24-frame clips per assembly; all frames by default.")
    ] = None,
) -> None:
    """Score hand trackers on simulated assemblies, or with --data on labelled pictures.

    Kinds: slim, both, mediapipe, classical. --only, of the persons: bare-right, left, second or gloves.
    """
    if shared.data:
        shared.score_pictures("hands", shared.one_kind(("slim", "both", "classical", "mediapipe")), shared.data)
        return
    shared.refuse_only(tuple(ONLY))
    persons = (shared.only or ["all"])[0]
    chosen = shared.kind or ["slim"]
    if shared.weights is not None and "slim" not in chosen:
        raise InputError(f"--weights {shared.weights}: nothing reads them: they go with --kind slim")
    configuration, product = shared.cell()
    _, wanted = shared.split()
    makers = {kind: _maker(configuration, product, kind, shared.weights) for kind in chosen}
    found = evaluate_hands(
        configuration,
        product,
        makers,
        wanted,
        stretches=stretches,
        physics=shared.physics,
        only=persons,
        cameras=shared.cameras.value,
    )
    cameras = shared.cameras.value
    for name, figure in found.items():
        console().print(table(f"{name}, {shared.look}, {persons}, cameras {cameras}", _rows(figure)))
    if shared.as_json:
        fields = {"look": shared.look, "only": persons, "cameras": cameras, "seeds": shared.seeds}
        print_json({**fields, "physics": shared.physics, "trackers": found})


def _maker(
    configuration: Configuration, product: Product, kind: str, weights: Path | None
) -> Callable[[Bench], HandTracker]:
    """Makes trackers of a kind, for a bench.

    A run takes weights of another product, and what is held has no type; a score of that would mislead.

    Raises:
        SettingError: there is no such kind, or its weights cannot be used.
        ModelError: its weights were trained for other parts.
    """
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


def fetch(
    wheel: Annotated[Path | None, Option(help="A wheel of mediapipe that you have already.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Fetch MediaPipe's hand networks with pip, and keep them as ONNX in the user's cache, with their licence."""
    folder = model_folder()
    files = fetch_networks(folder, wheel)
    sizes = {file.name: f"{file.stat().st_size / 1e6:.1f} MB" for file in files}
    console().print(table(f"{folder} (Apache License 2.0, see LICENSE there)", sizes))
    if as_json:
        print_json({"folder": str(folder), "files": [file.name for file in files]})
