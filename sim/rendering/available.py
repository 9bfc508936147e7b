"""Tries whether MuJoCo can render on this machine, in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys

DEFAULT_BACKEND = "egl"
TIMEOUT_S = 60.0
RENDER = (
    "import mujoco; model = mujoco.MjModel.from_xml_string('<mujoco/>'); data = mujoco.MjData(model); "
    "mujoco.mj_forward(model, data); renderer = mujoco.Renderer(model, 32, 32); "
    "renderer.update_scene(data); renderer.render(); renderer.close()"
)


def chosen_backend() -> str:
    """The OpenGL backend that the cell renders with."""
    return os.environ.get("MUJOCO_GL", DEFAULT_BACKEND)


def renders(backend: str) -> bool:
    """Whether a picture can be made; without its library a backend raises, or ends the whole process."""
    command = [sys.executable, "-c", RENDER]
    environment = {**os.environ, "MUJOCO_GL": backend}
    try:
        return subprocess.run(command, env=environment, capture_output=True, timeout=TIMEOUT_S).returncode == 0
    except subprocess.TimeoutExpired:
        return False


if __name__ == "__main__":
    sys.exit(0 if renders(chosen_backend()) else 1)
