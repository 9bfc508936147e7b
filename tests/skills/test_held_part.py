"""The fingers' distance tells which part is held, or that it does not."""

from __future__ import annotations

import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.motion.grasp_pose import held_type

CONFIGURATION = load_configuration()
PRODUCT = load_product(CONFIGURATION)


@pytest.mark.parametrize(
    ("opening_m", "part"),
    [
        (0.02633, "o1"),  # as simulated fingers stand
        (0.03300, "o2"),
        (0.06467, "o2"),
        (0.0440, "o1"),
        (0.0312, "o3"),
        (0.0490, "o3"),
        (0.0320, None),  # half way from o3 to o2
        (0.0465, None),
        (0.0, None),
        (0.056, None),
    ],
)
def test_the_only_type_that_fits_or_none(opening_m: float, part: str | None) -> None:
    assert held_type(PRODUCT, opening_m, CONFIGURATION.motion) == part
