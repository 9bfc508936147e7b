"""The simulated cell: built from product and bench through MjSpec, stepped by the clock, read by the devices."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from bracket_ground.interfaces.bench import Bench, CameraSetup
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.robot import RobotModel, default_robot
from bracket_sim.scene.body import add_onlooker, fit_hand
from bracket_sim.scene.clutter_objects import add_things
from bracket_sim.scene.furniture import add_furniture, add_lights, fit_shadows, set_physics
from bracket_sim.scene.grippers import LIP_POINTS, add_gripper
from bracket_sim.scene.human_skin import Fingers
from bracket_sim.scene.lens import Lens
from bracket_sim.scene.look import NOMINAL, Camera, Look, MountError
from bracket_sim.scene.parts import Owner, ScenePart, add_part, add_unknown_object, simplify_cylinders
from bracket_sim.scene.robot import arm_spec
from bracket_sim.scene.settings import PhysicsSettings
from bracket_sim.scene.storage import Bin, own_bins, person_set
from bracket_sim.scene.wholes import add_welds, weld_name

# MuJoCo's cameras look along -z with y up; ours along z with y down.
CAMERA_FROM_MUJOCO = Pose((0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))
LONGEST_FALL_S = 4.0
# Constraints with which the Jacobian is dense: where it is sparse, MuJoCo's Newton method fails at times, and throws
# things about. More of them (whole trays in one place, before anything moves) need the memory.
DENSE_ROWS = 2000
DIVERGED = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
KEEPS_M_S, SLIPS_M = 2e-3, 3e-4  # how fast a held part is brought back, and how far off it has slipped
REST = np.array([0.002] * 3 + [0.05] * 3)  # m/s and rad/s of a part that does not move


@dataclass(eq=False)
class WorldPart:
    """A part in the compiled world.

    Attributes:
        name: of its body, for example "o1_robot_0".
        part: its type; that of a sub-assembly from when it was built on this body.
        owner: whose set it belongs to.
        body, qpos, qvel: body id and first indices of its free joint.
    """

    name: str
    part: str
    owner: Owner
    body: int
    qpos: int
    qvel: int


class World:
    """A compiled cell and its state.

    Attributes:
        look: what it looks like; neither physics nor controller know it.
        robot: the arm.
        parts: type of every part by the name of its body, in the order of the scene.
        bodies: the same parts with their places in the state, and objects of no type.
        carriers: of parts that were joined to a sub-assembly the lowest one, by the number of their body.
        arm_qpos, arm_qvel, arm_ctrl: indices of the joints, from the base to the flange.
        holding: bodies of the fingers, or of the cup.
        diverged: the physics came to no finite state, and MuJoCo put everything back to the beginning.
    """

    def __init__(
        self,
        spec: mujoco.MjSpec,
        product: Product,
        bench: Bench,
        scene: Sequence[ScenePart],
        physics: PhysicsSettings,
        look: Look,
        robot: RobotModel,
    ) -> None:
        self.product, self.bench, self.physics, self.look, self.robot = product, bench, physics, look, robot
        self.diverged = False
        self.model: mujoco.MjModel = spec.compile()
        fit_shadows(self.model)
        self.data = mujoco.MjData(self.model)
        names = part_names(scene)
        self.bodies = tuple(self._world_part(name, entry) for name, entry in zip(names, scene, strict=True))
        self.parts = {body.name: body.part for body in self.bodies if body.part in product.parts}
        self.carriers: dict[int, WorldPart] = {}
        self._joined: dict[WorldPart, tuple[str, list[WorldPart]]] = {}  # the lowest's own type, and what is on it
        joints = [self.model.joint(name) for name in robot.joint_names]
        self.arm_qpos = np.array([joint.qposadr[0] for joint in joints])
        self.arm_qvel = np.array([joint.dofadr[0] for joint in joints])
        self.arm_ctrl = np.array([self.model.actuator(name).id for name in robot.joint_names])
        fingers = [f"finger_{side}" for side in ("left", "right")] if robot.gripper.fingers else []
        self._fingers = [int(self.model.joint(name).qposadr[0]) for name in fingers]
        self._grip: tuple[WorldPart, Array] | None = None  # what is held, and where in the tool's frame
        self.holding = [self.model.body(name).id for name in fingers or ["finger_cup"] * bool(robot.gripper.switched)]
        self._steps_per_sample = physics.steps_per_sample
        self._opening_ctrl = self.model.actuator("opening").id if fingers else None
        self._suction = self.model.actuator("suction").id if robot.gripper.switched else None
        self._tool = self.model.body("tool").id
        self._hand = Fingers(self.model)
        self.set_arm(bench.arm_park_rad)
        self.set_opening(robot.gripper.stroke_m)
        mujoco.mj_forward(self.model, self.data)

    def _world_part(self, name: str, entry: ScenePart) -> WorldPart:
        joint = self.model.joint(name)
        return WorldPart(
            name, entry.part, entry.owner, self.model.body(name).id, int(joint.qposadr[0]), int(joint.dofadr[0])
        )

    @property
    def time_s(self) -> float:
        """Physics time since the world was built."""
        return float(self.data.time)

    @property
    def opening_m(self) -> float:
        """Distance between the gripper's pads; 0 of a cup that sucks."""
        if self._suction is not None:
            return 0.0 if self.data.ctrl[self._suction] > 0 else self.robot.gripper.stroke_m
        return float(sum(self.data.qpos[self._fingers]))

    @property
    def sealed(self) -> bool:
        """Whether a cup's lip, or a magnet's pole, lies on something all around that it can pull."""
        geoms = self.data.contact.geom
        cup = self.holding[0]
        touching = geoms[(self.model.geom_bodyid[geoms] == cup).any(axis=1)]
        touched = self.model.geom_bodyid[touching]
        pulled = self.robot.gripper.magnet is None or self._magnetic(set(touched[touched != cup].tolist()))
        return pulled and len(set(touching[touched == cup].tolist())) >= LIP_POINTS

    def _magnetic(self, touched: set[int]) -> bool:
        kinds = self.product.parts
        return touched <= {body.body for body in self.bodies if body.part in kinds and kinds[body.part].magnetic}

    def suck(self, share: float) -> None:
        """Let a share of the most pull act."""
        self.data.ctrl[self._suction] = share

    def step_period(self) -> None:
        """Advance by one control period."""
        self._step(self.physics.steps_per_period)

    def step_sample(self) -> None:
        """Advance by one period in which the arm measures its joints once; several make a control period."""
        self._step(self._steps_per_sample)

    def _step(self, count: int) -> None:
        dense = self.data.nefc < DENSE_ROWS
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE if dense else mujoco.mjtJacobian.mjJAC_SPARSE
        mujoco.mj_step(self.model, self.data, count)
        self._keep_grip(count * self.physics.step_s)
        warnings = self.data.warning
        self.diverged = self.diverged or any(warnings[kind].number for kind in DIVERGED)

    def _keep_grip(self, dt_s: float) -> None:
        """Rubber keeps places where MuJoCo's friction keeps speeds: what is held would creep by 0.1 mm a move.

        It is brought back towards where it was gripped, so slowly that what is pulled or pushed slips all the same.
        """
        part = self.held()
        if part is None:
            self._grip = None
            return
        data, turned = self.data, self.data.xmat[self._tool].reshape(3, 3)
        away_m = data.xpos[part.body] - data.xpos[self._tool]
        if self._grip is None or self._grip[0] is not part:
            self._grip = part, turned.T @ away_m
        missing_m = turned @ self._grip[1] - away_m
        if (missing := float(np.linalg.norm(missing_m))) > SLIPS_M:
            self._grip = part, turned.T @ away_m
        elif missing > 0.0:
            data.qpos[part.qpos : part.qpos + 3] += min(1.0, KEEPS_M_S * dt_s / missing) * missing_m

    def held(self) -> WorldPart | None:
        """The part that both fingers touch, or the cup that sucks, if there is one."""
        if not self.data.ncon or (self._suction is not None and not self.data.ctrl[self._suction] > 0):
            return None
        pairs = self.model.geom_bodyid[self.data.contact.geom]
        touched = [set(pairs[(pairs == finger).any(axis=1)].ravel().tolist()) for finger in self.holding]
        touched = [found | {self.carriers[body].body for body in found & self.carriers.keys()} for found in touched]
        return next((part for part in self.bodies if touched and all(part.body in bodies for bodies in touched)), None)

    def join(self, stack: Sequence[WorldPart], whole: str) -> None:
        """Weld parts, the lowest first, to one body of a type of its own."""
        low, *upper = stack
        for part in upper:
            weld = self.model.equality(weld_name(low.name, part.name)).id
            off = self.part_pose(low).inverse() @ self.part_pose(part)
            self.model.eq_data[weld, :10] = (0.0, 0.0, 0.0, *off.position_m, *off.quaternion_wxyz)
            self.data.eq_active[weld] = 1
            self.carriers[part.body] = low
            del self.parts[part.name]
        self.bodies = tuple(body for body in self.bodies if body not in upper)
        own, before = self._joined.get(low, (low.part, []))
        self._joined[low] = own, [*before, *upper]
        low.part = self.parts[low.name] = whole

    def split(self, low: WorldPart) -> list[WorldPart]:
        """Take a sub-assembly apart; the parts that stood on the lowest one, if there were any."""
        low.part, upper = self._joined.pop(low, (low.part, []))
        for part in upper:
            self.data.eq_active[self.model.equality(weld_name(low.name, part.name)).id] = 0
            del self.carriers[part.body]
            self.parts[part.name] = part.part
        self.bodies += tuple(upper)
        if upper:
            self.parts[low.name] = low.part
        return upper

    def settle(self) -> None:
        """Let parts come to rest while the arm stands: for the time that is set, longer where some still move.

        From then on, what rests may sleep until it is touched: its contacts, most of the work, are not computed.
        """
        periods = math.ceil(self.physics.settle_s / self.physics.control_period_s)
        longest = periods + math.ceil(LONGEST_FALL_S / self.physics.control_period_s)
        for number in range(longest):
            if number >= periods and self._rest():
                break
            self.step_period()
        if self.physics.sleep:
            self.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP

    def _rest(self) -> bool:
        """Whether no part moves."""
        speeds = np.array([self.data.qvel[body.qvel : body.qvel + 6] for body in self.bodies]).reshape(-1, 6)
        return bool(np.all(np.abs(speeds) < REST))

    def body_pose(self, body: int) -> Pose:
        """world_from_body of any body by its id."""
        x, y, z = (float(value) for value in self.data.xpos[body])
        w, a, b, c = (float(value) for value in self.data.xquat[body])
        return Pose((x, y, z), (w, a, b, c))

    def tool_pose(self) -> Pose:
        """world_from_tool: the TCP between the fingertips, z along the fingers."""
        return self.body_pose(self._tool)

    def part_pose(self, part: WorldPart) -> Pose:
        """world_from_part."""
        return self.body_pose(part.body)

    def place(self, part: WorldPart, pose: Pose) -> None:
        """Put a part somewhere at rest, for building scenes."""
        self.put(part, pose)
        mujoco.mj_forward(self.model, self.data)

    def set_arm(self, positions_rad: Sequence[float] | Array) -> None:
        """Put the arm's joints somewhere at rest, for building scenes; a running SimArm does not expect it."""
        self.put_arm(positions_rad)
        mujoco.mj_forward(self.model, self.data)

    def put(self, part: WorldPart, pose: Pose) -> None:
        """As `place`, but no pose follows from it before `update_poses`."""
        self.data.qpos[part.qpos : part.qpos + 7] = (*pose.position_m, *pose.quaternion_wxyz)
        self.data.qvel[part.qvel : part.qvel + 6] = 0.0

    def put_arm(self, positions_rad: Sequence[float] | Array) -> None:
        """As `set_arm`, but no pose follows from it before `update_poses`."""
        self.data.qpos[self.arm_qpos] = positions_rad
        self.data.qvel[self.arm_qvel] = 0.0
        self.data.ctrl[self.arm_ctrl] = positions_rad

    def arm_touches(self) -> bool:
        """Whether arm or gripper touch anything where they are now."""
        mujoco.mj_forward(self.model, self.data)
        roots = self.model.body_rootid[self.model.geom_bodyid[self.data.contact.geom]]
        return bool((roots == self.model.body_rootid[self._tool]).any())

    def update_poses(self) -> None:
        """Of bodies, cameras and lights, by the joints; contacts and forces, which take ten times as long, stay."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def pose_hand(self) -> None:
        """Put what is seen of a human hand where its digits ask for: cameras look after this, it has no physics."""
        self._hand.pose(self.data)

    def set_opening(self, opening_m: float) -> None:
        """Put the fingers somewhere at rest, for building scenes."""
        if self._opening_ctrl is not None:
            self.data.qpos[self._fingers] = opening_m / 2
        self.drive_opening(opening_m)

    def drive_opening(self, set_point_m: float) -> None:
        """Set point of the jaw's servo; below what it holds, the difference is the force."""
        if self._opening_ctrl is not None:
            self.data.ctrl[self._opening_ctrl] = set_point_m

    def camera_pose(self, camera: str) -> Pose:
        """world_from_camera of "overhead" or "wrist", as the controller believes it."""
        if camera == "wrist":
            return self.tool_pose() @ self.bench.wrist.mount.pose
        return self.bench.overhead.mount.pose


def build_world(
    product: Product,
    bench: Bench,
    scene: Sequence[ScenePart] | None = None,
    physics: PhysicsSettings | None = None,
    extend: Callable[[mujoco.MjSpec], None] | None = None,
    look: Look = NOMINAL,
    bins: Sequence[Bin] | None = None,
    robot: RobotModel | None = None,
) -> World:
    """Build a cell.

    Args:
        scene: all parts and where they start; by default the person's own set in the bins and nothing in the tray.
        extend: adds more to the specification before it is compiled, for example the person's hand.
        look: light, colours, things lying about, and where the cameras really hang.
        bins: the person's; by default one for each type, where the bench file says.
        robot: the arm; the shipped default where none is given.
    """
    physics = physics or PhysicsSettings()
    scene = person_set(product, bench) if scene is None else scene
    robot = robot or default_robot()
    spec = arm_spec(robot)
    set_physics(spec, physics)
    _set_drawing(spec)
    add_gripper(spec, bench.wrist, robot.gripper)
    add_furniture(spec, product, bench, own_bins(product, bench) if bins is None else bins, look.surfaces)
    if any(solid.solid == "hull" for kind in product.parts.values() for solid in kind.shape):
        spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_MULTICCD)  # a hull on one point would wobble
    kinds = list(product.parts)
    for name, entry in zip(part_names(scene), scene, strict=True):
        if entry.foreign is not None:
            add_unknown_object(spec, name, entry, entry.foreign)
            continue
        kind = product.parts[entry.part]
        kind = kind.model_copy(update={"colour_rgb": look.surfaces.painted(kind.colour_rgb)})
        add_part(spec, name, entry, kind, kinds.index(entry.part))
    add_welds(spec, product, dict(zip(part_names(scene), scene, strict=True)))
    _add_camera(spec.worldbody, "overhead", bench.overhead, look.mounts.overhead, look.camera)
    _add_camera(spec.body("tool"), "wrist", bench.wrist, look.mounts.wrist, look.camera)
    add_lights(spec, look.light)
    add_things(spec, product, bench, look.things)
    add_onlooker(spec, bench, look.person)
    if extend is not None:
        extend(spec)
    fit_hand(spec, look.person)
    simplify_cylinders(spec)
    return World(spec, product, bench, scene, physics, look, robot)


def part_names(scene: Sequence[ScenePart]) -> list[str]:
    """Names of the parts' bodies: type, owner and a number, in the order of the scene."""
    counts: dict[str, int] = {}
    names = []
    for entry in scene:
        stem = f"{entry.part}_{entry.owner}"
        names.append(f"{stem}_{counts.setdefault(stem, 0)}")
        counts[stem] += 1
    return names


def _set_drawing(spec: mujoco.MjSpec) -> None:
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1920, 1080
    # MuJoCo shifts shadows by a share of zfar: with 20, dots of shadow lie on bright surfaces.
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 300.0
    # Rendered on a CPU: samples triple the cost of an image, and the many small cylinders of the parts, cut into more
    # rings than one sees at this size, add a third.
    quality = spec.visual.quality
    quality.offsamples = 0
    quality.numslices, quality.numstacks, quality.numquads = 18, 4, 2


def _add_camera(body: mujoco.MjsBody, name: str, setup: CameraSetup, error: MountError, look: Camera) -> None:
    pose = error.apply(setup.mount.pose) @ CAMERA_FROM_MUJOCO
    body.add_camera(
        name=name,
        pos=list(pose.position_m),
        quat=list(pose.quaternion_wxyz),
        fovy=math.degrees(2 * math.atan(setup.height_px / 2 / Lens(setup, look).rendered_focal_px)),
    )
