"""A surface with objects for MuJoCo; what nobody has set down yet floats aside. At a table each can be lifted."""

from __future__ import annotations

import math
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.pose import Array
from bracket_sim.stacks.pieces import FACES, ROUND, TILE_PX, Piece, Quaternion, Thing, box, near, one_of, tile

STEP_S = 0.002
DENSITY_KG_M3 = 500.0
FRICTION = 0.8
ASIDE_M = 3.0  # where what is not on the table yet floats
TABLE_M = (1.4, 1.4, 0.04)
THIN_M, SLIGHT = 0.0017, 0.1  # pieces thinner than this that make up less of the volume touch nothing: print, screens
LIFTER = "lifter"
DIVERGED = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
_FIRM = [0.006, 1.0]  # time constant and damping ratio of contacts
_ROLLING_DAMPING = 4e-4  # of a free body: what rolls stops within a second
_SHAPES = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "ball": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    "cone": mujoco.mjtGeom.mjGEOM_MESH,
}


class Stage:
    """Some objects above a surface whose top is at z = 0.

    Attributes:
        bodies: number of each object's body.
        down: whether it has been set down.

    Args:
        spec: the surface, and the objects as its only free bodies.
        names: of the objects' bodies, in their order.
    """

    def __init__(self, spec: mujoco.MjSpec, names: Sequence[str]) -> None:
        for number, name in enumerate(names):
            spec.body(name).pos, spec.body(name).gravcomp = _aside(number), 1.0
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.bodies = [self.model.body(name).id for name in names]
        self.down = [False] * len(names)
        mujoco.mj_forward(self.model, self.data)

    def put(self, number: int, place_m: Array, turn: Quaternion) -> None:
        """Put an object somewhere, at rest; from now on it falls."""
        self.down[number] = True
        self.model.body_gravcomp[self.bodies[number]] = 0.0
        self.data.qpos[7 * number : 7 * number + 7] = (*place_m.tolist(), *turn)
        self.data.qvel[6 * number : 6 * number + 6] = 0.0
        mujoco.mj_forward(self.model, self.data)

    def take_away(self, number: int) -> None:
        """Let an object float aside again."""
        self.down[number] = False
        self.model.body_gravcomp[self.bodies[number]] = 1.0
        self.data.qpos[7 * number : 7 * number + 7] = (*_aside(number), 1.0, 0.0, 0.0, 0.0)
        self.data.qvel[6 * number : 6 * number + 6] = 0.0
        mujoco.mj_forward(self.model, self.data)

    def run(self, seconds: float) -> None:
        """Let time pass."""
        mujoco.mj_step(self.model, self.data, nstep=max(1, round(seconds / self.model.opt.timestep)))

    @property
    def diverged(self) -> bool:
        """Whether the physics came to no finite state; MuJoCo then puts everything back to the beginning."""
        return any(self.data.warning[kind].number for kind in DIVERGED)

    def state(self) -> tuple[Array, list[bool]]:
        """Where everything is, to come back to; it is at rest then."""
        return self.data.qpos.copy(), list(self.down)

    def restore(self, state: tuple[Array, list[bool]]) -> None:
        """Go back, at rest."""
        where, down = state
        self.data.qpos[:] = where
        self.data.qvel[:], self.data.qacc_warmstart[:], self.data.eq_active[:] = 0.0, 0.0, 0
        self.down = list(down)
        self.model.body_gravcomp[self.bodies] = [0.0 if there else 1.0 for there in down]
        mujoco.mj_forward(self.model, self.data)

    def lift(self, number: int, height_m: float, speed_m_s: float) -> Array:
        """Lift an object straight up without turning it; returns how far each object moved at most (n,) [m].

        For stages of `table_with` alone.
        """
        body, equality = self.bodies[number], number
        lifter = int(self.model.body_mocapid[self.model.body(LIFTER).id])
        begin = self.data.geom_xpos.copy()
        start = self.data.xpos[body].copy()
        self.data.mocap_pos[lifter], self.data.mocap_quat[lifter] = start, self.data.xquat[body]
        self.data.eq_active[equality] = 1
        moved = np.zeros(len(self.bodies))
        pause_s = 0.01
        for height in np.arange(0.0, height_m, speed_m_s * pause_s):
            self.data.mocap_pos[lifter, 2] = start[2] + height
            self.run(pause_s)
            moved = np.maximum(moved, self._moved(begin))
        self.data.eq_active[equality] = 0
        return moved

    def _moved(self, begin: Array) -> Array:
        """How far the farthest piece of each object is from where it was."""
        far = np.linalg.norm(self.data.geom_xpos - begin, axis=1)
        owner = self.model.geom_bodyid
        return np.array([far[owner == body].max() for body in self.bodies])

    def speeds(self) -> Array:
        """(n,) of the objects: metres a second, a turn of ten radians counting as one metre."""
        speed = np.abs(self.data.qvel.reshape(-1, 6)) * (1.0, 1.0, 1.0, 0.1, 0.1, 0.1)
        found: Array = speed.max(axis=1) * np.array(self.down)
        return found

    def lowest_m(self, number: int) -> float:
        """Height of an object's lowest corner."""
        return float(self.points(number)[:, 2].min())

    def points(self, number: int) -> Array:
        """Corners (k, 3) of the boxes around an object's pieces."""
        return np.concatenate([self.corners(geom) for geom in self.geoms(number)])

    def geoms(self, number: int) -> NDArray[np.intp]:
        """The pieces of an object."""
        return np.flatnonzero(self.model.geom_bodyid == self.bodies[number])

    def corners(self, geom: int) -> Array:
        """(8, 3) of the box around a piece."""
        centre, half = self.model.geom_aabb[geom, :3], self.model.geom_aabb[geom, 3:]
        turn = self.data.geom_xmat[geom].reshape(3, 3)
        found: Array = self.data.geom_xpos[geom] + (centre + _CORNERS * half) @ turn.T
        return found

    def contacts(self) -> tuple[NDArray[np.intp], Array]:
        """Bodies (k, 2) that touch, and the normals' heights (k,); a normal points from the first to the second."""
        bodies = self.model.geom_bodyid[self.data.contact.geom].reshape(-1, 2)
        return bodies, self.data.contact.frame[:, 2].copy()


def table_with(things: Sequence[Thing], rng: np.random.Generator) -> Stage:
    """Everyday objects at a table, each of which can be lifted.

    Args:
        rng: draws patterns, table and light.
    """
    spec = _spec()
    _add_surroundings(spec, rng)
    for number, thing in enumerate(things):
        _add_thing(spec, number, thing, rng)
    return Stage(spec, [f"thing_{number}" for number in range(len(things))])


_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


def _spec() -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.option.timestep = STEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    spec.option.iterations = 30
    spec.visual.quality.shadowsize = 1024
    spec.visual.quality.offsamples = 2
    spec.visual.map.znear, spec.visual.map.zfar = 0.02, 20.0
    return spec


def _add_surroundings(spec: mujoco.MjSpec, rng: np.random.Generator) -> None:
    """Table, lights, and the hand that lifts."""
    rgb = one_of(rng, (0.80, 0.80, 0.78), (0.58, 0.42, 0.26), (0.30, 0.32, 0.34), (0.72, 0.66, 0.56))
    pattern = ("grain", "plain", "plain", "checks")[int(rng.integers(4))]
    table = box(TABLE_M, (0, 0, -TABLE_M[2] / 2), rgb)
    surface = Piece(table.shape, table.size_m, table.centre_m, rgb, pattern=pattern, ink_rgb=near(rgb, rng, 0.05))  # type: ignore[arg-type]
    geom = _add_piece(spec, spec.worldbody, "table", surface, rng, touches=True)
    geom.friction = [FRICTION, 0.01, 0.001]
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[0, 0, -0.7],
        size=[4, 4, 0.1],
        rgba=[*one_of(rng, (0.35, 0.35, 0.36), (0.5, 0.45, 0.4)), 1],
        contype=0,
        conaffinity=0,
    )
    angle, far = rng.uniform(0, 2 * math.pi), rng.uniform(0.2, 1.0)
    level = rng.uniform(0.45, 0.75)
    spec.worldbody.add_light(
        pos=[far * math.cos(angle), far * math.sin(angle), 1.6],
        dir=[-far * math.cos(angle), -far * math.sin(angle), -1.6],
        diffuse=[level, level, level * rng.uniform(0.88, 1.0)],
        specular=[0.2, 0.2, 0.2],
        castshadow=True,
        cutoff=70,
    )
    ambient = rng.uniform(0.28, 0.42)
    spec.visual.headlight.ambient = [ambient] * 3
    spec.visual.headlight.diffuse = [0.22] * 3
    spec.visual.headlight.specular = [0.05] * 3
    spec.worldbody.add_body(name=LIFTER, mocap=True)


def _add_thing(spec: mujoco.MjSpec, number: int, thing: Thing, rng: np.random.Generator) -> None:
    name = f"thing_{number}"
    body = spec.worldbody.add_body(name=name)
    body.add_joint(type=mujoco.mjtJoint.mjJNT_FREE, damping=[_ROLLING_DAMPING] * 3)
    whole = sum(piece.volume_m3 for piece in thing.pieces)
    for place, piece in enumerate(thing.pieces):
        slight = min(piece.size_m) < THIN_M and piece.volume_m3 < SLIGHT * whole
        geom = _add_piece(spec, body, f"{name}_{place}", piece, rng, touches=not slight)
        geom.mass = DENSITY_KG_M3 * piece.volume_m3
    weld = spec.add_equality(type=mujoco.mjtEq.mjEQ_WELD, name1=name, name2=LIFTER, active=False)
    weld.objtype = mujoco.mjtObj.mjOBJ_BODY
    weld.data = np.array([0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0], dtype=float)  # frames on each other
    weld.solref = _FIRM


def _add_piece(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, piece: Piece, rng: np.random.Generator, *, touches: bool
) -> mujoco.MjsGeom:
    touch = int(touches)
    geom = body.add_geom(
        name=name,
        type=_SHAPES[piece.shape],
        pos=list(piece.centre_m),
        quat=list(piece.turn),
        size=_sizes(piece),
        contype=touch,
        conaffinity=touch,
        condim=4,
        friction=[FRICTION, 0.01, 0.001],
        solref=_FIRM,
        rgba=[*piece.rgb, 1.0],
    )
    if piece.shape == "cone":
        spec.add_mesh(name=name).uservert = _frustum(piece).ravel()
        geom.meshname = name
    if piece.pattern != "plain":
        face = tile(piece, rng)
        texture = spec.add_texture(
            name=name, type=mujoco.mjtTexture.mjTEXTURE_CUBE, width=TILE_PX, height=FACES * TILE_PX, nchannel=3
        )
        texture.data = np.tile(face, (FACES, 1, 1)).tobytes()
        material = spec.add_material(name=name, specular=0.2, shininess=0.3)
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
        geom.material, geom.rgba = name, [1.0, 1.0, 1.0, 1.0]
    return geom


def _sizes(piece: Piece) -> list[float]:
    a, _, c = piece.size_m
    if piece.shape in ("cylinder", "capsule"):
        return [a / 2, c / 2, 0.0]
    return [0.0, 0.0, 0.0] if piece.shape == "cone" else [side / 2 for side in piece.size_m]


def _frustum(piece: Piece) -> Array:
    """(2 ROUND, 3) corners of a cone without its tip."""
    bottom, top, length = piece.size_m
    angles = np.arange(ROUND) * 2 * math.pi / ROUND
    ring = np.column_stack([np.cos(angles), np.sin(angles)]) / 2
    ends = ((bottom, -length / 2), (top, length / 2))
    return np.concatenate([np.column_stack([width * ring, np.full(ROUND, z)]) for width, z in ends])


def _aside(number: int) -> tuple[float, float, float]:
    return ASIDE_M, 0.5 * number, 0.5
