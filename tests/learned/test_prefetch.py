"""What was prepared is what would have been worked out."""

from __future__ import annotations

import numpy as np

from bracket_cell.learned.inference.prefetch import KEPT, Image, Prefetch


def test_work_is_done_once_for_an_image_and_again_for_its_copy() -> None:
    asked: list[int] = []

    def brightness(image: Image) -> int:
        asked.append(int(image.sum()))
        return asked[-1]

    ahead = Prefetch(brightness)
    images = [np.full((2, 2), number, np.uint8) for number in range(KEPT + 1)]
    for image in images:
        ahead.prepare(image)
    asked.clear()
    assert ahead(images[-1]) == 4 * KEPT
    assert asked == []
    assert ahead(images[-1].copy()) == 4 * KEPT
    assert ahead(images[0]) == 0  # forgotten
    assert asked == [4 * KEPT, 0]
