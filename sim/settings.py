"""Settings of the simulated cell: what a real bench would bring along by itself. Read without a simulator."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from cell.interfaces.model import Model
from sim.hand_motion import MotionSettings


class PhysicsSettings(Model):
    """Time steps of the simulation.

    Attributes:
        step_s: one physics step; a held part drifts by half a step of the arm's turning for each metre travelled.
        control_period_s: the arm's and the gripper's own cycle, a whole number of steps.
        sample_period_s: how often the arm measures its joints, a whole number of steps and a part of its cycle.
        settle_s: how long parts come to rest before the run begins.
    """

    step_s: float = Field(default=0.001, gt=0)
    control_period_s: float = Field(default=0.008, gt=0)
    sample_period_s: float = Field(default=0.002, gt=0)
    settle_s: float = Field(default=0.3, ge=0)

    @model_validator(mode="after")
    def _periods_are_whole(self) -> PhysicsSettings:
        counts = self.sample_period_s / self.step_s, self.control_period_s / self.sample_period_s
        if any(abs(count - round(count)) > 1e-6 or round(count) < 1 for count in counts):
            raise ValueError(
                f"sample_period_s {self.sample_period_s:g} must be a whole number of steps of {self.step_s:g} s "
                f"and go into control_period_s {self.control_period_s:g} without a rest"
            )
        return self

    @property
    def steps_per_sample(self) -> int:
        return round(self.sample_period_s / self.step_s)

    @property
    def steps_per_period(self) -> int:
        return round(self.control_period_s / self.step_s)


class CameraNoise(Model):
    """What a sensor does to an image.

    Attributes:
        gaussian_levels: standard deviation of every pixel's noise, in grey levels of 255.
        brightness_jitter: standard deviation of a whole frame's gain.
        blur_px: standard deviation of the lens's blur, which also softens the renderer's jagged edges.
    """

    gaussian_levels: float = Field(default=2.0, ge=0)
    brightness_jitter: float = Field(default=0.01, ge=0)
    blur_px: float = Field(default=0.6, ge=0)


class ClutterSettings(Model):
    """How parts stand in the tray.

    Attributes:
        neighbour_share: probability that a part stands right beside another one.
        nearest_gap_m: least gap between the bodies of such neighbours.
        farthest_gap_m: largest gap between the bodies of such neighbours.
        rim_margin_m: least distance of a body from the tray's rim.
    """

    neighbour_share: float = Field(default=0.6, ge=0, le=1)
    nearest_gap_m: float = Field(default=0.004, gt=0)
    farthest_gap_m: float = Field(default=0.030, gt=0)
    rim_margin_m: float = Field(default=0.022, ge=0)


class WorkerSettings(Model):
    """Habits of the person.

    Attributes:
        order: in which order open positions are filled: at random, or p1, p2, ...
        screw_probability: how likely it is that a part is screwed after it was placed.
        unscrewed_limit: after this many placements without screwing, the person always screws.
        screw_s: shortest and longest screwing.
        screw_hz: slowest and fastest turning while screwing.
        screw_radius_m: radius of the screwing motion.
        screw_yaw_rad: how far the hand turns while screwing.
        pause_s: shortest and longest reaction before each fetch.
        robot_begins_s: how long the person waits after screwing for the robot to begin.
        robot_stands_s: how long the person watches an arm that stands still away from its parking place.
        retries: how often a part that does not sit well is placed again.
        motion: how the hand moves.
    """

    order: Literal["random", "positions"] = "random"
    screw_probability: float = Field(default=0.6, ge=0, le=1)
    unscrewed_limit: int = Field(default=2, ge=1)
    screw_s: tuple[float, float] = (4.0, 6.0)
    screw_hz: tuple[float, float] = (1.5, 2.0)
    screw_radius_m: float = Field(default=0.008, ge=0, le=0.01)
    screw_yaw_rad: float = Field(default=0.12, ge=0, le=0.2)
    pause_s: tuple[float, float] = (0.1, 0.5)
    robot_begins_s: float = Field(default=2.5, ge=0)
    robot_stands_s: float = Field(default=8.0, ge=0)
    retries: int = Field(default=2, ge=0)
    motion: MotionSettings = MotionSettings()


class SimSettings(Model):
    """The simulated cell.

    Attributes:
        physics: time steps.
        noise: what the cameras add to their images.
        clutter: how parts stand in the tray.
        worker: habits of the simulated person.
    """

    physics: PhysicsSettings = PhysicsSettings()
    noise: CameraNoise = CameraNoise()
    clutter: ClutterSettings = ClutterSettings()
    worker: WorkerSettings = WorkerSettings()
