"""The shipped product and bench, and cells that close themselves."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest
import yaml

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.product import Product
from bracket_sim.cell import SimCell
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.settings import SimSettings
from tests.sim.rig import Rig

CONFIG = Path(__file__).parents[2] / "config"

MakeRig = Callable[..., Rig]


@pytest.fixture(scope="session")
def product() -> Product:
    return Product.model_validate(yaml.safe_load((CONFIG / "products.yaml").read_text()))


@pytest.fixture(scope="session")
def bench() -> Bench:
    return Bench.model_validate(yaml.safe_load((CONFIG / "cell.yaml").read_text())["bench"])


@pytest.fixture
def make_rig(product: Product, bench: Bench, request: pytest.FixtureRequest) -> Iterator[MakeRig]:
    """Opens cells with the robot alone, the given parts in the tray, and almost no overhead frames."""
    rigs: list[Rig] = []
    slow = bench.overhead.model_copy(update={"rate_hz": 0.01})
    blind = bench.model_copy(update={"overhead": slow})

    def make(clutter: Sequence[ScenePart] = (), seed: int = 0, *, frames: bool = False) -> Rig:
        channel = f"{request.node.name}-{len(rigs)}"
        chosen = bench if frames else blind
        cell = SimCell(product, chosen, SimSettings(), "virtual", channel, seed, "g0", worker=False, clutter=clutter)
        rigs.append(Rig(cell, channel))
        return rigs[-1]

    yield make
    for rig in rigs:
        rig.close()
