"""Fits a part that lies to what stands out from the floor: every side that can be up, every heading, then finer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bracket_cell.learned.parts.lying_scene import Mask, Model, Poses, Scene, Window, about_vertical, middle_of
from bracket_ground.interfaces.bench import Tray
from bracket_ground.interfaces.camera_model import CameraModel
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import PartType

HEADINGS = np.arange(24) * 2 * math.pi / 24
FINER, OTHERS = 6, 3  # coarse answers that are looked at more closely, and such that mean something else
STEPS = ((0.003, 0.12), (0.0015, 0.06), (0.0008, 0.03))  # [m] and [rad]
LATER = (0.1, 0.05, 0.0)  # by which an agreement grows at most after each of them
MOST_MOVES = 4  # of each size
LEAST_AGREEMENT = 0.75
LEAST_LEAD = 0.02  # over the best answer that means something else
OTHERWISE_RAD = math.radians(40)
PEG_WEIGHT = 0.15  # of how well the peg stands out from the body, beside the agreement


@dataclass(frozen=True)
class LyingFit:
    """A part as it lies.

    Attributes:
        part: its type.
        up: the side that is up, as in `bracket_ground.interfaces.resting_pose`.
        world_from_part: its frame.
        agreement: what its silhouette and what stands out have in common, as a share of both together.
    """

    part: str
    up: str
    world_from_part: Pose
    agreement: float


@dataclass(frozen=True)
class _Guess:
    """An answer that is looked for: one pose of a type, with a side up."""

    model: Model
    up: str
    poses: Poses
    agreement: float

    def means(self, other: _Guess) -> bool:
        """Whether both say the same of the type and of where its peg points."""
        cosine = float(self.poses.rotations[0, :, 2] @ other.poses.rotations[0, :, 2])
        return self.model is other.model and cosine > math.cos(OTHERWISE_RAD)


class LyingFitter:
    """Tells how parts lie."""

    def __init__(self, camera: CameraModel, tray: Tray, parts: dict[str, PartType]) -> None:
        self._camera, self._tray = camera, tray
        self._models = {name: Model(name, kind) for name, kind in parts.items()}

    def fit(self, frame: Frame, box_px: Sequence[int], types: Sequence[str], hidden: Mask) -> LyingFit | None:
        """How the part in a box lies, or None where that is not sure.

        Args:
            types: of which it may be.
            hidden: (height, width) of the image, 1 where something else may cover it.
        """
        window = Window.around(frame.image, box_px, hidden)
        if window is None:
            return None
        scene = Scene(self._camera, frame.world_from_camera, window)
        models = [self._models[name] for name in types if name in self._models]
        guesses = _various([guess for model in models for guess in self._coarse(scene, model)])
        guesses = [replace(guess, agreement=scene.agreements(guess.model, guess.poses)[0]) for guess in guesses]
        for step, later in zip(STEPS, LATER, strict=True):
            guesses = _promising([_finer(scene, guess, *step) for guess in guesses], later)
        pegs = [scene.peg_contrast(guess.model, guess.poses, guess.up == "-z") for guess in guesses]
        return _surest([(guess, guess.agreement + PEG_WEIGHT * peg) for guess, peg in zip(guesses, pegs, strict=True)])

    def agreement(self, frame: Frame, box_px: Sequence[int], part: str, world_from_part: Pose, hidden: Mask) -> float:
        """How well a part at some pose agrees with what stands out in a box; 1 where nothing does."""
        window = Window.around(frame.image, box_px, hidden)
        if window is None:
            return 1.0
        scene = Scene(self._camera, frame.world_from_camera, window)
        return scene.agreements(self._models[part], Poses.one(world_from_part))[0]

    def _coarse(self, scene: Scene, model: Model) -> list[_Guess]:
        """The best place for each side and heading; its agreement is that of its silhouette a little aside."""
        floor_m, window = self._tray.centre_m[2], scene.window
        middle = scene.on_floor(window.middle_px[np.newaxis], floor_m)[0]
        turns, guesses = about_vertical(HEADINGS), []
        for up, rest in model.rests:
            poses = Poses(turns @ rest.rotation, turns @ rest.position_m + (*middle, floor_m))
            masks = scene.silhouettes(model, poses)
            off = np.array([window.middle_px - window.corner_px - middle_of(mask) for mask in masks])
            poses.positions_m[:, :2] += scene.on_floor(window.middle_px + off, floor_m) - middle
            for index, mask in enumerate(masks):
                guesses.append(_Guess(model, up, poses.only(index), scene.agreement_there(mask, off[index])))
        return guesses


def _various(guesses: Sequence[_Guess]) -> list[_Guess]:
    """The best ones, and some that mean something else."""
    ordered = sorted(guesses, key=lambda guess: -guess.agreement)
    return ordered[:FINER] + [guess for guess in ordered[FINER:] if not guess.means(ordered[0])][:OTHERS]


def _finer(scene: Scene, guess: _Guess, step_m: float, step_rad: float) -> _Guess:
    """The best pose near another one, by steps of one size."""
    moves: Array = np.concatenate([np.eye(3), -np.eye(3)]) * (step_m, step_m, step_rad)
    for _ in range(MOST_MOVES):
        poses = guess.poses.moved(0, moves[:, :2], moves[:, 2])
        agreements = scene.agreements(guess.model, poses)
        best = int(np.argmax(agreements))
        if agreements[best] <= guess.agreement:
            break
        guess = replace(guess, poses=poses.only(best), agreement=agreements[best])
    return guess


def _promising(guesses: Sequence[_Guess], later: float) -> list[_Guess]:
    """Those that may still be the answer, or make it doubtful; none where even the best one is hopeless.

    Args:
        later: by which finer steps will improve one.
    """
    best = max((guess.agreement for guess in guesses), default=0.0)
    if best + later < LEAST_AGREEMENT:
        return []
    return [guess for guess in guesses if guess.agreement + later + PEG_WEIGHT > best]


def _surest(scored: Sequence[tuple[_Guess, float]]) -> LyingFit | None:
    """The best answer, where no other that means something else is as good."""
    best, score = max(scored, key=lambda pair: pair[1], default=(None, 0.0))
    if best is None or best.agreement < LEAST_AGREEMENT:
        return None
    otherwise = max((score_of for guess, score_of in scored if not guess.means(best)), default=0.0)
    sure = score - otherwise > LEAST_LEAD
    return LyingFit(best.model.part, best.up, best.poses.pose(0), best.agreement) if sure else None
