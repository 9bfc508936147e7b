"""`cell lab eval bars`: measures what the pages of figures show, beside what is to be reached."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, JsonValue, model_validator
from rich.table import Table
from typer import Option

from bracket_cell.commands.options import JsonOption
from bracket_cell.commands.terminal import BESIDE, console, print_json
from bracket_cell.configuration import DEFAULT_CONFIGURATION
from bracket_cell.fleet.intervals import wilson
from bracket_cell.kinds import WEIGHTS
from bracket_cell.learned.inference.onnx_model import digest_of
from bracket_cell.packages import version
from bracket_cell.recording.identity import code_version
from bracket_ground.errors import InputError
from bracket_ground.files.model import Model
from bracket_ground.files.row_store import RowStore
from bracket_ground.files.yaml_file import load_yaml, write_values
from bracket_lab.evaluations.figures import Row, write_rows

BARS = Path(__file__).parents[1] / "evaluations" / "bars.yaml"
EVALUATE = "bracket_cell lab eval"
FIRST_SEED, LAST_SEED = 900_000, 1_000_000  # of the test split


class Figure(Model):
    """One figure of a command.

    Attributes:
        key: names on the way through the command's JSON.
        least, most: the bar; neither for what is only told.
        trivial: what an answer without looking gets, or where the command's answer says it, by dotted names.
        paper: the paper's figure under the same conditions.
        n: how many are counted, where the answer does not say it; of a share without an interval a number.
    """

    claim: str
    key: str
    least: float | None = None
    most: float | None = None
    trivial: float | str | None = None
    paper: str | None = None
    n: int | str | None = None

    @model_validator(mode="after")
    def _one_bar(self) -> Figure:
        if self.least is not None and self.most is not None:
            raise ValueError(f"{self.claim}: must not have both `least` and `most`")
        return self

    def of(self, data: Any) -> dict[str, Any]:
        """The figure in a command's answer, its interval, and whether it meets the bar.

        Raises:
            InputError: the answer does not hold it.
        """
        trivial = self._number(self.trivial, data)[0] if isinstance(self.trivial, str) else self.trivial
        value, data = self._number(self.key, data)
        last = self.key.rpartition(".")[2]
        low, high = (data.get(f"{last}_{end}", data.get(end) if last == "share" else None) for end in ("low", "high"))
        count = self.n or data.get(f"{last}_n", data.get("n") if last == "share" else None)
        bar = self.least if self.least is not None else self.most
        met = None if bar is None else value >= bar if self.least is not None else value <= bar
        beside = {"bar": bar, "met": met, "trivial": trivial, "paper": self.paper, "n": count}
        if low is None and isinstance(count, int):
            low, _, high = wilson(round(value * count), count)
        ends = None if low is None else [_short(low), _short(high)]
        return {"claim": self.claim, "figure": _short(value), "interval": ends, **beside}

    def _number(self, key: str, data: Any) -> tuple[float, Any]:
        """A number of a command's answer, and what holds it."""
        *way, last = key.split(".")
        try:
            for name in way:
                data = data[name]
            return float(data[last]), data
        except (KeyError, TypeError, ValueError):
            raise InputError(f"{self.claim}: the answer holds no number `{key}`") from None


def _short(value: float) -> float:
    """Four digits: more than any of these intervals can tell apart."""
    return float(f"{value:.4g}")


class Measured(Model):
    """A command below `cell lab eval`, and its figures.

    Attributes:
        module: of a clone that is run instead of `cell lab eval`.
        page, table: of docs/figures, where its figures stand.
        minutes: what it costs, on one core; with `gpu`, beside a GPU.
        seeds: on how many it runs; None for its own draw, by --seed.
        out: it keeps what it has measured in --out, and goes on there.
        settings: of the configuration, by dotted names, where they are others than the shipped ones.
    """

    command: str
    module: str = ""
    page: str
    table: str
    minutes: float = Field(gt=0)
    gpu: bool = False
    seeds: int | None = Field(default=None, ge=1)
    out: bool = False
    settings: Mapping[str, JsonValue] = Field(default_factory=dict)
    figures: tuple[Figure, ...]

    def words(self, first_seed: int) -> list[str]:
        """What is typed after `python -m`."""
        asked = [self.module] if self.module else [*EVALUATE.split()]
        if self.seeds is None:
            return [*asked, *self.command.split(), "--seed", str(first_seed), "--json"]
        return [*asked, *self.command.split(), "--seeds", f"{first_seed}:{first_seed + self.seeds}", "--json"]

    def told(self, first_seed: int) -> str:
        """The same as a page names it."""
        words = " ".join(self.words(first_seed)).replace(EVALUATE, "cell lab eval") + " --out FILE" * self.out
        settings = ", ".join(f"{name}: {json.dumps(value)}" for name, value in self.settings.items())
        typed = f"python -m {words}" if self.module else words
        return typed + (f" --config FILE with {settings}" if settings else "")


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
    write: Annotated[bool, Option("--write", help="Write the figures into docs/figures, each in its table.")] = False,
    plan: Annotated[bool, Option("--plan", help="Only print what would be run, and what it costs.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Measure what the pages of figures show, on one fresh draw, beside bars, trivial answers and the paper.

    A row for each figure; ends with status 1 where a bar is missed.
    """
    chosen = chosen_bars(only)
    if plan:
        console().print(_cost(chosen, first_seed))
        return 0
    weights = {path.name: digest_of(path.read_bytes())[:16] for path in sorted(WEIGHTS.glob("*.onnx"))}
    store = RowStore(out, ["command"], {"first_seed": first_seed, "weights": weights})
    with parts_of(out) as folder:
        rows = list(measured(chosen, first_seed, store, ask, folder))
    if write:
        _write(chosen, rows)
    console().print(_table(rows))
    if as_json:
        print_json({"first_seed": first_seed, "rows": rows})
    return 1 if any(row["met"] is False for row in rows) else 0


def chosen_bars(only: Sequence[str] | None = None, path: Path = BARS) -> list[Measured]:
    """The bars of a file, all or some.

    Raises:
        InputError: the file is wrong, or holds none of those.
    """
    found = load_yaml(path, Bars).bars
    chosen = [bar for bar in found if not only or any(bar.command.startswith(begin) for begin in only)]
    if not chosen:
        legal = sorted({bar.command.split()[0] for bar in found})
        raise InputError(f"--only {' '.join(only or ())}: no such command; legal: {', '.join(legal)}")
    return chosen


@contextmanager
def parts_of(out: Path | None) -> Iterator[Path]:
    """The folder beside --out in which commands keep their own parts; one that is gone afterwards without it."""
    if out is not None:
        folder = out.with_suffix(".parts")
        folder.mkdir(parents=True, exist_ok=True)
        yield folder
        return
    with tempfile.TemporaryDirectory() as made:
        yield Path(made)


def measured(
    chosen: Sequence[Measured],
    first_seed: int,
    store: RowStore,
    ask: Callable[[list[str], Mapping[str, JsonValue]], Any],
    parts: Path,
) -> Iterator[dict[str, Any]]:
    """A row for each figure; commands whose answers are kept are not asked again.

    Args:
        parts: folder for what commands keep of an interrupted measurement.
    """
    for bar in chosen:
        command = bar.told(first_seed)
        if command not in store:
            console().print(command, highlight=False)
            part = parts / f"{digest_of(command.encode())[:16]}.jsonl"
            words = bar.words(first_seed) + (["--out", str(part)] if bar.out else [])
            store.add({"command": command, "told": ask(words, bar.settings)})
        (kept,) = (row for row in store.rows if row["command"] == command)
        yield from ({**figure.of(kept["told"]), "command": command} for figure in bar.figures)


def ask(words: list[str], settings: Mapping[str, JsonValue]) -> Any:
    """The JSON that a command prints.

    Args:
        words: after `python -m`.
        settings: of the shipped configuration, by dotted names, that are others.

    Raises:
        InputError: it failed; with its last line.
    """
    with tempfile.TemporaryDirectory() as folder:
        program = [sys.executable, "-m", *words]
        if settings:
            copied = shutil.copytree(DEFAULT_CONFIGURATION.parent, Path(folder) / "config")
            configuration = copied / DEFAULT_CONFIGURATION.name
            write_values(configuration, {tuple(name.split(".")): value for name, value in settings.items()})
            program += ["--config", str(configuration)]
        done = subprocess.run(program, capture_output=True, text=True, check=False, env={**os.environ, BESIDE: "1"})
    lines = done.stdout.strip().splitlines()
    if done.returncode or not lines:
        said = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
        raise InputError(f"{' '.join(words)}: ended with status {done.returncode}: {said}")
    return json.loads(lines[-1])


def _write(chosen: Sequence[Measured], rows: Sequence[dict[str, Any]]) -> None:
    """Rows into their tables, of this commit and release."""
    commit, clean = code_version().values()
    if clean != "true":
        raise InputError("--write: the code has changes that no commit holds; commit them first")
    rest = iter(rows)
    for bar in chosen:
        seeds = f"{bar.seeds} seeds"
        found = [next(rest) for _ in bar.figures]
        shown = ({**row, "interval": row["interval"] or "unknown", "n": row["n"] or seeds} for row in found)
        write_rows(bar.page, bar.table, [Row(**row, commit=commit[:8], release=version()) for row in shown])


def _cost(chosen: Sequence[Measured], first_seed: int) -> Table:
    once = {bar.told(first_seed): bar for bar in chosen}.values()  # a command that fills two tables runs once
    on_core, with_gpu = (sum(bar.minutes for bar in once if bar.gpu is gpu) / 60 for gpu in (False, True))
    title = f"{on_core:.1f} h of one core, {with_gpu:.1f} h of a GPU in all"
    drawn = Table("command", "page", "minutes", title=title)
    for bar in once:
        drawn.add_row(bar.told(first_seed), bar.page, f"{bar.minutes:g}" + ", GPU" * bar.gpu)
    return drawn


def _table(rows: Sequence[dict[str, Any]]) -> Table:
    drawn = Table("claim", "figure", "interval", "bar", "trivial", "")
    for row in rows:
        low_high = "" if row["interval"] is None else "{:.3g} - {:.3g}".format(*row["interval"])
        trivial = "" if row["trivial"] is None else f"{row['trivial']:.3g}"
        drawn.add_row(
            *(
                row["claim"],
                f"{row['figure']:.4g}",
                low_high,
                "" if row["bar"] is None else f"{row['bar']:.4g}",
                trivial,
            ),
            "missed" if row["met"] is False else "",
        )
    return drawn
