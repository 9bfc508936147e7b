"""`cell eval knobs`: a detector against one value of the look after the other, as a table and a plot."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cell.commands.detectors import LookOption, PersonOption, TestSeedOption
from cell.commands.terminal import CONFIGURATION, ConfigOption, JsonOption, RowsOption, console, print_json
from cell.errors import InputError

if TYPE_CHECKING:
    from cell.configuration import Configuration
    from cell.files.row_store import RowStore
    from cell.lab.knobs import Scored

KNOB = "--knob light.ambient=0.1,0.5"


def knobs(
    detector: Annotated[str, typer.Argument(help="actions, hands, holes or parts.")],
    knob: Annotated[
        list[str] | None,
        typer.Option(help="PLACE=VALUE,VALUE: of the look, or the person's pace; may be repeated. Some by default."),
    ] = None,
    look: LookOption = "nominal",
    person: PersonOption = "varied",
    recordings: Annotated[int, typer.Option(min=1, help="Seeds for each value.")] = 4,
    first_seed: TestSeedOption = 900_000,
    physics: Annotated[
        bool, typer.Option(help="Move hands by physics, blurred and slipping, or, eight times as fast, by rule.")
    ] = True,
    out: RowsOption = None,
    plot: Annotated[Path | None, typer.Option(help="Draw it into this PNG file.")] = None,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> int:
    """Score a detector while one knob is turned and the rest of the look stays as it is.

    Interrupted, it prints the table of what was run; with the same --out it goes on there.
    """
    from cell.configuration import load_configuration, load_product, simulated
    from cell.files.row_store import RowStore
    from cell.lab.knobs import SCORED, Sample, at
    from sim.data.splits import seeds

    if detector not in SCORED:
        raise InputError(f"{detector!r} is no detector; legal: {', '.join(SCORED)}")
    if plot is not None and not plot.parent.is_dir():
        raise InputError(f"{plot}: cannot be written: there is no folder {plot.parent}")
    scored = SCORED[detector]
    configuration = simulated(load_configuration(config), look, person)
    product = load_product(configuration, config)
    tried = dict(map(_values, knob)) if knob else scored.knobs
    turned = [(name, value, at(configuration, name, value)) for name, values in tried.items() for value in values]
    _, wanted = seeds(first_seed, recordings)
    told = {
        "detector": detector,
        "look": look,
        "person": person,
        "recordings": recordings,
        "first_seed": first_seed,
        "physics": physics,
    }
    kept = RowStore(out, ["knob", "value"], {"command": "knobs", **told})
    whole = _score(kept, turned, lambda cell: scored.score(Sample(cell, product, wanted, physics)))
    rows = [row for row in kept.rows if row["value"] in tried.get(str(row["knob"]), ())]
    console().print(_table(rows, scored), highlight=False, soft_wrap=True)
    if plot is not None and rows:
        from cell.lab.knobs import plot_knobs

        plot_knobs(rows, f"{scored.title} (line), {scored.beside} (dashes); look {look}", plot)
    if as_json:
        print_json({**told, "share": scored.title, "beside": scored.beside, "rows": rows})
    return 0 if whole else 1


def _score(
    kept: RowStore, turned: Sequence[tuple[str, Any, Configuration]], score: Callable[[Configuration], dict[str, Any]]
) -> bool:
    """Add a row for each value that has none yet; returns False where somebody interrupts."""
    try:
        for name, value, cell in turned:
            if (name, value) not in kept:
                kept.add({"knob": name, "value": value, **score(cell)})
    except KeyboardInterrupt:
        console().print(f"interrupted: {len(kept.rows)} of {len(turned)} values are done")
        return False
    return True


def _values(text: str) -> tuple[str, tuple[Any, ...]]:
    """A knob and the values to try."""
    from trees.engine.literals import constant

    name, sign, values = text.partition("=")
    if not (name and sign and values):
        raise InputError(f"--knob {text}: a knob and its values, as in {KNOB}")
    return name, tuple(constant(value) for value in values.split(","))


def _table(rows: Iterable[Mapping[str, Any]], scored: Scored) -> str:
    lines = [f"| knob | value | {scored.title} | {scored.beside} |", "|---|---|---|---|"]
    for row in rows:
        share = f"{row['share']:.3f} of {row['n']} ({row['low']:.3f} - {row['high']:.3f})"
        beside = "" if row["beside"] is None else f"{row['beside']:.3g}"
        lines.append(f"| {row['knob']} | {row['value']} | {share} | {beside} |")
    return "\n".join(lines)
