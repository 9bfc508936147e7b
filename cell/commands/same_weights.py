"""`cell eval weights`: whether what was trained again has the figures of what it was trained after."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cell.commands.detectors import LookOption, TestSeedOption
from cell.commands.terminal import CONFIGURATION, ConfigOption, JsonOption, console, print_json, table
from cell.errors import InputError

if TYPE_CHECKING:
    from cell.interfaces.product import Product
    from cell.lab.weights import Comparison

SIZES_ALONE = "pairwise"  # knows no part by its name


def evaluate_weights(
    folder: Annotated[Path, typer.Argument(help="Folder of `cell train all`.")],
    against: Annotated[Path | None, typer.Option(help="Another one; the shipped weights by default.")] = None,
    look: LookOption = "varied",
    first_seed: TestSeedOption = 900_000,
    recordings: Annotated[int, typer.Option(min=1, help="Looks of the plate, trays, and assemblies.")] = 6,
    only: Annotated[
        list[str] | None, typer.Option(help="Only hands, actions, holes, parts, grasp or semantic; may be repeated.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="File that keeps what was measured: interrupted, go on.")] = None,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> None:
    """Whether trained weights have the figures of others: a verdict for each network, by the figures of its bars.

    The weights of both folders are scored on the same images, trays and orders, drawn from `--first-seed` on.
    """
    from cell.configuration import load_configuration, load_product, simulated
    from cell.files.row_store import RowStore
    from cell.interfaces.planning import weights_file
    from cell.lab.weights import NETWORKS, Sample, compared, score_weights
    from cell.settings import WEIGHTS

    legal = dict.fromkeys(name for name, _ in NETWORKS)
    if unknown := [name for name in only or () if name not in legal]:
        raise InputError(f"--only {unknown[0]}: there is no such one; legal: {', '.join(legal)}")
    for one in (folder, against):
        if one is not None and not one.is_dir():
            raise InputError(f"{one}: there is no such folder; make it with: cell train all --out {one}")
    configuration = simulated(load_configuration(config), look, "varied")
    sample = Sample(configuration, load_product(configuration, config), first_seed, recordings)
    folders = {"before": against or WEIGHTS, "now": folder}
    heading = {
        "command": "eval weights",
        "look": look,
        **sample.told,
        **{name: str(at) for name, at in folders.items()},
    }
    chosen = [one for one in NETWORKS if one[0] in (only or legal)]
    for at in folders.values():  # what is missing, or of another product, is said before anything is scored
        for network in chosen:
            _require(at / weights_file(*network), network[1], sample.product)
    rows = RowStore(out, ["name", "kind", "which"], heading)
    kept: dict[tuple[object, ...], Any] = {_named(row): row["scores"] for row in rows.rows}
    found: dict[str, Comparison] = {}
    for network in chosen:
        for which, at in folders.items():
            if (*network, which) not in kept:
                kept[*network, which] = score_weights(sample, at, *network)
                rows.add({"name": network[0], "kind": network[1], "which": which, "scores": kept[*network, which]})
        title = " ".join(network)
        found[title] = compared(kept[*network, "before"], kept[*network, "now"])
        console().print(table(f"{title}: {folders['before']} -> {folder}", found[title].rows))
    shown = {title: one.verdict for title, one in found.items()}
    console().print(table(f"again? look {look}, {recordings} recordings from {first_seed}", shown))
    if as_json:
        print_json({**heading, "networks": {title: one.told for title, one in found.items()}})


def _require(path: Path, kind: str, product: Product) -> None:
    from learned.inference.onnx_model import OnnxModel

    known = OnnxModel.card_of(path).vocabulary.get("parts", ())
    if kind != SIZES_ALONE and known != tuple(product.parts):
        has = ", ".join(product.parts)
        raise InputError(
            f"{path}: knows the parts {', '.join(known)}, and this product has {has}; compare two folders that know it "
            "(--against FOLDER)"
        )


def _named(row: dict[str, object]) -> tuple[object, ...]:
    return row["name"], row["kind"], row["which"]
