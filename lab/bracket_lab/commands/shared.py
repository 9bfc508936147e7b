"""The options that the commands of `cell lab` share: what is simulated and from which seeds, and where answers go."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from types import ModuleType
from typing import Annotated, cast

from typer import Option

from bracket_cell.commands.options import (
    CONFIGURATION,
    ConfigOption,
    JsonOption,
    LookOption,
    PersonOption,
    SchedulerOption,
    SeedOption,
    SeedsOption,
    WorkersOption,
    seeds_of,
)
from bracket_cell.commands.terminal import console, report_scores
from bracket_cell.configuration import Configuration, load_configuration, load_product, simulated
from bracket_cell.kinds import WEIGHTS
from bracket_cell.learned.inference.onnx_model import digest_of
from bracket_ground.errors import InputError
from bracket_ground.files.row_store import RowStore
from bracket_ground.interfaces.product import Product
from bracket_lab.drawing.sight import seeds as split_of
from bracket_lab.experiments.experiments import code_version
from bracket_lab.learned.parts.data import Scene
from bracket_lab.pictures.scoring import Scorer, load, note


class Cameras(StrEnum):
    """Which mounts and lenses of the cameras are believed."""

    calibrated = "calibrated"
    believed = "believed"
    true = "true"


@dataclass(frozen=True, kw_only=True)
class Shared:
    """What is evaluated, on what, and where the answers go; each command has some of these options."""

    kind: Annotated[list[str] | None, Option(help="Kind of detector or planner; may be repeated if several fit.")] = (
        None
    )
    weights: Annotated[Path | None, Option(help="File of weights; the configured or shipped one by default.")] = None
    data: Annotated[
        list[Path] | None,
        Option(help="Folder of `cell label` to score on instead of simulated pictures; may be repeated."),
    ] = None
    perception: Annotated[
        str | None, Option(help="classical or learned for all detectors; by default as configured.")
    ] = None
    look: LookOption = "varied"
    person: PersonOption = "varied"
    seeds: SeedsOption = "900000:900010"
    cameras: Annotated[
        Cameras,
        Option(help="Camera poses to use: calibrated for each look, those of the configuration, or the true ones."),
    ] = Cameras.calibrated
    physics: Annotated[
        bool,
        Option(
            "--physics/--no-physics",
            help="Simulate contact, or only move hand and parts along their ways: eight times as fast.",
        ),
    ] = False
    steel: Annotated[bool, Option("--steel", help="All parts are of bare steel.")] = False
    pixels: Annotated[bool, Option("--pixels", help="Render every image: slower.")] = False
    only: Annotated[list[str] | None, Option(help="Only these; may be repeated.")] = None
    out: Annotated[
        Path | None, Option("--out", "-o", help="File that keeps the answers; interrupted, the command goes on there.")
    ] = None
    workers: WorkersOption = 1
    scheduler: SchedulerOption = None
    config: ConfigOption = CONFIGURATION
    seed: SeedOption = 0
    as_json: JsonOption = False

    def cell(self, *, person: bool = True) -> tuple[Configuration, Product]:
        """The configuration as it is simulated, and its product.

        Args:
            person: with the person that is asked for, not the configured one.
        """
        configuration = simulated(load_configuration(self.config), self.look, self.person if person else None)
        return configuration, load_product(configuration, self.config)

    @property
    def numbers(self) -> range:
        """The seeds.

        Raises:
            InputError: they are not written as seeds.
        """
        return seeds_of(self.seeds)

    def split(self) -> tuple[str, range]:
        """The split of the seeds, and the seeds.

        Raises:
            InputError: they are not all of one split.
        """
        return split_of(self.numbers.start, len(self.numbers))

    def one_kind(self, legal: Sequence[str]) -> str:
        """The only kind, the first legal one by default.

        Raises:
            InputError: there is none of this name, or several are named.
        """
        if self.kind and len(self.kind) > 1:
            raise InputError(f"--kind {self.kind[1]}: one kind is evaluated at a time")
        kind = self.kind[0] if self.kind else legal[0]
        if kind not in legal:
            raise InputError(f"--kind {kind}: unknown kind; legal: {', '.join(legal)}")
        return kind

    def rows(self, by: Sequence[str], of: Mapping[str, object], measure: ModuleType, *weights: Path) -> RowStore:
        """The rows of an evaluation in --out, of this code and these weights alone.

        Args:
            by: fields of a row that make up its key.
            of: what was typed.
            measure: what makes a row.
            weights: files that the answers hang on.

        Raises:
            InputError: the file holds rows of something else, or of other code or weights.
        """
        known = {path.name: digest_of(path.read_bytes())[:16] for path in weights}
        return RowStore(self.out, by, {**of, "code": code_version(measure.__name__), "weights": known})

    def score_pictures(self, task: str, kind: str, data: Sequence[Path], page: Path | None = None) -> None:
        """Score a detector on labelled pictures; the figures go onto the card of weights that are the user's own.

        Args:
            page: HTML to write of the worst ones, for parts.
        """
        configuration = load_configuration(self.config)
        product = load_product(configuration, self.config)
        pictures = load(task, data, product, configuration.bench.overhead.rate_hz)
        scorer = Scorer(configuration, product, task, kind, self.weights)
        scores, wrong = scorer.scores(pictures), 0
        if page is not None:
            sure, wrong = scorer.worst_parts(cast(Sequence[Scene], pictures), scores, page)
            scores |= sure
        where = ", ".join(str(folder) for folder in data)
        report_scores(f"{task}, {kind}, {len(pictures)} labelled in {where}", scores, self.as_json)
        if page is not None:
            console().print(f"something is wrong in {wrong} of {len(pictures)}: see {page}", highlight=False)
        if self.weights is not None and self.weights.resolve().parent != WEIGHTS.resolve():
            note(self.weights, scores)
            console().print(f"noted on the card of {self.weights}", highlight=False)

    def refuse_only(self, legal: Collection[str]) -> None:
        """Raises InputError where --only names something else."""
        if unknown := [name for name in self.only or () if name not in legal]:
            raise InputError(f"--only {unknown[0]}: unknown; legal: {', '.join(legal)}")


def share_words(value: object) -> str:
    """A share with its interval, or any other value, in words."""
    if isinstance(value, dict) and "share" in value:
        return f"{value['share']:.3f} of {value['n']} ({value['low']:.3f} - {value['high']:.3f})"
    return str(value)
