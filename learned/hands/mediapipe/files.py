"""Where MediaPipe's networks are kept: outside the repository, with their licence."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

Size = Literal["lite", "full"]
Network = Literal["palm", "landmark"]
SIZES: tuple[Size, ...] = ("lite", "full")
PALM_KIND, LANDMARK_KIND = "hands.mediapipe_palm", "hands.mediapipe_landmark"
ON_THE_BENCH: Size = "lite"
FETCH = "make hands, or: cell hands fetch"


def model_folder() -> Path:
    """The user's folder of fetched networks: below XDG_CACHE_HOME, or ~/.cache."""
    cache = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache) if cache else Path.home() / ".cache") / "cell" / "mediapipe"


def network_file(folder: Path, network: Network, size: Size) -> Path:
    """File of one network in a folder."""
    return folder / f"{network}_{size}.onnx"


def folder_in_use(path: Path) -> Path:
    """The folder whose networks are used: that of `path` where they are there, else the user's cache."""
    return path.parent if path.name.startswith("landmark") and path.is_file() else model_folder()
