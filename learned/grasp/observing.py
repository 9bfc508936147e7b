"""Detecting the same scenes again with other noise, so that a planner learns what noise does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from learned.grasp.scenes import Scene, observe
from learned.grasp.settings import DetectionNoise
from learned.grasp.training_settings import TrainingSettings

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
