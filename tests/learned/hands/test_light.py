"""Dark images are made light before hands are looked for."""

import numpy as np

from bracket_cell.learned.hands.model import DARK, levelled


def test_light_images_stay_as_they_are() -> None:
    image = np.full((120, 160, 3), round(DARK) + 1, np.uint8)
    assert levelled(image) is image


def test_dark_ones_become_light_and_keep_their_order() -> None:
    image = np.tile(np.arange(160, dtype=np.uint8)[np.newaxis, :, np.newaxis] // 4, (120, 1, 3))
    seen = levelled(image)
    assert seen.mean() > 2 * image.mean()
    assert (np.diff(seen[0, :, 0].astype(int)) >= 0).all()
    assert seen.max() == 255


def test_what_is_grey_in_red_light_is_grey() -> None:
    image = np.tile(np.arange(160, dtype=np.uint8)[np.newaxis, :, np.newaxis] // 4, (120, 1, 3))
    tinted = np.clip(image * np.array([1.5, 1.0, 0.6]), 0, 255).astype(np.uint8)
    seen = levelled(tinted).astype(int)
    assert abs(seen[..., 0] - seen[..., 2]).mean() < 10


def test_black_is_no_error() -> None:
    assert levelled(np.zeros((120, 160, 3), np.uint8)).max() == 0
