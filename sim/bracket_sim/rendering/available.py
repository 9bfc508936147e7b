"""Whether MuJoCo can render on this machine, tried in a process of its own, and what is missing where it cannot."""

from __future__ import annotations

import os
import subprocess
import sys
import traceback

DEFAULT_BACKEND = "egl"
BACKENDS = ("egl", "osmesa", "glfw")
GL_PACKAGES = "libegl1 libgl1-mesa-dri libopengl0 libosmesa6"
GL_FILES = ("/OpenGL/", "/mujoco/rendering/")
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


def remedy(backend: str) -> str:
    """What to do where a backend does not render."""
    if backend not in BACKENDS:
        return f"the environment variable MUJOCO_GL is {backend!r}; legal: {', '.join(BACKENDS)}"
    other = " (or: export MUJOCO_GL=osmesa)" if backend != "osmesa" and renders("osmesa") else ""
    return f"apt-get install -y {GL_PACKAGES}{other}"


def missing_library(error: Exception) -> str | None:
    """Why nothing renders, where an error came out of OpenGL, which MuJoCo loads with itself; None for other errors."""
    passed = [frame.f_code.co_filename for frame, _ in traceback.walk_tb(error.__traceback__)]
    if not any(part in file for file in passed for part in GL_FILES):
        return None
    return f"nothing can be rendered by {chosen_backend()} ({error}): {remedy(chosen_backend())}"


if __name__ == "__main__":
    sys.exit(0 if renders(chosen_backend()) else 1)
