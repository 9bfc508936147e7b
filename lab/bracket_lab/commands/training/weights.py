"""What a training is asked for and needs, where weights are shipped, and where new ones are written."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

from typer import Option

from bracket_cell.commands.options import (
    CONFIGURATION,
    ConfigOption,
    JsonOption,
    OverwriteOption,
    SeedOption,
    folder_for,
    writable,
)
from bracket_cell.configuration import Configuration, load_configuration, load_product
from bracket_ground.errors import CellError, InputError
from bracket_ground.files.files import shipped
from bracket_ground.interfaces.planning import weights_file
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.parts.settings import BACKBONES
from bracket_lab.learned.training.schedule import MOST_EPOCHS

TRAIN_RATIO = 0.77  # 143 of the 186 scenarios of the default product, as in the paper
ONE_KIND = {"hands", "holes"}  # networks of one kind alone: their commands have no option for it
NOT_OF_THE_NETWORK = {"curve", "out", "overwrite", "config", "as_json"}  # options that do not change what is learned
UNITS_S = {"s": 1, "m": 60, "h": 3600}


@dataclass(frozen=True, kw_only=True)
class Training:
    """The options of all trainings; each network has some of them.

    Attributes:
        kind: empty for the network's first one.
    """

    kind: Annotated[str, Option(help="Kind of network.")] = ""
    data: Annotated[
        list[Path] | None, Option(help="Data to learn from, a folder or a file; may be repeated. Made anew by default.")
    ] = None
    simulated: Annotated[bool, Option("--simulated", help="Learn from simulated data beside those of --data.")] = False
    curve: Annotated[bool, Option("--curve", help="With --data: learn from fewer pictures too, to compare.")] = False
    begin: Annotated[
        str | None,
        Option(
            metavar="shipped|FILE", help="Go on with weights that were trained before; few pictures are enough then."
        ),
    ] = None
    validation: Annotated[Path | None, Option(help="Another such folder to score on.")] = None
    look: Annotated[str | None, Option(help="Look of all recordings that are made; several looks by default.")] = None
    tracker: Annotated[
        str | None,
        Option(help="With --look: the hand as this tracker sees it, such as mediapipe; the truth by default."),
    ] = None
    budget: Annotated[str, Option(help="Processor time for data and training, like 90s, 30m or 2h.")] = ""
    epochs: Annotated[
        int | None,
        Option(min=1, max=MOST_EPOCHS, help="Passes through the data; by default chosen for the network."),
    ] = None
    share: Annotated[float, Option(min=0.05, max=1, help="Share of VGG16's channels, if it is used.")] = 1.0
    backbone: Annotated[str, Option(help=f"Backbone of rcnn: {', '.join(BACKBONES)}.")] = BACKBONES[0]
    steps: Annotated[int, Option(min=1, help="Steps of rcnn, each of 4 images.")] = 2000
    ratio: Annotated[float, Option(min=0.01, max=0.99, help="Share of the data to train on.")] = TRAIN_RATIO
    augment: Annotated[bool, Option("--augment", help="Learn from sub-demonstrations too.")] = False
    out: Annotated[Path | None, Option("--out", "-o", help="File to write; next to --config by default.")] = None
    overwrite: OverwriteOption = False
    config: ConfigOption = CONFIGURATION
    seed: SeedOption = 0
    as_json: JsonOption = False

    def cell(self) -> tuple[Configuration, Product]:
        """The configuration and its product."""
        configuration = load_configuration(self.config)
        return configuration, load_product(configuration, self.config)

    def command(self, name: str, *, epochs: int | None = None) -> str:
        """What makes the same network again, for its model card.

        Args:
            epochs: that the budget allowed.
        """
        words = []
        for field in fields(self):
            value = epochs if field.name == "epochs" else getattr(self, field.name)
            given = field.name == "seed" or value != field.default
            if field.name in NOT_OF_THE_NETWORK or not given or value in (None, "", (), []):
                continue
            if field.name == "kind" and name in ONE_KIND:
                continue
            for each in value if isinstance(value, list) else [value]:
                words += [f"--{field.name}", *([] if each is True else [str(each)])]
        return shlex.join(["cell", "lab", "train", name, *words])


def seconds(text: str) -> float:
    """Seconds of a budget: "90s", "30m" or "1.5h".

    Raises:
        InputError: it is written otherwise, or nothing.
    """
    found = re.fullmatch(r"(\d+(?:\.\d+)?)([smh])", text.strip())
    if found is None or float(found[1]) == 0:
        raise InputError(f"--budget {text}: must be a number with its unit, more than 0, like 90s, 30m or 2h")
    return float(found[1]) * UNITS_S[found[2]]


def shipped_weights(planner: str, kind: str) -> Path:
    """File of the weights that come with the program."""
    return shipped("bracket_cell.learned", "weights", weights_file(planner, kind))


def new_weights(planner: str, kind: str, config: Path, out: Path | None = None) -> Path:
    """File for weights that are trained for a configuration: beside it, or where `out` says.

    Raises:
        InputError: no weights can be written there.
    """
    name = weights_file(planner, kind)
    return writable(out or folder_for(config) / name, Path(name).suffix)


@contextmanager
def writing(weights: Path, *beside: Path, overwrite: bool, option: str = "--out") -> Iterator[None]:
    """Around a training: it writes over nothing unasked, but goes on where it was interrupted.

    While it lasts, and after it was interrupted, an empty file beside the weights says so.

    Args:
        beside: what it writes besides them.
        option: which says where.

    Raises:
        InputError: a file is there already.
    """
    begun = weights.with_name(f"{weights.name}.unfinished")
    goes_on = begun.exists()
    require_new(weights, *beside, overwrite=overwrite or goes_on, option=option)
    begun.touch()
    try:
        yield
    except CellError:
        if not goes_on:
            begun.unlink(missing_ok=True)
        raise
    begun.unlink(missing_ok=True)


def require_new(*files: Path, overwrite: bool, option: str = "--out") -> None:
    """Check that no file is written over unasked.

    Raises:
        InputError: one is there already.
    """
    for file in files:
        if file.is_file() and not overwrite:
            raise InputError(f"{file}: exists already; choose another {option}, or add --overwrite")
