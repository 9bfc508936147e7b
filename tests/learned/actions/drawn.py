"""A small folder of training data without a simulator: hands that go to a hole, or stay away, over drawn crops."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.learned.actions.segments import holes_on_bench
from bracket_ground.interfaces.hand_window import FRAME_PX, window_px
from bracket_ground.interfaces.perception import SEGMENT_FRAMES

CONFIGURATION = load_configuration()
BENCH, PRODUCT = CONFIGURATION.bench, load_product(CONFIGURATION)
HOLES_M = holes_on_bench(BENCH, PRODUCT)
COLOURS = {"o1": (20, 20, 200), "o2": (190, 60, 20), "o3": (40, 130, 25)}


def write_folder(path: Path, count: int, seed: int, key: str = "truth", *, whole: bool = False) -> Path:
    """Segments of every assembly and of hands that stay away; `key` "detected" writes them as a log gives them.

    Args:
        whole: each sees whole frames, too, all of them the same one.
    """
    rng = np.random.default_rng(seed)
    (path / "crops").mkdir(parents=True)
    seen = {"frames": ["whole.jpg"] * 15} if whole else {}
    cv2.imwrite(str(path / "whole.jpg"), np.full((*FRAME_PX[::-1], 3), 70, np.uint8))
    rows = [seen | _row(path, number, rng, key) for number in range(count)]
    lines = [{"format": "cell.segments", "version": 1, "source": "test"}, *rows]
    (path / "segments.jsonl").write_text("\n".join(json.dumps(line) for line in lines) + "\n")
    return path


def _row(path: Path, number: int, rng: np.random.Generator, key: str) -> dict[str, Any]:
    placing = bool(rng.random() < 0.7)
    part, at = str(rng.choice(list(PRODUCT.parts))), int(rng.integers(len(PRODUCT.positions)))
    end = HOLES_M[at] if placing else HOLES_M[at] + np.array([0.3, 0.0])
    tips = np.linspace(end + np.array([0.25, 0.05]), end, SEGMENT_FRAMES) + rng.normal(0, 0.002, (SEGMENT_FRAMES, 2))
    side = window_px(BENCH.overhead)
    image = np.full((side, side, 3), 70, np.uint8)
    if placing:
        cv2.circle(image, (side // 2, side // 2), 14, COLOURS[part], -1)
    name = f"crops/{number:04d}.png"
    cv2.imwrite(str(path / name), image)
    label = {"kind": "assembly" if placing else "transit"}
    label |= {"part": part, "position": PRODUCT.positions[at]} if placing else {"part": None, "position": None}  # type: ignore[dict-item]
    hands = [
        {"time_s": index / 15, "box_px": [0, 0, 9, 9], "fingertips_m": [x, y], "palm_m": [x + 0.1, y]}
        for index, (x, y) in enumerate(tips)
    ]
    crops = {"hand_crop": name, "hole_crop": name if placing else None}
    row = {"log": f"seed{number // 10}", "frame": number, **crops, "hands": hands}
    if key == "truth":
        return row | {"truth": {**label, "released": number % 2 == 0}, "guarded": False}
    seen = {"part": part if number % 4 else None, "position": PRODUCT.positions[at], "agrees": number % 4 != 0}
    confirmed = seen if placing and number % 8 else None
    return row | {"detected": {**label, "confidence": 0.9, "finished": placing}, "confirmed": confirmed}
