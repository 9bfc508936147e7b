"""Tests of the simulated cell."""

import sim as _sim  # noqa: F401  (chooses the renderer before a test imports MuJoCo)
