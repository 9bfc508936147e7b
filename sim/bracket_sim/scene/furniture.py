"""What stands still: lamps, table and its pattern, bracket plate with its holes, tray, and the person's bins."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations, pairwise

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.errors import SettingError
from bracket_ground.files.model import Location
from bracket_ground.interfaces.bench import Bench, Obstacle, Tray
from bracket_ground.interfaces.places import BenchPlace
from bracket_ground.interfaces.product import Product
from bracket_sim.scene import palette
from bracket_sim.scene.look import Light, Surfaces
from bracket_sim.scene.palette import add_box, add_cylinder
from bracket_sim.scene.settings import PhysicsSettings
from bracket_sim.scene.storage import Bin

AIM_M = (0.65, 0.05, 0.0)  # where all lamps shine: the middle of the bench
LAMP_SPECULAR = 0.1
SHADOW_MAP_PX = 1024  # 2.3 mm each, less than a pixel of the overhead camera; twice as many double an image's cost
SHADOWED_M = 1.2  # half the width of what a lamp's shadow map covers
GRAIN_PX = 256
GRAIN_STRETCH = 12  # the pattern is this many times longer than wide, as in wood
TABLE_SIZE_M = (1.90, 2.10, 0.04)
TABLE_CENTRE_M = (0.50, 0.05)
TABLE = "table"  # name of its geom
ROOM_FLOOR_M = -0.80
WALL_M = 0.006
BIN_RIM_M = 0.006
PLATE_SHININESS = 0.5
PLATE_TOUCH = (0.004, 1.0)  # solref: softer, and parts that fall 11 cm sink so deep that they are pushed out below
RELIEF_M = 0.0004  # plate pieces beside a hole lie this much lower, so that bodies rest on the two long ones alone


def set_physics(spec: mujoco.MjSpec, physics: PhysicsSettings) -> None:
    """How the cell is stepped."""
    spec.option.timestep = physics.step_s
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 100.0  # with 10, held parts creep down 0.05 mm a second
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_MULTICCD


def add_lights(spec: mujoco.MjSpec, light: Light) -> None:
    """Soft lamps, whose shadow maps cost more than all the rest of an image; a sky for portraits."""
    headlight = spec.visual.headlight
    headlight.ambient, headlight.diffuse = [light.ambient] * 3, [light.headlight] * 3
    headlight.specular = [0.0] * 3
    spec.visual.quality.shadowsize = SHADOW_MAP_PX
    for number, lamp in enumerate(light.lamps[: light.lamps_n]):
        direction = np.array(AIM_M) - lamp.position_m
        spec.worldbody.add_light(
            pos=list(lamp.position_m),
            dir=list(direction / np.linalg.norm(direction)),
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            diffuse=list(lamp.rgb),
            specular=[LAMP_SPECULAR] * 3,
            ambient=[0.0] * 3,
            castshadow=light.shadows and number == 0,
        )
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.80, 0.84, 0.88],
        rgb2=[0.45, 0.48, 0.52],
        width=64,
        height=64,
    )


def fit_shadows(model: mujoco.MjModel) -> None:
    """Spend the whole shadow map on the bench."""
    model.vis.map.shadowclip = SHADOWED_M / model.stat.extent


def add_table_material(spec: mujoco.MjSpec, surfaces: Surfaces) -> str:
    """A material with the table's pattern; returns its name, or "" for a plain table."""
    if surfaces.table_grain == 0:
        return ""
    texture = spec.add_texture(
        name="grain", type=mujoco.mjtTexture.mjTEXTURE_2D, width=GRAIN_PX, height=GRAIN_PX, nchannel=3
    )
    texture.data = grain(surfaces).tobytes()
    material = spec.add_material(name="table", rgba=[1.0] * 4, specular=0.2, shininess=0.3, texrepeat=[1, 1])
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "grain"
    return "table"


def grain(surfaces: Surfaces) -> NDArray[np.uint8]:
    """The table's pattern (GRAIN_PX, GRAIN_PX, 3) RGB: streaks around the table's colour."""
    rng = np.random.default_rng(surfaces.grain_number)
    noise = rng.standard_normal((GRAIN_PX, GRAIN_PX)).astype(np.float32)
    streaks = cv2.GaussianBlur(noise, (0, 0), sigmaX=GRAIN_STRETCH, sigmaY=1.0, borderType=cv2.BORDER_REFLECT)
    shade = 1.0 + surfaces.table_grain * streaks[..., np.newaxis] / np.abs(streaks).max()
    pattern: NDArray[np.uint8] = np.rint(np.clip(np.array(surfaces.table_rgb) * shade, 0, 1) * 255).astype(np.uint8)
    return pattern


def add_furniture(spec: mujoco.MjSpec, product: Product, bench: Bench, bins: Sequence[Bin], surfaces: Surfaces) -> None:
    """Add everything that does not move."""
    world = spec.worldbody
    x, y = TABLE_CENTRE_M
    table = add_box(world, (x, y, -TABLE_SIZE_M[2] / 2), TABLE_SIZE_M, surfaces.table_rgb)
    if material := add_table_material(spec, surfaces):
        table.material, table.rgba = material, [1.0] * 4
    floor = add_box(world, (x, y, ROOM_FLOOR_M), (6.0, 6.0, 0.02), palette.FLOOR, palette.NO_TOUCH)
    table.name, floor.group = TABLE, palette.FLOOR_GROUP
    _add_bracket(world, product, bench, surfaces.plate_rgb)
    spec.add_material(name="plate", specular=surfaces.plate_shine, shininess=PLATE_SHININESS)
    for geom in spec.body("bracket").geoms:
        geom.material = "plate"
    add_tray(world, bench.tray, surfaces.tray_rgb)
    for name, place in bench.places.items():
        _add_place(world, name, place, product, surfaces.plate_rgb)
    for bin_ in bins:
        _add_bin(world, bin_, surfaces.bin_rgb)
    for number, obstacle in enumerate(bench.obstacles):
        _add_obstacle(spec, f"obstacle_{number}", obstacle)


def _add_obstacle(spec: mujoco.MjSpec, name: str, obstacle: Obstacle) -> None:
    """In a body of its own; a mesh touches as its convex hull, as it does for the planner."""
    at = {"pos": list(obstacle.position_m), "quat": list(obstacle.quaternion_wxyz)}
    body, none = spec.worldbody.add_body(name=name, **at), (0.0, 0.0, 0.0)
    if obstacle.box_m is not None:
        add_box(body, none, obstacle.box_m, palette.OBSTACLE)
    elif obstacle.cylinder_m is not None:
        add_cylinder(body, none, *obstacle.cylinder_m, palette.OBSTACLE)
    else:
        spec.add_mesh(name=name, file=str(obstacle.mesh))
        palette.add_mesh(body, name, palette.OBSTACLE)


def _add_place(world: mujoco.MjsBody, name: str, place: BenchPlace, product: Product, rgb: palette.Rgb) -> None:
    """A block up to its upper side, with a rim or with holes; nothing where that is the table itself."""
    body = world.add_body(name=f"place {name}", pos=list(place.position_m), quat=list(place.quaternion_wxyz))
    length, width = place.size_m(product.longest_m(place.holds))
    height = place.position_m[2]
    if place.seat == "hole":
        _check_plate(
            product, ("bench", "places", name), height, {str(number): at for number, at in enumerate(place.spots_m)}
        )
        low, high = [-length / 2, -width / 2], [length / 2, width / 2]
        _add_plate(body, product, list(place.spots_m), (low, high), height, rgb)
    elif height > 0:
        depth = height + TABLE_SIZE_M[2]
        add_box(body, (0.0, 0.0, -depth / 2), (length, width, depth), rgb)
    if place.wall_m > 0:
        _add_rim(body, (0.0, 0.0, -height), (length, width), height + place.wall_m, rgb)
    for geom in body.geoms:
        geom.solref = PLATE_TOUCH


def _add_bin(world: mujoco.MjsBody, holder: Bin, rgb: palette.Rgb) -> None:
    x, y, z = holder.centre_m
    _add_floor(world, holder.centre_m, holder.size_m, rgb)
    _add_rim(world, (x, y, 0.0), holder.size_m, z + BIN_RIM_M, rgb)


def add_tray(world: mujoco.MjsBody, tray: Tray, rgb: palette.Rgb) -> None:
    """Its floor and its wall."""
    x, y, z = tray.centre_m
    length, width = tray.size_m
    _add_floor(world, (x, y, z), (length, width), rgb)
    _add_rim(world, (x, y, 0.0), (length, width), z + tray.wall_m, rgb)


def _add_floor(
    world: mujoco.MjsBody, top_m: tuple[float, float, float], size_m: tuple[float, float], rgb: palette.Rgb
) -> None:
    """As deep as the table: what falls sinks through the middle of a thin floor, and is pressed out below."""
    x, y, z = top_m
    depth = z + TABLE_SIZE_M[2]
    add_box(world, (x, y, z - depth / 2), (*size_m, depth), rgb)


def _add_rim(
    world: mujoco.MjsBody,
    foot_m: tuple[float, float, float],
    inner_m: tuple[float, float],
    height_m: float,
    rgb: palette.Rgb,
) -> None:
    x, y, z = foot_m
    for side in (-1, 1):
        across = (x + side * (inner_m[0] + WALL_M) / 2, y, z + height_m / 2)
        along = (x, y + side * (inner_m[1] + WALL_M) / 2, z + height_m / 2)
        add_box(world, across, (WALL_M, inner_m[1] + 2 * WALL_M, height_m), rgb)
        add_box(world, along, (inner_m[0], WALL_M, height_m), rgb)


def _add_bracket(world: mujoco.MjsBody, product: Product, bench: Bench, rgb: palette.Rgb) -> None:
    """A plate with octagonal holes on a dark foot, so that a camera tells an empty hole from a filled one."""
    pose = bench.bracket.pose
    bracket = world.add_body(name="bracket", pos=list(pose.position_m), quat=list(pose.quaternion_wxyz))
    _check_plate(product, ("bench", "bracket"), pose.position_m[2], product.through)
    for positions in product.bracket.plates or (product.positions,):
        margin_m, holes = (
            product.bracket.margin_m,
            [product.through[position] for position in positions if position in product.through],
        )
        low = [min(hole[axis] for hole in holes) - margin_m for axis in (0, 1)]
        high = [max(hole[axis] for hole in holes) + margin_m for axis in (0, 1)]
        _add_plate(bracket, product, holes, (low, high), pose.position_m[2], rgb)
    for geom in bracket.geoms:
        geom.solref = PLATE_TOUCH


def _add_plate(
    bracket: mujoco.MjsBody,
    product: Product,
    holes: list[tuple[float, float]],
    corners_m: tuple[list[float], list[float]],
    height_m: float,
    rgb: palette.Rgb,
) -> None:
    (low, high), plate, radius = corners_m, product.bracket, product.hole_radius_m
    rows = sorted({low[0], high[0], *(x + side * radius for x, _ in holes for side in (-1, 1))})
    for top, bottom in pairwise(rows):
        middle = (top + bottom) / 2
        inside = sorted(y for x, y in holes if abs(x - middle) < radius)
        edges = [low[1], *(y + side * radius for y in inside for side in (-1, 1)), high[1]]
        for left, right in zip(edges[::2], edges[1::2], strict=True):
            relief = RELIEF_M if inside else 0.0
            centre = (middle, (left + right) / 2, -relief - (plate.thickness_m - relief) / 2)
            size = (bottom - top, right - left, plate.thickness_m - relief)
            add_box(bracket, centre, size, rgb)
    for hole in holes:
        _add_corners(bracket, hole, radius, plate.thickness_m, rgb)
    foot = height_m - max(plate.thickness_m, _longest_peg_m(product) + 0.002)
    centre = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, foot / 2 - height_m)
    add_box(bracket, centre, (high[0] - low[0] - 0.01, high[1] - low[1] - 0.01, foot), palette.HOLE)


def _add_corners(
    bracket: mujoco.MjsBody, hole: tuple[float, float], radius_m: float, thickness_m: float, rgb: palette.Rgb
) -> None:
    """Turn a square opening into the octagon around the same circle."""
    depth = radius_m * (math.sqrt(2.0) - 1.0)  # of a corner, measured along the diagonal
    for quarter in range(4):
        angle = math.pi / 4 + quarter * math.pi / 2
        reach = radius_m + depth / 2
        centre = (hole[0] + reach * math.cos(angle), hole[1] + reach * math.sin(angle), -RELIEF_M - thickness_m / 2)
        size = (depth, 2 * depth, thickness_m - RELIEF_M)
        corner = add_box(bracket, centre, size, rgb)
        corner.quat = [math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)]


def _longest_peg_m(product: Product) -> float:
    return max(part.peg_length_m for part in product.parts.values())


def _check_plate(
    product: Product, location: Location, height_m: float, holes_m: Mapping[str, tuple[float, float]]
) -> None:
    if height_m < _longest_peg_m(product) + 0.002 or height_m < product.bracket.thickness_m:
        what = (
            f"the upper side is {height_m:.3f} m above the table, too low for a plate of "
            f"{product.bracket.thickness_m:.3f} m and pegs of {_longest_peg_m(product):.3f} m + 0.002 m"
        )
        raise SettingError(((*location, "position_m"), what))
    radius_m, of_bracket = product.hole_radius_m, location == ("bench", "bracket")
    for (name, (x, y)), (other, (x2, y2)) in combinations(holes_m.items(), 2):
        if max(abs(x - x2), abs(y - y2)) <= 2 * radius_m:
            what = f"holes {name} and {other} overlap: openings are {2 * radius_m:.3f} m wide"
            where = ("product", "bracket", "holes_m", other) if of_bracket else (*location, "pitch_m")
            raise SettingError((where, what))
