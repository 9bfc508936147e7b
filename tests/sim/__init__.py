"""Tests of the simulated cell."""

import bracket_sim as _sim  # noqa: F401  (chooses the renderer before a test imports MuJoCo)
