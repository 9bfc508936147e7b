"""Bodies for viewers' 3D panels: bench, robot, parts seen in the tray, and what is believed to be in the bracket."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import coal
import numpy as np
from foxglove import messages

from bracket_cell.recording.scene_frames import (
    BRACKET,
    FINGER_SIDES,
    WORLD,
    Colour,
    colour_message,
    pose_message,
    timestamp,
)
from bracket_cell.skills.motion.collision import standing_boxes
from bracket_cell.skills.motion.outline import Shape, obstacle_shapes
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product

STEEL, WOOD, ROBOT, TOOL_COLOUR, INK = (
    (0.55, 0.58, 0.62, 1.0),
    (0.80, 0.77, 0.72, 1.0),
    (0.72, 0.74, 0.78, 1.0),
    (0.20, 0.22, 0.26, 1.0),
    (0.05, 0.05, 0.05, 1.0),
)
HAND_COLOUR = (1.0, 0.80, 0.0, 0.35)
BIN_COLOUR = (0.65, 0.60, 0.52, 0.35)
GHOST_ALPHA = 0.30  # of what the guidance shows
LABEL_M = 0.018
TABLE_M = 0.02  # drawn thickness; what is below does not matter to anyone

Size = tuple[float, float, float]


def bench_scene(stamp_ns: int, product: Product, bench: Bench) -> messages.SceneUpdate:
    """Table, bracket with its holes, tray, bins and obstacles."""
    boxes = [box for box in standing_boxes(product, bench) if box.name != "the table"]
    colours = {"the bracket": STEEL}
    cubes = [
        _cube(box.pose, box.size_m, colours.get(box.name, BIN_COLOUR if "bin" in box.name else WOOD)) for box in boxes
    ]
    cubes.append(_cube(Pose((0.6, 0.0, -TABLE_M / 2)), (1.4, 1.4, TABLE_M), (0.90, 0.89, 0.86, 1.0)))
    radius_m = max(part.peg_diameter_m for part in product.parts.values()) / 2 + product.bracket.hole_clearance_m
    holes = [
        messages.CylinderPrimitive(
            pose=pose_message(Pose((x, y, 0.0))),
            size=messages.Vector3(x=2 * radius_m, y=2 * radius_m, z=0.001),
            bottom_scale=1.0,
            top_scale=1.0,
            color=colour_message(INK),
        )
        for x, y in product.bracket.holes_m.values()
    ]
    names = [
        _label(name, Pose((x - product.bracket.margin_m * 0.8, y, 0.012)), INK)
        for name, (x, y) in product.bracket.holes_m.items()
    ]
    obstacles = [_shape_entity(stamp_ns, shape) for shape in obstacle_shapes(bench)]
    return messages.SceneUpdate(
        entities=[
            *obstacles,
            messages.SceneEntity(timestamp=timestamp(stamp_ns), frame_id=WORLD, id="bench", cubes=cubes),
            messages.SceneEntity(
                timestamp=timestamp(stamp_ns), frame_id=BRACKET, id="holes", cylinders=holes, texts=names
            ),
        ]
    )


def robot_scene(stamp_ns: int, shapes: Sequence[Shape]) -> messages.SceneUpdate:
    """Links and gripper, each fixed to its frame, so that it is said once and the frames move it."""
    return messages.SceneUpdate(entities=[_shape_entity(stamp_ns, shape) for shape in shapes])


def parts_scene(stamp_ns: int, product: Product, parts: Sequence[PartDetection]) -> messages.SceneUpdate:
    """Parts as the detector sees them; replaces those that it saw before."""
    bodies = [
        _body(
            stamp_ns,
            f"part {number}",
            WORLD,
            part.world_from_part,
            part.size_m,
            (*product.parts[part.part].colour_rgb, 0.9),
            f"{number}: {part.part} {part.confidence:.2f}",
        )
        for number, part in enumerate(parts)
    ]
    return _replaced(stamp_ns, bodies)


def hands_scene(stamp_ns: int, walls: Sequence[coal.Convex]) -> messages.SceneUpdate:
    """The volumes that the arm keeps its distance from, one for each hand that is seen; replaces those before."""
    hulls = [
        messages.TriangleListPrimitive(
            points=[messages.Point3(x=x, y=y, z=z) for x, y, z in np.array(wall.points()).tolist()],
            indices=[wall.polygons(face)[corner] for face in range(wall.num_polygons) for corner in range(3)],
            color=colour_message(HAND_COLOUR),
        )
        for wall in walls
    ]
    return _replaced(
        stamp_ns,
        [
            messages.SceneEntity(timestamp=timestamp(stamp_ns), frame_id=WORLD, id=f"hand {number}", triangles=[hull])
            for number, hull in enumerate(hulls)
        ],
    )


def assembly_scene(
    stamp_ns: int, product: Product, placed: Mapping[str, str], guidance: Mapping[str, Sequence[str]]
) -> messages.SceneUpdate:
    """Parts that are believed to be in the bracket and, as ghosts, where the guidance shows what remains."""
    bodies = [_in_hole(stamp_ns, product, part, position, 1.0) for position, part in placed.items()]
    for part, positions in guidance.items():
        bodies += [_in_hole(stamp_ns, product, part, to, GHOST_ALPHA) for to in positions if to not in placed]
    return _replaced(stamp_ns, bodies)


def _shape_entity(stamp_ns: int, shape: Shape) -> messages.SceneEntity:
    sliding = shape.name in FINGER_SIDES  # its frame is in its middle
    pose = Pose((0.0, 0.0, 0.0)) if sliding else shape.frame_from_shape
    cubes, hulls = [], []
    if shape.box_m is not None:
        cubes.append(_cube(pose, shape.box_m, TOOL_COLOUR))
    else:
        hulls.append(
            messages.TriangleListPrimitive(
                pose=pose_message(pose),
                points=[messages.Point3(x=x, y=y, z=z) for x, y, z in shape.points_m.tolist()],
                indices=shape.triangles.ravel().tolist(),
                color=colour_message(ROBOT),
            )
        )
    return messages.SceneEntity(
        timestamp=timestamp(stamp_ns),
        frame_id=shape.name if sliding else shape.frame,
        id=shape.name,
        frame_locked=True,
        cubes=cubes,
        triangles=hulls,
    )


def _in_hole(stamp_ns: int, product: Product, part: str, position: str, alpha: float) -> messages.SceneEntity:
    kind = product.parts[part]
    colour = (*kind.colour_rgb, alpha)
    name = f"{part} at {position}"
    return _body(
        stamp_ns, name, BRACKET, Pose(product.slot_m(position)), kind.size_m, colour, part if alpha < 1.0 else name
    )


def _body(
    stamp_ns: int, name: str, frame: str, pose: Pose, size_m: Size, colour: Colour, text: str
) -> messages.SceneEntity:
    """A part by the pose of its bottom's middle."""
    return messages.SceneEntity(
        timestamp=timestamp(stamp_ns),
        frame_id=frame,
        id=name,
        cubes=[_cube(pose @ Pose((0.0, 0.0, size_m[2] / 2)), size_m, colour)],
        texts=[_label(text, pose @ Pose((0.0, 0.0, size_m[2] + LABEL_M)), INK)],
    )


def _replaced(stamp_ns: int, entities: Iterable[messages.SceneEntity]) -> messages.SceneUpdate:
    everything = messages.SceneEntityDeletion(timestamp=timestamp(stamp_ns), type=messages.SceneEntityDeletionType.All)
    return messages.SceneUpdate(deletions=[everything], entities=list(entities))


def _cube(pose: Pose, size_m: Size, colour: Colour) -> messages.CubePrimitive:
    x, y, z = size_m
    return messages.CubePrimitive(
        pose=pose_message(pose), size=messages.Vector3(x=x, y=y, z=z), color=colour_message(colour)
    )


def _label(text: str, pose: Pose, colour: Colour) -> messages.TextPrimitive:
    return messages.TextPrimitive(
        pose=pose_message(pose), billboard=True, font_size=LABEL_M, color=colour_message(colour), text=text
    )
