"""`cell lab eval holes|parts`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from typer import Option

from bracket_cell.commands.options import command_from
from bracket_cell.commands.terminal import console, print_json, report_scores, table
from bracket_ground.errors import InputError
from bracket_lab.commands.shared import Shared, share_words
from bracket_lab.evaluations.holes_and_parts import Task, score_holes, score_parts, score_tilted

_OPTIONS = ("kind", "weights", "data", "look", "seeds", "cameras", "steel", "config", "as_json")


@command_from(Shared, *_OPTIONS, seeds="900000:900020")
def evaluate_holes(shared: Shared, stills: Annotated[int, Option(min=1, help="Images of each look.")] = 10) -> None:
    """Score a hole reader on stills: any parts in the holes, hand or arm over them or not. Kinds: plate, classical."""
    kind = _kind(shared, ("plate", "classical"))
    if shared.data:
        shared.score_pictures("holes", kind, shared.data)
        return
    _, wanted = shared.split()
    task = _task(shared, kind, person="varied")
    task.detectors(task.configuration.bench, "holes").make("holes")  # before minutes go into stills
    scores = score_holes(task, wanted, stills)
    report_scores(f"holes, {kind}, {shared.look}, cameras {shared.cameras.value}", scores, shared.as_json)


@command_from(Shared, *_OPTIONS, seeds="900000:900050")
def evaluate_parts(
    shared: Shared,
    mixed: Annotated[bool, Option(help="Some parts lie or are stacked, and some objects are unknown.")] = True,
    tilt: Annotated[
        float | None, Option(min=0, max=180, help="Score parts tilted by N degrees, in the look nominal.")
    ] = None,
    page: Annotated[
        Path | None, Option(help="With --data: write an HTML page of the worst pictures, and tell the mAP's interval.")
    ] = None,
) -> None:
    """Score a part detector on images of trays. Kinds: centre, classical, rcnn; with --data also onnx."""
    kind = _kind(shared, ("centre", "classical", "rcnn", *["onnx"] * bool(shared.data)))
    if page is not None and not shared.data:
        raise InputError(f"--page {page}: goes with --data DIR, of `cell label`")
    if shared.data:
        shared.score_pictures("parts", kind, shared.data, page)
        return
    _, wanted = shared.split()
    task = _task(shared, kind)
    task.detectors(task.configuration.bench, "parts").make("parts")  # before minutes go into trays
    if tilt is not None:
        found = score_tilted(task, wanted, tilt)
        console().print(table(f"parts, {kind}, tilted by {tilt:g}", {k: share_words(v) for k, v in found.items()}))
        if shared.as_json:
            print_json(found)
        return
    scores = score_parts(task, wanted, mixed)
    report_scores(f"parts, {kind}, {shared.look}, cameras {shared.cameras.value}", scores, shared.as_json)


def _kind(shared: Shared, legal: Sequence[str]) -> str:
    """The kind of detector, if it reads the weights that are named.

    Raises:
        InputError: there is none, or it reads none.
    """
    kind = shared.one_kind(legal)
    if kind == "classical" and shared.weights is not None:
        trained = " or ".join(kind for kind in legal if kind != "classical")
        raise InputError(f"--weights {shared.weights}: nothing reads them: they go with --kind {trained}")
    return kind


def _task(shared: Shared, kind: str, person: str | None = None) -> Task:
    of_person = shared if person is None else Shared(look=shared.look, person=person, config=shared.config)
    configuration, product = of_person.cell(person=person is not None)
    return Task(configuration, product, kind, shared.weights, shared.cameras.value, float(shared.steel))
