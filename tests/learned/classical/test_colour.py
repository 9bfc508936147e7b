"""Colours are told apart under any light, in any product whose colours differ."""

import numpy as np
import pytest

from bracket_cell.learned.classical.colour import BACKGROUND, ColourModel
from bracket_ground.errors import InputError
from bracket_ground.interfaces.product import Product
from tests.learned.classical.scenes import PRODUCT, SKIN

OTHER_COLOURS = ((0.85, 0.75, 0.05), (0.45, 0.10, 0.60), (0.05, 0.65, 0.65))


def repainted(colours: tuple[tuple[float, float, float], ...]) -> Product:
    parts = {
        name: part.model_copy(update={"colour_rgb": colour})
        for (name, part), colour in zip(PRODUCT.parts.items(), colours, strict=True)
    }
    return PRODUCT.model_copy(update={"parts": parts})


@pytest.mark.parametrize("product", [PRODUCT, repainted(OTHER_COLOURS)])
@pytest.mark.parametrize("light", [0.4, 0.7, 1.0, 1.25])
def test_light_does_not_change_a_colour(product: Product, light: float) -> None:
    model, rng = ColourModel(product, SKIN), np.random.default_rng(0)
    colours = [*(part.colour_rgb for part in product.parts.values()), SKIN]
    for label, colour in enumerate(colours, start=1):
        clean = np.tile(np.array(colour) * light * 255, (20, 20, 1))
        image = np.clip(clean + rng.normal(0, 3, clean.shape), 0, 255).astype(np.uint8)
        assert np.mean(model.label(image) == label) > 0.97


def test_gloss_does_not_change_a_colour() -> None:
    model = ColourModel(PRODUCT, SKIN)
    for label, part in enumerate(PRODUCT.parts.values(), start=1):
        glossy = (np.array(part.colour_rgb) * 0.8 + 0.12) * 255
        assert model.label(glossy.astype(np.uint8).reshape(1, 1, 3))[0, 0] == label


@pytest.mark.parametrize("grey", [0, 12, 60, 128, 200, 255])
def test_grey_is_background(grey: int) -> None:
    image = np.full((4, 4, 3), grey, np.uint8)
    assert (ColourModel(PRODUCT, SKIN).label(image) == BACKGROUND).all()


@pytest.mark.parametrize("colour", [(0.5, 0.5, 0.5), (0.78, 0.11, 0.08), tuple(SKIN)])
def test_colours_that_cannot_be_told_apart_are_refused(colour: tuple[float, float, float]) -> None:
    alike = repainted(((0.80, 0.10, 0.08), colour, (0.10, 0.50, 0.15)))
    with pytest.raises(InputError, match="o2"):
        ColourModel(alike, SKIN)
