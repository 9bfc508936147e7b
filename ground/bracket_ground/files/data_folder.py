"""A new folder of training data: JSON lines with a header, images beside them, a manifest at the end."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_ground.errors import InputError
from bracket_ground.files.files import MANIFEST, require_free

VERSION = 1
JPEG_QUALITY = 95  # of whole frames: hardly told from PNG, a fifth of its size


class DataFolder:
    """Writes rows and images; nothing that exists is overwritten.

    Attributes:
        counts: rows by file.
        left_out: seeds of recordings that nobody should learn from.

    Args:
        source: what was typed, for the headers.

    Raises:
        InputError: the folder is not empty, or cannot be written.
    """

    def __init__(self, path: Path, source: str) -> None:
        require_free(path)
        self._path, self._source = path, source
        self.counts: Counter[str] = Counter()
        self.left_out: list[int] = []
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None

    def image(self, name: str, image: NDArray[np.uint8]) -> str:
        """Write an RGB image, as PNG or as JPEG by its name's ending; returns its name."""
        bgr, suffix = cv2.cvtColor(image, cv2.COLOR_RGB2BGR), Path(name).suffix
        options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if suffix == ".jpg" else []
        self._put(name, cv2.imencode(suffix, bgr, options)[1].tobytes())
        return name

    def row(self, file: str, row: Mapping[str, Any]) -> None:
        """Append a line to `<file>.jsonl`, whose first line is its header."""
        path = self._path / f"{file}.jsonl"
        lines = [] if path.exists() else [{"format": f"cell.{file}", "version": VERSION, "source": self._source}]
        with path.open("a", encoding="utf-8") as stream:
            stream.writelines(json.dumps(line) + "\n" for line in (*lines, row))
        self.counts[file] += 1

    def add(self, piece: DataPiece) -> None:
        """All that another process made."""
        for name, content in piece.images:
            self._put(name, content)
        for file, row in piece.rows:
            self.row(file, row)
        self.left_out += piece.left_out

    def _put(self, name: str, content: bytes) -> None:
        file = self._path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)

    def close(self, facts: Mapping[str, Any]) -> dict[str, Any]:
        """Write the manifest, and return it: a folder without one is not finished."""
        manifest = {
            "format": "cell.training_data",
            "version": VERSION,
            "made_by": self._source,
            **facts,
            **({"left_out_seeds": self.left_out} if self.left_out else {}),
            "counts": dict(sorted(self.counts.items())),
        }
        (self._path / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
        return manifest


class DataPiece(DataFolder):
    """Keeps what is written, to be added to a folder elsewhere."""

    def __init__(self) -> None:
        self.images: list[tuple[str, bytes]] = []
        self.rows: list[tuple[str, Mapping[str, Any]]] = []
        self.left_out: list[int] = []

    def row(self, file: str, row: Mapping[str, Any]) -> None:
        self.rows.append((file, row))

    def _put(self, name: str, content: bytes) -> None:
        self.images.append((name, content))
