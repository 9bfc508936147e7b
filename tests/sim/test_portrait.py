"""The picture from the side leaves the cell's own cameras as they were."""

from __future__ import annotations

import numpy as np

from bracket_sim.rendering.studio import Studio
from tests.docs.portrait import portrait
from tests.sim.conftest import MakeRig


def test_a_portrait_changes_nothing_else(make_rig: MakeRig) -> None:
    world = make_rig().cell.world
    studio = Studio(world)
    before = studio.render("overhead", 240, 180).copy()
    picture = portrait(world, 320, 180)
    after = studio.render("overhead", 240, 180)
    studio.close()
    assert picture.shape == (180, 320, 3)
    assert picture.std() > 20
    np.testing.assert_array_equal(before, after)
