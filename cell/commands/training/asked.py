"""What a training is asked for."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

from typer import Option

from cell.commands.options import CONFIGURATION, ConfigOption, JsonOption, OverwriteOption, SeedOption
from cell.configuration import Configuration, load_configuration, load_product
from cell.interfaces.product import Product
from learned.parts.settings import BACKBONES

TRAIN_RATIO = 0.77  # 143 of the 186 scenarios of the default product, as in the paper
NOT_OF_THE_NETWORK = {"out", "overwrite", "config", "as_json"}  # options that do not change what is learned


@dataclass(frozen=True, kw_only=True)
class Training:
    """The options of all trainings; each network has some of them.

    Attributes:
        kind: empty for the network's first one.
    """

    kind: Annotated[str, Option(help="Kind of network.")] = ""
    data: Annotated[
        list[Path] | None,
        Option(help="Data to learn from, a folder or a file; may be repeated. Made anew by default."),
    ] = None
    validation: Annotated[Path | None, Option(help="Another such folder to score on.")] = None
    look: Annotated[str | None, Option(help="Look of all recordings that are made; several looks by default.")] = None
    tracker: Annotated[
        str | None,
        Option(help="Tracks with the errors of this tracker, such as mediapipe; true ones by default."),
    ] = None
    budget: Annotated[str, Option(help="Processor time for data and training, like 90s, 30m or 2h.")] = ""
    epochs: Annotated[int | None, Option(min=1, help="Passes through the data; by default chosen for the network.")] = (
        None
    )
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
        for one in fields(self):
            value = epochs if one.name == "epochs" else getattr(self, one.name)
            told = one.name == "seed" or value != one.default
            if one.name in NOT_OF_THE_NETWORK or not told or value in (None, "", (), []):
                continue
            for each in value if isinstance(value, list) else [value]:
                words += [f"--{one.name}", *([] if each is True else [str(each)])]
        return shlex.join(["cell", "lab", "train", name, *words])
