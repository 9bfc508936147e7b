"""The simulated cell: world, devices, worker and scoring."""

import os

# Read once by MuJoCo at its import. EGL renders this cell on a CPU in two thirds of osmesa's time.
os.environ.setdefault("MUJOCO_GL", "egl")
