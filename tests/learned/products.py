"""Products that tests of the planners share."""

from __future__ import annotations

from pathlib import Path

import yaml

from bracket_ground.interfaces.product import Product

DEFAULT = Product.model_validate(yaml.safe_load(Path("config/products.yaml").read_text()))


def with_goals(*goals: str) -> Product:
    """The default product with other goals, each written as digits: "111223"."""
    types = {f"g{i}": tuple(f"o{digit}" for digit in goal) for i, goal in enumerate(goals)}
    return Product.model_validate({**DEFAULT.model_dump(), "goals": types, "goal_titles": {}})


HARDER = with_goals("111223", "112132", "122311")


def relabelled(product: Product, parts: list[int], positions: list[int]) -> Product:
    """The same product with part types and positions listed in another order, their names kept."""
    part_names, position_names = list(product.parts), list(product.positions)
    return Product.model_validate(
        {
            **product.model_dump(),
            "parts": {part_names[i]: product.parts[part_names[i]].model_dump() for i in parts},
            "bracket": {
                **product.bracket.model_dump(),
                "holes_m": {position_names[i]: product.bracket.holes_m[position_names[i]] for i in positions},
            },
            "goals": {name: tuple(types[i] for i in positions) for name, types in product.goals.items()},
        }
    )
