"""Parts of random sizes, so that what is learned of one product holds for others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from bracket_cell.learned.grasp.settings import DetectionNoise, TrainingSettings
from bracket_ground.interfaces.product import PartType, Product
from bracket_lab.learned.grasp.scenes import Scene, draw_scenes, observe

_NOISE_STREAM = 7  # apart from the streams that scenes are drawn from
_LEAST = 0.05  # of the most noise, where the detector itself has none


def observed_again(scenes: Sequence[Scene], seed: int, settings: TrainingSettings) -> Iterator[Scene]:
    """Every scene `settings.observations` times; the first time as it was detected already."""
    rng = np.random.default_rng([seed, _NOISE_STREAM])
    for scene in scenes:
        yield scene
        for _ in range(settings.observations - 1):
            noise = scene.noise if rng.random() < settings.plain_share else _between(scene.noise, settings, rng)
            yield replace(scene, parts=observe(scene.boxes, rng, noise), noise=noise)


def _between(least: DetectionNoise, settings: TrainingSettings, rng: np.random.Generator) -> DetectionNoise:
    """A level of noise of poses, and one of heights and sizes, or none of these."""
    most = settings.most_noise
    pose, height = rng.random(2)
    exact_heights = rng.random() < 0.5
    return DetectionNoise(
        position_m=_level(least.position_m, most.position_m, pose),
        yaw_rad=_level(least.yaw_rad, most.yaw_rad, pose),
        bottom_m=least.bottom_m if exact_heights else _level(least.bottom_m, most.bottom_m, height),
        size_m=least.size_m if exact_heights else _level(least.size_m, most.size_m, height),
    )


def _level(least: float, most: float, share: float) -> float:
    start = max(least, _LEAST * most)
    return float(start * (most / start) ** share) if start > 0 else 0.0


SCENES_EACH = 20  # drawn of every random set of parts
_SHORTEST_M, _LONGEST_M = np.array([0.025, 0.020, 0.015]), np.array([0.110, 0.079, 0.075])  # length, width, height
_SIZES_STREAM = 11  # apart from the streams that scenes are drawn from


def with_random_parts(product: Product, seed: int, sets: int) -> Product:
    """The product with further part types after its own, as many of each set as it has types itself."""
    rng = np.random.default_rng([seed, _SIZES_STREAM])
    shape = next(iter(product.parts.values()))
    parts = dict(product.parts)
    for number in range(sets):
        for kind in range(len(product.parts)):
            parts[_name(number, kind)] = _random_part(shape, rng)
    return product.model_copy(update={"parts": parts})


def random_scenes(catalogue: Product, types: int, seed: int, count: int, settings: TrainingSettings) -> Iterator[Scene]:
    """Scenes of the train split with the random parts of a catalogue, SCENES_EACH of every set.

    Args:
        types: part types in a set.
    """
    for number in range(-(-count // SCENES_EACH)):
        names = [_name(number, kind) for kind in range(types)]
        some = catalogue.model_copy(update={"parts": {name: catalogue.parts[name] for name in names}})
        wanted = min(SCENES_EACH, count - number * SCENES_EACH)
        yield from draw_scenes(some, seed * 1009 + number + 1, wanted, "train", settings.data, settings.parts)


def _name(number: int, kind: int) -> str:
    return f"random {number}.{kind}"


def _random_part(part: PartType, rng: np.random.Generator) -> PartType:
    length, width, height = rng.uniform(_SHORTEST_M, _LONGEST_M)
    size = (max(length, width), min(length, width), height)
    return part.model_copy(update={"size_m": size, "shape": (), "peg_length_m": float(rng.uniform(0.008, 0.02))})
