"""A right hand that pinches parts by friction: palm, fingers and forearm on a gantry of stiff actuators.

Hand frame: origin between the tips of thumb and index finger, fingers pointing along -x, thumb on the -y side.
A mocap body would not carry what it holds (its velocity in contacts is 0), so joints and actuators move the hand.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Array
from bracket_sim.scene import hand as shapes
from bracket_sim.scene import human_skin, palette
from bracket_sim.scene.human_hand import GRASPS, Grasp
from bracket_sim.scene.look import NOMINAL, Appearance
from bracket_sim.scene.person import PERSONS, Person

Segment = tuple[tuple[float, float, float], tuple[float, float, float], float]  # from, to, radius in [m]

PALM_M, PALM_RADII_M = (0.108, 0.037, 0.050), (0.048, 0.043, 0.018)
TIP_RADIUS_M = 0.0075

# Thumb and index finger, written for a closed pinch; each slides outwards along y.
THUMB: tuple[Segment, ...] = (
    ((-0.006, -0.0075, 0.0), (0.012, -0.0075, 0.0), TIP_RADIUS_M),
    ((0.012, -0.0080, 0.001), (0.050, -0.020, 0.020), 0.0090),
    ((0.050, -0.020, 0.020), (0.105, 0.010, 0.042), 0.0120),
)
LONG_THUMB_M = 0.127
INDEX: tuple[Segment, ...] = (
    ((-0.006, 0.0075, 0.0), (0.012, 0.0075, 0.0), TIP_RADIUS_M),
    ((0.012, 0.0078, 0.001), (0.036, 0.012, 0.030), 0.0080),
    ((0.036, 0.012, 0.030), (0.072, 0.010, 0.048), 0.0090),
    ((0.022, 0.0225, 0.006), (0.036, 0.028, 0.032), 0.0075),  # the middle finger, close beside
    ((0.034, 0.028, 0.032), (0.072, 0.032, 0.050), 0.0090),
)
BACK: tuple[Segment, ...] = (
    ((0.076, 0.008, 0.049), (0.090, 0.066, 0.050), 0.0115),  # knuckles
    ((0.085, 0.012, 0.049), (0.135, 0.026, 0.052), 0.0130),  # heel of the thumb
    ((0.068, -0.010, 0.034), (0.100, 0.014, 0.044), 0.0110),  # web of the thumb
    ((0.092, 0.064, 0.050), (0.140, 0.050, 0.053), 0.0120),  # outer edge of the palm
)
CURL_AXIS_M = (0.086, 0.060, 0.051)  # the knuckles that ring and little finger bend at
FINGERS: tuple[Segment, ...] = (
    ((0.046, 0.054, 0.020), (0.052, 0.054, 0.042), 0.0080),  # ring finger
    ((0.052, 0.054, 0.042), (0.082, 0.054, 0.052), 0.0085),
    ((0.062, 0.070, 0.024), (0.066, 0.070, 0.042), 0.0070),  # little finger
    ((0.066, 0.070, 0.042), (0.090, 0.068, 0.050), 0.0075),
)
SLEEVE: Segment = ((0.205, 0.058, 0.072), (0.400, 0.110, 0.140), 0.036)
WRIST: Segment = ((0.135, 0.042, 0.054), (0.205, 0.058, 0.072), 0.027)
CAREFUL = PERSONS["careful"]
SPECULAR = 0.1
PALM_BEHIND_TIPS_M = 0.105  # the rest position of the bench file is that of the palm's middle
MAX_GAP_M = 0.11
DIGIT_RANGE_M = (-0.03, 0.08)  # of thumb and index finger, from closed; beyond it they pull the whole hand along
DIGIT_LIMIT = (0.004, 1.0)  # solref: soft limits would let 150 N stretch a finger by centimetres
# Flesh touches parts, table, bins and bracket (palette.py). Each shape has a hidden twin of the same size that
# touches the robot, as stiff as a person: ISO/TS 15066, Table A.3, gives 75 N/mm for hands and 40 N/mm for forearms.
CONTYPE, CONAFFINITY = 4, 3
HAND_N_M, FOREARM_N_M = 75e3, 40e3
MOVING_MASS_KG = 1.1  # of hand and forearm here; MuJoCo takes stiffness for each kilogram
SKIN_DAMPING = 0.6  # of 2 for critical damping: flesh is soft and dull
FOREARM_GROUP = 2
SKIN_GROUP, FOREARM_SKIN_GROUP = 3, 4  # hidden from the cameras
PUSH_N, TWIST_NM, PINCH_N = 150.0, 8.0, 150.0  # the most that the person's arm, wrist and fingers give
GANTRY = ("hand_x", "hand_y", "hand_z", "hand_yaw")
WRIST_JOINTS = ("hand_tilt", "hand_roll")  # of a person whose wrist does more than turn
CURL_JOINT = "hand_curl"  # of a person whose ring and little finger do not always lie alike
DIGITS = ("hand_thumb", "hand_index")
GANTRY_KP = (8000.0, 8000.0, 8000.0, 80.0)  # N/m and N m/rad: a held part sags by less than 0.5 mm
DIGIT_KP = 2500.0
CURL_KP, CURL_NM = 5.0, 2.0
GRASPS_N, GRASP_SHARE = len(GRASPS), 0.06  # of the way to another grasp that is gone in a control period
CONTROL_FILTER_S = 0.012  # smooths the steps of the 8 ms control period
FLESH_TOUCH = {  # priority 1, so that the skin's own friction counts whatever it holds
    "contype": CONTYPE,
    "conaffinity": CONAFFINITY,
    "condim": 4,
    "friction": (1.2, 0.01, 0.0001),
    "priority": 1,
}
TOUCHES = ("contype", "conaffinity")
FOREARM_TOUCH = {**FLESH_TOUCH, "group": FOREARM_GROUP}
TOOL_AWAY_M = 1.6
TOOL_FRICTION = (0.3, 0.005, 0.0001)  # metal on metal
TOOL = (  # from, to, radius in [m], colour
    ((0.0, 0.0, -0.065), (0.0, 0.0, 0.0), 0.003, (0.5, 0.5, 0.52)),
    ((0.0, 0.0, 0.0), (0.02, 0.0, 0.06), 0.011, (0.75, 0.55, 0.1)),
)


def thumb(length_m: float) -> tuple[Segment, ...]:
    """The thumb; a shorter one ends earlier, and meets the palm there."""
    share = length_m / LONG_THUMB_M
    if share == 1:
        return THUMB
    tip, middle, root = THUMB
    start, knuckle, end = (np.array(point) for point in (middle[0], middle[1], root[1]))
    bent, foot = (tuple(float(x) for x in start + share * (point - start)) for point in (knuckle, end))
    return tip, (middle[0], bent, middle[2]), (bent, foot, root[2])  # type: ignore[return-value]


def add_hand(spec: mujoco.MjSpec, bench: Bench, person: Appearance = NOMINAL.person, habits: Person = CAREFUL) -> None:
    """Add the person's hands to a world that is not yet compiled; with all controls at 0 they rest."""
    _add_one(spec, bench, person, habits)
    for number, other in enumerate(habits.other_hands, 1):
        further = mujoco.MjSpec()
        further.compiler.degree = spec.compiler.degree
        drawn = person.model_copy(update={"hand": "drawn"})
        _add_one(further, bench, drawn, habits.model_copy(update={"rest_m": other.rest_m}), other.turned_rad)
        spec.attach(further, prefix=f"hand{number} ", frame=spec.worldbody.add_frame())


def _add_one(spec: mujoco.MjSpec, bench: Bench, person: Appearance, habits: Person, turned_rad: float = 0.0) -> None:
    rest_m = hand_rest_m(bench, habits, turned_rad)
    hand = spec.worldbody.add_body(name="hand", pos=rest_m, gravcomp=1)
    for name, axis in zip(GANTRY[:3], np.eye(3), strict=True):
        hand.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    hand.add_joint(name="hand_yaw", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1), armature=0.004)
    if habits.grip.tilts:
        for name, axis in zip(WRIST_JOINTS, ((0, -1, 0), (1, 0, 0)), strict=True):
            hand.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis, armature=0.004)
    (_add_human if person.hand == "human" else _add_drawn)(spec, hand, person, habits)
    forces = (PUSH_N,) * 3 + (TWIST_NM, PINCH_N, PINCH_N)
    motors = [*zip(GANTRY + DIGITS, (*GANTRY_KP, DIGIT_KP, DIGIT_KP), forces, strict=True)]
    motors += [(name, GANTRY_KP[3], TWIST_NM) for name in WRIST_JOINTS if habits.grip.tilts]
    motors += [(CURL_JOINT, CURL_KP, CURL_NM)] if habits.grip.curls else []
    for name, kp, most in motors:
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, forcerange=[-most, most])
        motor.set_to_position(kp=kp, dampratio=1.0, timeconst=CONTROL_FILTER_S)
        motor.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
    if habits.screw.tool > 0:
        _add_tool(spec, hand)


def _add_drawn(spec: mujoco.MjSpec, hand: mujoco.MjsBody, person: Appearance, habits: Person) -> None:
    """A hand of few capsules, that are seen and touched."""
    for name, rgb in (("hand_skin", person.hand_rgb), ("hand_sleeve", person.sleeve_rgb)):
        spec.add_material(name=name, rgba=(*rgb, 1.0), specular=SPECULAR, shininess=SPECULAR)
    _add_ellipsoid(hand, shapes.PALM_M, shapes.PALM_RADII_M, mass_kg=0.3)
    for segment in shapes.BACK:
        _add_capsule(hand, segment, mass_kg=0.02)
    fingers = _finger_body(hand, shapes.CURL_AXIS_M, habits.grip.curls)
    for segment in shapes.FINGERS:
        _add_capsule(fingers, segment, mass_kg=0.02)
    _add_capsule(hand, shapes.WRIST, mass_kg=0.2, forearm=True)
    _add_capsule(hand, shapes.SLEEVE, mass_kg=0.2, forearm=True, material="hand_sleeve")
    for digit, segments in zip(_digits(hand), (shapes.thumb(habits.grip.thumb_m), shapes.INDEX), strict=True):
        for segment in segments:
            _add_capsule(digit, segment, mass_kg=0.03)


def _add_human(spec: mujoco.MjSpec, hand: mujoco.MjsBody, person: Appearance, habits: Person) -> None:
    """A human hand: what is seen has no contacts, and hidden capsules about its bones have."""
    human_skin.add_skin(spec, hand, person, human_skin.REST, left=person.left_hand, gloved=person.glove)
    spec.nuserdata = max(spec.nuserdata, human_skin.GRASP_USER)
    spec.add_numeric(name=human_skin.FIT_NUMERIC, size=2, data=[person.hand_size, -1.0 if person.left_hand else 1.0])
    capsules = human_skin.capsules(human_skin.REST)
    digits = dict(zip(("thumb", "index"), _digits(hand), strict=True))
    bodies = {"hand": hand, "fingers": _finger_body(hand, capsules["fingers"][0][0], habits.grip.curls), **digits}
    for name, segments in capsules.items():
        for segment in segments:
            mass_kg, touched = 0.4 / len(segments) if name == "hand" else 0.02, name != "fingers"
            _add_capsule(bodies[name], segment, mass_kg=mass_kg, hidden=True, touched=touched)
    for digit, pad in zip(digits.values(), (THUMB[0], INDEX[0]), strict=True):
        _add_capsule(digit, pad, mass_kg=0.05, hidden=True)
    for segment in human_skin.arm_capsules(human_skin.REST):
        _add_capsule(hand, segment, mass_kg=0.2, forearm=True, hidden=True)


def _digits(hand: mujoco.MjsBody) -> list[mujoco.MjsBody]:
    """Bodies of thumb and index finger, which slide apart."""
    bodies = []
    for name, outwards in zip(DIGITS, (-1, 1), strict=True):
        digit = hand.add_body(name=name, gravcomp=1)
        limits = {"limited": True, "range": DIGIT_RANGE_M, "solref_limit": DIGIT_LIMIT}
        digit.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0, outwards, 0), **limits)
        bodies.append(digit)
    return bodies


def _finger_body(hand: mujoco.MjsBody, knuckles_m: tuple[float, float, float], curls: bool) -> mujoco.MjsBody:
    """Of ring and little finger, on a joint of their own where they bend and stretch."""
    if not curls:
        return hand
    body = hand.add_body(name="hand_fingers", gravcomp=1)
    axis = {"axis": (0, -1, 0), "pos": knuckles_m, "armature": 0.001}
    body.add_joint(name=CURL_JOINT, type=mujoco.mjtJoint.mjJNT_HINGE, **axis)
    return body


def _add_tool(spec: mujoco.MjSpec, hand: mujoco.MjsBody) -> None:
    """A screwdriver; where it is not needed, it is far behind the person, out of every view."""
    tool = hand.add_body(name="hand_tool", pos=(TOOL_AWAY_M, 0, 0), gravcomp=1)
    tool.add_joint(name="hand_tool", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(1, 0, 0), armature=0.01)
    for start, end, radius_m, rgb in TOOL:
        shape = {"type": mujoco.mjtGeom.mjGEOM_CAPSULE, "fromto": (*start, *end), "size": (radius_m, 0, 0)}
        tool.add_geom(**shape, mass=0.0005, rgba=(*rgb, 1.0), **{**FLESH_TOUCH, "friction": TOOL_FRICTION})
        _add_skin(tool, shape, HAND_N_M)
    motor = spec.add_actuator(name="hand_tool", target="hand_tool", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.set_to_position(kp=100.0, dampratio=1.0)


def hand_rest_m(bench: Bench, person: Person = CAREFUL, turned_rad: float = 0.0) -> tuple[float, float, float]:
    """Where the hand frame's origin is when the palm rests."""
    x, y, z = bench.hand_rest_m if person.rest_m is None else person.rest_m
    ahead_m = PALM_BEHIND_TIPS_M
    return x - ahead_m * math.cos(turned_rad), y - ahead_m * math.sin(turned_rad), z


ROBOT_FINGERS, FREE_DOFS = ("finger_left", "finger_right"), 6  # of the robot; a part's own


class Hand:
    """Commands and senses a hand of a compiled world: the first, or one of the further ones by its number."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, number: int = 0) -> None:
        self._data = data
        of = f"hand{number} " if number else ""
        self._human = not number
        touch = np.column_stack([model.geom_contype, model.geom_conaffinity])
        bodies = [model.body(index) for index in range(model.nbody)]
        self._of_geom = model.geom_bodyid
        self._own = np.array([body.name.startswith(of + "hand") for body in bodies])
        self._fingers = np.array([body.name in ROBOT_FINGERS for body in bodies])
        self._loose = model.body_dofnum == FREE_DOFS
        self._skin = self._own[model.geom_bodyid] & (touch == palette.SKIN_TOUCH).all(axis=1)
        self._rest_m: Array = model.body(of + "hand").pos.copy()
        self._body = int(model.body(of + "hand").id)
        self._palm_m: Array = model.geom_pos[model.body_geomadr[self._body]].copy()  # its first shape is the palm
        self._joints = [int(model.joint(of + name).qposadr[0]) for name in GANTRY + DIGITS]
        self._speeds = [int(model.joint(of + name).dofadr[0]) for name in GANTRY[:3]]
        self._motors = [int(model.actuator(of + name).id) for name in GANTRY + DIGITS]
        names = {model.actuator(index).name for index in range(model.nu)}
        self._tool = int(model.actuator(of + "hand_tool").id) if of + "hand_tool" in names else None
        turns = [of + name for name in (*WRIST_JOINTS, CURL_JOINT)]
        self._wrist = [int(model.actuator(name).id) for name in turns if name in names]
        self._wrist_values = [index for index, name in enumerate(turns) if name in names]

    @property
    def position_m(self) -> Array:
        """Where the hand frame's origin is (3,)."""
        position: Array = self._rest_m + self._data.qpos[self._joints[:3]]
        return position

    @property
    def palm_m(self) -> Array:
        """Where the palm's middle is (3,)."""
        palm: Array = self._data.xpos[self._body] + self._data.xmat[self._body].reshape(3, 3) @ self._palm_m
        return palm

    @property
    def yaw_rad(self) -> float:
        """Heading, 0 with the fingers along -x."""
        return float(self._data.qpos[self._joints[3]])

    @property
    def gap_m(self) -> float:
        """Distance between the tips of thumb and index finger."""
        return float(self._data.qpos[self._joints[4]] + self._data.qpos[self._joints[5]])

    @property
    def stiffness_n_m(self) -> float:
        """Force for each metre that the hand is behind where it was told to go."""
        return GANTRY_KP[0]

    @property
    def touches_robot(self) -> bool:
        """Whether the robot is at the skin, or a part that its fingers touch is at the hand."""
        if not self._data.ncon:
            return False
        geoms = self._data.contact.geom
        bodies = self._of_geom[geoms]
        at_hand, at_fingers = (bodies[of[bodies].any(axis=1)] for of in (self._own, self._fingers))
        held = np.intersect1d(at_hand, at_fingers)
        return bool(self._skin[geoms].any()) or bool(self._loose[held].any())

    @property
    def speed_m_s(self) -> float:
        """How fast the hand frame's origin moves."""
        return float(np.linalg.norm(self._data.qvel[self._speeds]))

    def turn(self, yaw_rad: float) -> None:
        """Put it at rest with another heading, for building scenes."""
        self._data.qpos[self._joints[3]] = self._data.ctrl[self._motors[3]] = yaw_rad

    def command(
        self,
        position_m: Array,
        yaw_rad: float,
        gap_m: float,
        tilt_rad: float = 0.0,
        roll_rad: float = 0.0,
        curl_rad: float = 0.0,
        *,
        tool: bool = False,
        grasp: Grasp = "tripod",
    ) -> None:
        """Where to go; a gap smaller than what is held squeezes it with 1.25 N for each millimetre.

        Args:
            tilt_rad, roll_rad: fingers down, and leaning to the right; a hand without such a wrist ignores them.
            curl_rad: ring and little finger bent by so much more than usual, or stretched; may be ignored, too.
            tool: hold the tool, if the person has one.
            grasp: how a human hand looks when it grasps; the hand turns to it within some periods.
        """
        if self._human and len(self._data.userdata) >= GRASPS_N:
            wanted = np.eye(GRASPS_N)[GRASPS.index(grasp)]
            weights = self._data.userdata[:GRASPS_N]
            weights += GRASP_SHARE * (wanted - weights) if weights.any() else wanted
        if self._tool is not None:
            self._data.ctrl[self._tool] = -TOOL_AWAY_M if tool else 0.0
        if self._wrist:
            values = tilt_rad, roll_rad, curl_rad
            self._data.ctrl[self._wrist] = [values[index] for index in self._wrist_values]
        self._data.ctrl[self._motors[:3]] = position_m - self._rest_m
        self._data.ctrl[self._motors[3]] = yaw_rad
        self._data.ctrl[self._motors[4:]] = min(gap_m, MAX_GAP_M) / 2


def _add_capsule(
    body: mujoco.MjsBody,
    segment: shapes.Segment,
    *,
    mass_kg: float,
    forearm: bool = False,
    material: str = "hand_skin",
    hidden: bool = False,
    touched: bool = True,
) -> None:
    start, end, radius_m = segment
    shape = {"type": mujoco.mjtGeom.mjGEOM_CAPSULE, "fromto": (*start, *end), "size": (radius_m, 0, 0)}
    skin = (FOREARM_N_M, FOREARM_SKIN_GROUP) if forearm else (HAND_N_M, SKIN_GROUP)
    touch = FOREARM_TOUCH if forearm else FLESH_TOUCH if touched else dict(zip(TOUCHES, palette.NO_TOUCH, strict=True))
    seen = {"group": skin[1]} if hidden else {"material": material}
    body.add_geom(**shape, mass=mass_kg, **{**touch, **seen})
    _add_skin(body, shape, *skin)


def _add_ellipsoid(
    body: mujoco.MjsBody, centre_m: tuple[float, float, float], radii_m: tuple[float, float, float], *, mass_kg: float
) -> None:
    shape = {"type": mujoco.mjtGeom.mjGEOM_ELLIPSOID, "pos": centre_m, "size": radii_m}
    body.add_geom(**shape, mass=mass_kg, material="hand_skin", **FLESH_TOUCH)
    _add_skin(body, shape, HAND_N_M)


def _add_skin(body: mujoco.MjsBody, shape: dict[str, object], stiffness_n_m: float, group: int = SKIN_GROUP) -> None:
    """The twin of a shape that touches the robot; its own contact settings count, whatever the robot's are."""
    stiffness = stiffness_n_m / MOVING_MASS_KG
    contype, conaffinity = palette.SKIN_TOUCH
    body.add_geom(
        **shape,
        mass=0.0,
        group=group,
        contype=contype,
        conaffinity=conaffinity,
        condim=3,
        priority=2,
        friction=(0.6, 0.01, 0.0001),
        solref=(-stiffness, -SKIN_DAMPING * math.sqrt(stiffness)),
        solimp=(0.95, 0.95, 0.001, 0.5, 2),
    )
