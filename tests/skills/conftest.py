"""The shipped product and bench, and the motion planner for them."""

from __future__ import annotations

import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.product import Product


@pytest.fixture(scope="session")
def product() -> Product:
    return load_product(load_configuration())


@pytest.fixture(scope="session")
def bench() -> Bench:
    return load_configuration().bench


@pytest.fixture(scope="session")
def planner(product: Product, bench: Bench) -> MotionPlanner:
    return MotionPlanner(product, bench)


@pytest.fixture(scope="session")
def kinematics(planner: MotionPlanner) -> Kinematics:
    return planner.kinematics
