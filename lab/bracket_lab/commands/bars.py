"""`cell lab eval bars`: what every shipped network reaches today, beside what it is to reach."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, JsonValue, model_validator
from rich.table import Table
from typer import Option

from bracket_cell.commands.options import JsonOption
from bracket_cell.commands.terminal import BESIDE, console, print_json
from bracket_cell.configuration import DEFAULT_CONFIGURATION
from bracket_cell.kinds import WEIGHTS
from bracket_cell.learned.inference.onnx_model import digest_of
from bracket_ground.errors import InputError
from bracket_ground.files.model import Model
from bracket_ground.files.row_store import RowStore
from bracket_ground.files.yaml_file import load_yaml, write_values

BARS = Path(__file__).parents[1] / "evaluations" / "bars.yaml"
FIRST_SEED, LAST_SEED = 900_000, 1_000_000  # of the test split


class Figure(Model):
    """One figure of a command.

    Attributes:
        key: names on the way through the command's JSON.
        least, most: the bar.
        trivial: what an answer without looking gets.
    """

    claim: str
    key: str
    least: float | None = None
    most: float | None = None
    trivial: float | None = None

    @model_validator(mode="after")
    def _one_bar(self) -> Figure:
        if (self.least is None) == (self.most is None):
            raise ValueError(f"{self.claim}: must have either `least` or `most`")
        return self

    def of(self, told: Any) -> dict[str, Any]:
        """The figure in a command's answer, its interval, and whether it meets the bar.

        Raises:
            InputError: the answer does not hold it.
        """
        *way, last = self.key.split(".")
        try:
            for name in way:
                told = told[name]
            value = float(told[last])
        except (KeyError, TypeError, ValueError):
            raise InputError(f"{self.claim}: the answer holds no number `{self.key}`") from None
        low, high = (told.get(f"{last}_{end}", told.get(end) if last == "share" else None) for end in ("low", "high"))
        met = value >= self.least if self.least is not None else self.most is not None and value <= self.most
        bar = {"bar": self.least if self.least is not None else self.most, "met": met, "trivial": self.trivial}
        return {"claim": self.claim, "figure": value, "interval": None if low is None else [low, high], **bar}


class Measured(Model):
    """A command below `cell lab eval`, and its figures.

    Attributes:
        seeds: on how many it runs; None for its own draw, by --seed.
        settings: of the configuration, by dotted names, where they are others than the shipped ones.
    """

    command: str
    seeds: int | None = Field(default=None, ge=1)
    settings: Mapping[str, JsonValue] = Field(default_factory=dict)
    figures: tuple[Figure, ...]

    def words(self, first_seed: int) -> list[str]:
        """What is typed."""
        if self.seeds is None:
            return [*self.command.split(), "--seed", str(first_seed), "--json"]
        return [*self.command.split(), "--seeds", f"{first_seed}:{first_seed + self.seeds}", "--json"]


class Bars(Model):
    """The file."""

    bars: tuple[Measured, ...]


def bars(
    first_seed: Annotated[
        int, Option(min=FIRST_SEED, max=LAST_SEED - 1000, help="Of the fresh draw; all figures begin there.")
    ],
    only: Annotated[list[str] | None, Option(help="Commands that begin so, like hands; may be repeated.")] = None,
    out: Annotated[
        Path | None, Option("--out", "-o", help="File that keeps the answers; interrupted, the command goes on there.")
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """Score all shipped networks on one fresh draw, beside their bars.

    A row for each figure; ends with status 1 where a bar is missed.
    """
    chosen = chosen_bars(only)
    weights = {path.name: digest_of(path.read_bytes())[:16] for path in sorted(WEIGHTS.glob("*.onnx"))}
    store = RowStore(out, ["command"], {"first_seed": first_seed, "weights": weights})
    rows = list(measured(chosen, first_seed, store, ask))
    console().print(_table(rows))
    if as_json:
        print_json({"first_seed": first_seed, "rows": rows})
    return 0 if all(row["met"] for row in rows) else 1


def chosen_bars(only: Sequence[str] | None = None, path: Path = BARS) -> list[Measured]:
    """The bars of a file, all or some.

    Raises:
        InputError: the file is wrong, or holds none of those.
    """
    found = load_yaml(path, Bars).bars
    chosen = [one for one in found if not only or any(one.command.startswith(begin) for begin in only)]
    if not chosen:
        legal = sorted({one.command.split()[0] for one in found})
        raise InputError(f"--only {' '.join(only or ())}: no such command; legal: {', '.join(legal)}")
    return chosen


def measured(
    chosen: Sequence[Measured],
    first_seed: int,
    store: RowStore,
    ask: Callable[[list[str], Mapping[str, JsonValue]], Any],
) -> Iterator[dict[str, Any]]:
    """A row for each figure; commands whose answers are kept are not asked again."""
    for one in chosen:
        words = one.words(first_seed)
        settings = ", ".join(f"{name}: {json.dumps(value)}" for name, value in one.settings.items())
        command = f"cell lab eval {' '.join(words)}" + (f" --config FILE with {settings}" if settings else "")
        if command not in store:
            console().print(command, highlight=False)
            store.add({"command": command, "told": ask(words, one.settings)})
        (kept,) = (row for row in store.rows if row["command"] == command)
        yield from ({**figure.of(kept["told"]), "command": command} for figure in one.figures)


def ask(words: list[str], settings: Mapping[str, JsonValue]) -> Any:
    """The JSON that a command below `cell lab eval` prints.

    Args:
        settings: of the shipped configuration, by dotted names, that are others.

    Raises:
        InputError: it failed; with its last line.
    """
    with tempfile.TemporaryDirectory() as folder:
        program = [sys.executable, "-m", "bracket_cell", "lab", "eval", *words]
        if settings:
            copied = shutil.copytree(DEFAULT_CONFIGURATION.parent, Path(folder) / "config")
            configuration = copied / DEFAULT_CONFIGURATION.name
            write_values(configuration, {tuple(name.split(".")): value for name, value in settings.items()})
            program += ["--config", str(configuration)]
        done = subprocess.run(program, capture_output=True, text=True, check=False, env={**os.environ, BESIDE: "1"})
    lines = done.stdout.strip().splitlines()
    if done.returncode or not lines:
        said = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
        raise InputError(f"cell lab eval {' '.join(words)}: ended with status {done.returncode}: {said}")
    return json.loads(lines[-1])


def _table(rows: Sequence[dict[str, Any]]) -> Table:
    drawn = Table("claim", "figure", "interval", "bar", "trivial", "")
    for row in rows:
        low_high = "" if row["interval"] is None else "{:.3g} - {:.3g}".format(*row["interval"])
        trivial = "" if row["trivial"] is None else f"{row['trivial']:.3g}"
        drawn.add_row(
            row["claim"], f"{row['figure']:.4g}", low_high, f"{row['bar']:.4g}", trivial, "" if row["met"] else "missed"
        )
    return drawn
