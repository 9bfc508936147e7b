"""What training data vary beyond looks: parts that lie, unknown objects among them, and parts of bare steel."""

from __future__ import annotations

import numpy as np

from cell.interfaces.product import Product
from sim.settings import ClutterSettings

MOST_FOREIGN = 2
LYING_SHARE, STACKED_SHARE = 0.2, 0.15  # of the parts in a mixed tray
STEEL_LEVELS = (0.40, 0.58)  # grey of bare steel, drawn for each type
TINT = 0.02
CLUTTER_STREAM, STEEL_STREAM = 6, 7


def mixed_clutter(settings: ClutterSettings, seed: int, lying_share: float = LYING_SHARE) -> ClutterSettings:
    """Trays in which some parts lie, some are on top of others, and up to MOST_FOREIGN objects are of no type."""
    foreign = int(np.random.default_rng([seed, CLUTTER_STREAM]).integers(MOST_FOREIGN + 1))
    mixed = {"lying_share": lying_share, "stacked_share": STACKED_SHARE, "foreign_objects": foreign}
    return settings.model_copy(update=mixed)


def sometimes_steel(product: Product, share: float, seed: int) -> Product:
    """The product in bare steel with this probability, and as it is otherwise; shapes stay what they are."""
    rng = np.random.default_rng([seed, STEEL_STREAM])
    if rng.random() >= share:
        return product
    parts = {}
    for name, kind in product.parts.items():
        red, green, blue = (float(level) for level in rng.uniform(*STEEL_LEVELS) + rng.uniform(-TINT, TINT, 3))
        parts[name] = kind.model_copy(update={"colour_rgb": (red, green, blue), "finish": "steel"})
    return product.model_copy(update={"parts": parts})
