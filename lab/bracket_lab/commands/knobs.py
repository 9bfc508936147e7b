"""`cell lab eval knobs`: a detector against one value of the look after the other, as a table and a plot."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from bracket_cell.commands.options import takes
from bracket_cell.commands.terminal import console, print_json
from bracket_cell.configuration import Configuration
from bracket_cell.kinds import DETECTORS
from bracket_ground.errors import InputError
from bracket_ground.files.row_store import RowStore
from bracket_lab.commands.shared import Shared
from bracket_lab.evaluations import knobs as scoring
from bracket_lab.evaluations.knobs import SCORED, Sample, Scored, at, plot_knobs
from btxml.engine.literals import constant

KNOB = "--knob light.ambient=0.1,0.5"
_OPTIONS = ("look", "person", "seeds", "physics", "out", "config", "as_json")


@takes(Shared, *_OPTIONS, look="nominal", physics=True, seeds="900000:900004")
def knobs(
    shared: Shared,
    detector: Annotated[str, Argument(help="actions, hands, holes or parts.")],
    knob: Annotated[
        list[str] | None,
        Option(
            help="PLACE=VALUE,VALUE: values of the look, or of the person's pace; may be repeated; some by default."
        ),
    ] = None,
    plot: Annotated[Path | None, Option(help="Draw it into this PNG file.")] = None,
) -> int:
    """Score a detector for several values of the look, changing one at a time, with every seed.

    Interrupted, it prints the table of what was run; with the same --out it goes on there.
    """
    if detector not in SCORED:
        raise InputError(f"{detector!r} is not a detector; legal: {', '.join(SCORED)}")
    if plot is not None and not plot.parent.is_dir():
        raise InputError(f"{plot}: cannot be written: there is no folder {plot.parent}")
    scored = SCORED[detector]
    configuration, product = shared.cell()
    tried = dict(map(_values, knob)) if knob else scored.knobs
    turned = [(name, value, at(configuration, name, value)) for name, values in tried.items() for value in values]
    _, wanted = shared.split()
    told: dict[str, object] = {
        "detector": detector,
        "look": shared.look,
        "person": shared.person,
        "seeds": shared.seeds,
    }
    told |= {"physics": shared.physics}
    used = [path for task in DETECTORS for path in configuration.perception.files(task).values() if path.is_file()]
    kept = shared.rows(["knob", "value"], {"command": "knobs", **told}, scoring, *used)
    whole = _score(kept, turned, lambda cell: scored.score(Sample(cell, product, wanted, shared.physics)))
    rows = [row for row in kept.rows if row["value"] in tried.get(str(row["knob"]), ())]
    console().print(_table(rows, scored), highlight=False, soft_wrap=True)
    if plot is not None and rows:
        plot_knobs(rows, f"{scored.title} (line), {scored.beside} (dashes); look {shared.look}", plot)
    if shared.as_json:
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
