"""Settings of motions, for one robot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar

from pydantic import Field, PrivateAttr

from bracket_ground.files.model import Model
from bracket_ground.interfaces.gripper import Gripper
from bracket_ground.interfaces.perception import Edge
from bracket_ground.interfaces.robot import RobotModel, default_robot

Measured = Annotated[float, Field(ge=0, le=10)]
Braking = Annotated[float, Field(gt=0, le=1000)]
LEAST_BRAKING = 0.5  # share of the joints' acceleration with which they brake at least


LEAST_TICK_S = 0.04  # a faster loop is judged as one of 25 Hz: what else takes time does not get faster
AT_LEAST = (  # as shipped, or it is unsafe
    *("hand_speed_m_s", "reaction_s", "hand_error_m", "intrusion_m", "hysteresis_m"),
)
AT_MOST = ("slow_m_s", "leaving_m_s")


class SeparationLimits:
    """What separation reckons with in every cell. Origin: ISO 13855 and ISO 10218-1; braking and trailing as measured.

    Attributes:
        hand_acceleration_m_s2: [m/s2] with which a slow hand becomes fast.
        speed_error_m_s: [m/s] by which a hand's measured speed may be off.
        braking_m_s2: [m/s2] with which the arm's fastest point slows down from the slow speed, as measured.
        hand_radius_m: [m] half the width of hand and forearm.
        forearm_m: [m] length of a forearm that is not seen, behind the palm.
        blind_share: largest share of speed if the tool works outside the view.
        arm_cycle_s: [s] of a CB3 controller; an e-series has 0.002 s.
        trailing_s: [s] by which joints trail their set points at least (docs/simulation.md).
        hand_height_m: [m] over the bench that hand and forearm may be, where a tracker does not tell.
        assumed_height_m: [m] for which a tracker that does not tell heights works out positions.
    """

    hand_acceleration_m_s2: ClassVar[float] = 12.0
    speed_error_m_s: ClassVar[float] = 0.1
    braking_m_s2: ClassVar[float] = 1.6
    hand_radius_m: ClassVar[float] = 0.06
    forearm_m: ClassVar[float] = 0.35
    blind_share: ClassVar[float] = 0.3
    arm_cycle_s: ClassVar[float] = 0.008
    trailing_s: ClassVar[float] = 0.030
    hand_height_m: ClassVar[float] = 0.30
    assumed_height_m: ClassVar[float] = 0.10


class SeparationSettings(SeparationLimits, Model):
    """Distance and speed of the arm beside a person; not safety-rated: `cell docs safety` has what is left out.

    Attributes:
        hand_speed_m_s: how fast a hand may become that is slow now, and v_h of a hand whose speed is not measured.
        slow_m_s: reduced speed of the arm near a person (at most 0.25 m/s in ISO 10218-1). No limit of force: a contact
            at this speed may hurt.
        clamp_n: force at most on a hand between the arm and what stands on the bench (ISO/TS 15066: 140 N): such a gap
            closes no faster than the robot's masses allow for it, 0.129 m/s for a UR10; without it at slow_m_s.
        leaving_m_s: speed at which an arm that is too near may follow a path away from the hand; 0: it stands.
        reaction_s: from an answer of the detectors to the first braking: a period of `controller.tick_hz`, the arm's
            cycle, and what joints trail; worked out where it is left out, 0.078 s at 25 Hz and faster.
        hand_error_m: Z_d, how far a tracked hand may be off: 95 % of the errors on the tracker's model card where that
            is more than this; of a tracker without a card, 0.06 m. A hand whose deviation is larger is farther off.
        intrusion_m: C, how far a hand may be over the edge of the view before the tracker finds it: half a hand, as the
            card counts a hand that shows less as one that need not be found. It is 0 for a hand that is seen.
        open_edges: of the overhead image, over which more people may come at any time, as nothing stands there; the
            person's own always counts.
        people: at the bench, each with two hands: as long as fewer are seen, others may come over the person's edge.
        hysteresis_m: how much farther than where the arm was held a hand must be for it to go on.
    """

    moved: ClassVar[Mapping[str, str]] = {
        "margin_m": "hand_error_m says how far a hand may be off; the arm's part follows"
    }
    hand_speed_m_s: float = Field(default=1.6, gt=0, le=5)
    slow_m_s: float = Field(default=0.248, gt=0, le=0.5)
    clamp_n: float | None = Field(default=None, gt=0, le=1000)
    leaving_m_s: float = Field(default=0.1, ge=0, le=0.25)
    reaction_s: float = Field(default=0.078, ge=0, le=1)
    hand_error_m: float = Field(default=0.025, ge=0, le=0.5)
    intrusion_m: float = Field(default=0.10, ge=0, le=0.5)
    hysteresis_m: float = Field(default=0.03, ge=0, le=0.5)
    open_edges: tuple[Edge, ...] = ()
    people: int = Field(default=1, ge=1, le=4)

    def reacting(self, tick_s: float, trailing_s: float) -> SeparationSettings:
        """The same with the reaction that a control loop and an arm have, where none was chosen.

        Args:
            tick_s: period of the loop.
            trailing_s: by how much the arm's joints trail their set points.
        """
        if "reaction_s" in self.model_fields_set:
            return self
        return self.model_copy(update={"reaction_s": self.least_reaction_s(tick_s, trailing_s)})

    def least_reaction_s(self, tick_s: float, trailing_s: float) -> float:
        """The shortest time from an answer to the first braking; see `reacting`."""
        return max(tick_s, LEAST_TICK_S) + self.arm_cycle_s + max(trailing_s, self.trailing_s)

    def weaker(self, least_reaction_s: float) -> list[str]:
        """Which values keep the arm less far from the person than the shipped ones do."""
        shipped = {name: field.default for name, field in type(self).model_fields.items()}
        shipped["reaction_s"] = round(least_reaction_s, 6)
        less = [(name, "less") for name in AT_LEAST if getattr(self, name) < shipped[name]]
        more = [(name, "more") for name in AT_MOST if getattr(self, name) > shipped[name]]
        return [
            f"motion.separation.{name} {getattr(self, name):g} is {how} than {shipped[name]:g}"
            + ", which controller.tick_hz and the arm need: leave it out" * (name == "reaction_s")
            for name, how in (*less, *more)
        ]


class Stopping(Model):
    """How this arm stops, as `cell setup teach stop` measured it: a number for each joint, from the order to hold on.

    Attributes:
        reacts_s: until the joint begins to brake.
        stops_s: until it stands.
        over_rad: how far it goes until then.
        brakes_rad_s2: how it slows down in between.
    """

    reacts_s: tuple[Measured, ...] = ()
    stops_s: tuple[Measured, ...] = ()
    over_rad: tuple[Measured, ...] = ()
    brakes_rad_s2: tuple[Braking, ...] = ()

    def weaker(self, accelerations_rad_s2: tuple[float, ...], joints: tuple[str, ...]) -> list[str]:
        """What of it is worse than separation reckons with, or is not known of each joint.

        Args:
            accelerations_rad_s2: of the robot file, for each joint.
        """
        values = self.model_dump().items()
        if not any(numbers for _, numbers in values):
            return []
        short = [name for name, numbers in values if len(numbers) != len(joints)]
        if short:
            return [f"motion.stopping.{name} has not {len(joints)} numbers, one a joint: teach it" for name in short]
        rows = zip(joints, self.brakes_rad_s2, accelerations_rad_s2, strict=True)
        return [
            f"motion.stopping: {joint} brakes with {brakes:g}, less than {LEAST_BRAKING:g} of the robot file's "
            f"acceleration_rad_s2 {limit:g}: lower it there"
            for joint, brakes, limit in rows
            if not brakes >= LEAST_BRAKING * limit
        ]


class MotionLimits:
    """How near the arm comes to things, and how it handles them. Origin: chosen, and tried in simulation.

    Attributes:
        sample_s: [s] between samples of a trajectory, the arm's own control period.
        line_acceleration_m_s2: [m/s2] of the tool on straight lines.
        line_jerk_m_s3: [m/s3] of the tool on straight lines.
        fingertip_clearance_m: [m] of fingertips above a body's bottom: they clear the bracket.
        finger_clearance_m: [m] between each finger and the body before closing.
        least_finger_clearance_m: [m] the same if a neighbour stands too close for that.
        finger_margin_m: [m] at least between fingers that come down and a neighbour.
        least_finger_margin_m: [m] the same if a neighbour stands too close for that.
        close_speed_m_s: [m/s] of fingers that come down so close: the arm strays .5 mm off its line.
        passing_gap_m: [m] below the fingertips at which something is out of their way.
        approach_gap_m: [m] by which fingertips pass above what stands below them before a descent.
        carry_gap_m: [m] by which the peg of a carried part passes above placed parts.
        insertion_speed_m_s: [m/s] of a peg that is lowered into its hole.
        insertion_start_m: [m] above the hole at which slow lowering begins.
        contact_lag_m: [m] above where it should be by then at which a tool has met something.
        search_shifts_m: [m] where a peg that met the rim is tried again, along the sides that the fingers hold; from
            one finger to the other they have centred the part.
        release_gap_m: [m] above what it will stand on at which a part is let go.
        part_gap_m: [m] at least between a part that is moved aside and its new neighbours.
        rim_gap_m: [m] at least between a part that is moved aside and the tray's rim.
        servo_lag_s: [s] by which the arm trails its trajectory at most.
        collision_margin_m: [m] at least to what stands still.
        gripper_speed_m_s: [m/s] of the fingers.
        gripper_timeout_s: [s] that one motion of the fingers may take.
        arm_timeout_s: [s] longer than its trajectory that a motion of the arm may take.
        arrival_tolerance_rad: [rad] to its goal at which every joint has arrived once the arm stands.
    """

    sample_s: ClassVar[float] = 0.008
    line_acceleration_m_s2: ClassVar[float] = 1.6
    line_jerk_m_s3: ClassVar[float] = 20.0
    fingertip_clearance_m: ClassVar[float] = 0.003
    finger_clearance_m: ClassVar[float] = 0.006
    least_finger_clearance_m: ClassVar[float] = 0.003
    finger_margin_m: ClassVar[float] = 0.002
    least_finger_margin_m: ClassVar[float] = 0.001
    close_speed_m_s: ClassVar[float] = 0.08
    passing_gap_m: ClassVar[float] = 0.002
    approach_gap_m: ClassVar[float] = 0.015
    carry_gap_m: ClassVar[float] = 0.020
    insertion_speed_m_s: ClassVar[float] = 0.08
    insertion_start_m: ClassVar[float] = 0.002
    contact_lag_m: ClassVar[float] = 0.002
    search_shifts_m: ClassVar[tuple[float, ...]] = (0.0035, -0.0035, 0.007, -0.007, 0.0105, -0.0105)
    release_gap_m: ClassVar[float] = 0.0015
    part_gap_m: ClassVar[float] = 0.030
    rim_gap_m: ClassVar[float] = 0.030
    servo_lag_s: ClassVar[float] = 0.016
    collision_margin_m: ClassVar[float] = 0.004
    gripper_speed_m_s: ClassVar[float] = 0.15
    gripper_timeout_s: ClassVar[float] = 2.5
    arm_timeout_s: ClassVar[float] = 1.5
    arrival_tolerance_rad: ClassVar[float] = 0.004


class MotionSettings(MotionLimits, Model):
    """How the arm and the gripper move; what the arm can do at most, its robot file says.

    Attributes:
        line_speed_m_s: speed of the tool on straight lines.
        grasp_depth_m: fingertips reach this far below a body's top: the pads' length, for a full grip that still passes
            over lower neighbours.
        grip_force_n: force of the fingers.
        speed_share: of its speed, that the arm never exceeds; `cell run --share` for one run.
        separation: how far the arm keeps from the person, and how slow it is for that.
        stopping: how the arm stops, as measured: a slower reaction than reckoned counts.
    """

    moved: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(
            ("speed_limits_rad_s", "acceleration_limits_rad_s2", "jerk_limits_rad_s3"),
            "the robot file has limits: robot: FILE",
        ),
        **dict.fromkeys(("tcp_from_tool0_m", "fingertip_beyond_tcp_m"), "the gripper's file has it: gripper: FILE"),
        "collision_step_rad": "nothing: ways are checked by how far points of the arm go",
    }
    line_speed_m_s: float = Field(default=0.40, gt=0, le=1.5)

    grasp_depth_m: float = Field(default=0.022, gt=0, le=1)

    grip_force_n: float = Field(default=60.0, ge=20, le=235)
    speed_share: float = Field(default=1.0, ge=0.02, le=1)
    separation: SeparationSettings = SeparationSettings()
    stopping: Stopping = Stopping()
    _robot: RobotModel = PrivateAttr(default_factory=default_robot)
    _tick_s: float = PrivateAttr(default=LEAST_TICK_S)
    _configured_share: float | None = PrivateAttr(default=None)

    def of(self, robot: RobotModel, tick_s: float = LEAST_TICK_S, trailing_s: float = 0.0) -> MotionSettings:
        """The same for another robot than the default, and another control loop than one of 25 Hz.

        Args:
            tick_s: period of the loop.
            trailing_s: by how much the arm's joints trail their set points, as its driver says.
        """
        settings = self.model_copy(update={"separation": self.separation.reacting(tick_s, trailing_s)})
        settings._robot, settings._tick_s = robot, max(tick_s, LEAST_TICK_S)
        return settings

    @property
    def tick_s(self) -> float:
        """Period of the control loop, at least that of 25 Hz."""
        return self._tick_s

    def slowed(self, share: float) -> MotionSettings:
        """The same for a run that is to go no faster than a share of the speed; the configured one stays the limit."""
        settings = self.model_copy(update={"speed_share": min(share, self.speed_share)})
        settings._configured_share = self.configured_share
        return settings

    @property
    def configured_share(self) -> float:
        """The share of its speed that the arm never exceeds in any run."""
        return self._configured_share or self.speed_share

    @property
    def robot(self) -> RobotModel:
        """What moves."""
        return self._robot

    @property
    def gripper(self) -> Gripper:
        """What hangs on its flange."""
        return self._robot.gripper

    @property
    def speed_limits_rad_s(self) -> tuple[float, ...]:
        """Of planned motions, for each joint."""
        return self._robot.speed_rad_s

    @property
    def acceleration_limits_rad_s2(self) -> tuple[float, ...]:
        """Of planned motions, for each joint."""
        return self._robot.acceleration_rad_s2

    @property
    def jerk_limits_rad_s3(self) -> tuple[float, ...]:
        """Of planned motions, for each joint."""
        return self._robot.jerk_rad_s3
