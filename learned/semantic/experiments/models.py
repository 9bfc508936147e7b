"""Planners straight from training, and generated products, for experiments. Imports torch."""

from __future__ import annotations

import numpy as np

from cell.interfaces.planning import SemanticPlanner
from cell.interfaces.product import Product
from learned.onnx_model import ModelCard
from learned.semantic.and_or import AndOrGraph
from learned.semantic.factored import FactoredSettings
from learned.semantic.graph import Layout
from learned.semantic.paper import PaperSettings
from learned.semantic.planner import AndOrPlanner, BayesPlanner, FactoredPlanner, PaperPlanner
from learned.semantic.scenarios import Scenarios
from learned.semantic.train import OUTPUTS, Settings, train_network
from learned.torch_model import TorchModel

KINDS = ("factored", "paper", "and_or", "bayes")
AS_PRINTED = PaperSettings(aggregation="mean", start="object", noise=0.0)


def planner_of(
    kind: str, product: Product, train: Scenarios, seed: int, settings: Settings | None = None
) -> SemanticPlanner:
    """A planner of any kind, trained on these states where it learns at all."""
    if kind == "bayes":
        return BayesPlanner(product)
    layout = Layout.of(product)
    chosen = settings or (PaperSettings() if kind == "paper" else FactoredSettings())
    card = ModelCard(
        kind=f"semantic.{kind}",
        config=chosen.model_dump(),
        vocabulary=layout.vocabulary,
        data_sha256=train.sha256,
        command="",
        seed=seed,
    )
    if kind == "and_or":
        return AndOrPlanner(product, AndOrGraph.of(layout, train, card))
    model = TorchModel(train_network(layout, train, chosen, seed), OUTPUTS[kind], card)
    return PaperPlanner(product, model) if kind == "paper" else FactoredPlanner(product, model)


def first_goals(product: Product, count: int) -> Product:
    """The product with its first goals only."""
    goals = dict(list(product.goals.items())[:count])
    return Product.model_validate({**product.model_dump(), "goals": goals})


def random_goals(product: Product, count: int, rng: np.random.Generator) -> Product:
    """The product with other goals: random arrangements of its parts."""
    parts = [name for name, part in product.parts.items() for _ in range(part.quantity)]
    goals: list[tuple[str, ...]] = []
    while len(goals) < count:
        arrangement = tuple(str(name) for name in rng.permutation(parts))
        if arrangement not in goals:
            goals.append(arrangement)
    return Product.model_validate({**product.model_dump(), "goals": {f"g{i}": goal for i, goal in enumerate(goals)}})


def generated_product(product: Product, positions: int, types: int, goals: int, rng: np.random.Generator) -> Product:
    """A product of any size; shapes are those of the given one's first part, which planners do not look at."""
    shape = next(iter(product.parts.values())).model_dump()
    quantities = np.bincount(np.arange(positions) % types, minlength=types)
    parts = {f"o{i + 1}": {**shape, "quantity": int(quantity)} for i, quantity in enumerate(quantities)}
    holes = {f"p{i + 1}": (0.0, 0.08 * i) for i in range(positions)}
    arrangement = tuple(f"o{i % types + 1}" for i in range(positions))
    bracket = {**product.bracket.model_dump(), "holes_m": holes}
    one = {**product.model_dump(), "parts": parts, "bracket": bracket, "goals": {"g0": arrangement}}
    return random_goals(Product.model_validate(one), goals, rng)
