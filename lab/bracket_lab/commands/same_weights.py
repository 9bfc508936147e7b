"""`cell lab eval weights`: whether what was trained again has the figures of what it was trained after."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from bracket_cell.commands.options import takes
from bracket_cell.commands.terminal import console, print_json, table
from bracket_cell.kinds import WEIGHTS
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_ground.errors import InputError
from bracket_ground.files.row_store import RowStore
from bracket_ground.interfaces.planning import weights_file
from bracket_ground.interfaces.product import Product
from bracket_lab.commands.shared import Shared
from bracket_lab.evaluations import weights as scoring
from bracket_lab.evaluations.weights import NETWORKS, Comparison, compared

SIZES_ALONE = "pairwise"  # knows no part by its name


@takes(Shared, "look", "seeds", "only", "out", "config", "as_json", seeds="900000:900006")
def evaluate_weights(
    shared: Shared,
    folder: Annotated[Path, Argument(help="Folder of `cell train --all`.")],
    against: Annotated[Path | None, Option(help="Folder to compare with; the shipped weights by default.")] = None,
) -> None:
    """Compare trained weights with others: a verdict for each network, by the figures of its bars.

    The weights of both folders are scored on the same images, trays and orders, drawn from the seeds. --only: hands,
    actions, holes, parts, grasp, semantic.
    """
    legal = list(dict.fromkeys(name for name, _ in NETWORKS))
    shared.refuse_only(legal)
    for one in (folder, against):
        if one is not None and not one.is_dir():
            raise InputError(f"{one}: there is no such folder; make it with: cell train --all --out {one}")
    configuration, product = shared.cell()
    sample = scoring.Sample(configuration, product, shared.numbers.start, len(shared.numbers))
    folders = {"before": against or WEIGHTS, "now": folder}
    named = {name: str(at) for name, at in folders.items()}
    heading = {"command": "eval weights", "look": shared.look, **sample.told, **named}
    chosen = [one for one in NETWORKS if one[0] in (shared.only or legal)]
    for at in folders.values():  # what is missing, or of another product, is said before anything is scored
        for network in chosen:
            _require(at / weights_file(*network), network[1], sample.product)
    rows = RowStore(shared.out, ["name", "kind", "which"], heading)
    kept: dict[tuple[object, ...], Any] = {_named(row): row["scores"] for row in rows.rows}
    found: dict[str, Comparison] = {}
    for network in chosen:
        for which, at in folders.items():
            if (*network, which) not in kept:
                kept[*network, which] = scoring.score_weights(sample, at, *network)
                rows.add({"name": network[0], "kind": network[1], "which": which, "scores": kept[*network, which]})
        title = " ".join(network)
        found[title] = compared(kept[*network, "before"], kept[*network, "now"])
        console().print(table(f"{title}: {folders['before']} -> {folder}", found[title].rows))
    shown = {title: one.verdict for title, one in found.items()}
    console().print(table(f"again? look {shared.look}, seeds {shared.seeds}", shown))
    if shared.as_json:
        print_json({**heading, "networks": {title: one.told for title, one in found.items()}})


def _require(path: Path, kind: str, product: Product) -> None:
    known = OnnxModel.card_of(path).vocabulary.get("parts", ())
    if kind != SIZES_ALONE and known != tuple(product.parts):
        has = ", ".join(product.parts)
        raise InputError(
            f"{path}: knows the parts {', '.join(known)}, and this product has {has}; compare two folders that know it "
            "(--against FOLDER)"
        )


def _named(row: dict[str, object]) -> tuple[object, ...]:
    return row["name"], row["kind"], row["which"]
