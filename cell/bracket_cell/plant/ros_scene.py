"""What viewers are shown of a run, as messages of ROS 2: frames for tf2, and bodies as markers for RViz.

It is read from Foxglove's messages, those of the log, so that a live run and an exported one are the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from bracket_cell.plant.ros_types import empty, message

CUBE, CYLINDER, TEXT, TRIANGLES, DELETE_ALL = 1, 3, 9, 11, 3  # visualization_msgs/Marker: types, and an action
MARKERS, TF = "visualization_msgs/msg/MarkerArray", "tf2_msgs/msg/TFMessage"


def stamp(at_ns: int) -> Any:
    """A time of ROS."""
    return message("builtin_interfaces/msg/Time")(sec=at_ns // 10**9, nanosec=at_ns % 10**9)


def header(at_ns: int, frame: str = "") -> Any:
    """Of what is about a moment, in a frame."""
    return message("std_msgs/msg/Header")(stamp=stamp(at_ns), frame_id=frame)


def moved(at_ns: int, frames: Iterable[Any]) -> Any:
    """`foxglove.FrameTransform`s as a tf2_msgs/TFMessage."""
    made, transform = message("geometry_msgs/msg/TransformStamped"), message("geometry_msgs/msg/Transform")
    return message(TF)(
        transforms=[
            made(
                header=header(at_ns, frame.parent_frame_id),
                child_frame_id=frame.child_frame_id,
                transform=transform(translation=_vector(frame.translation), rotation=_turned(frame.rotation)),
            )
            for frame in frames
        ]
    )


def markers(at_ns: int, scene: Any) -> Any:
    """A `foxglove.SceneUpdate` as a visualization_msgs/MarkerArray; each entity is a namespace of its own."""
    found = []
    if scene.deletions:
        found.append(empty("visualization_msgs/msg/Marker"))
        found[0].action = DELETE_ALL
    for entity in scene.entities:
        for number, marker in enumerate(_bodies(entity)):
            marker.header, marker.ns, marker.id = header(at_ns, entity.frame_id), entity.id, number
            marker.frame_locked = entity.frame_locked
            found.append(marker)
    return message(MARKERS)(markers=found)


def _bodies(entity: Any) -> Iterator[Any]:
    for cube in entity.cubes:
        yield _marker(CUBE, cube, _vector(cube.size))
    for cylinder in entity.cylinders:
        yield _marker(CYLINDER, cylinder, _vector(cylinder.size))
    for hull in entity.triangles:
        marker = _marker(TRIANGLES, hull, message("geometry_msgs/msg/Vector3")(x=1.0, y=1.0, z=1.0))
        marker.points = [_point(hull.points[index]) for index in hull.indices]
        yield marker
    for text in entity.texts:
        marker = _marker(TEXT, text, message("geometry_msgs/msg/Vector3")(x=0.0, y=0.0, z=text.font_size))
        marker.text = text.text
        yield marker


def _marker(kind: int, body: Any, scale: Any) -> Any:
    marker, pose, colour = empty("visualization_msgs/msg/Marker"), body.pose, body.color
    marker.type, marker.scale = kind, scale
    marker.pose = message("geometry_msgs/msg/Pose")(_point(pose.position), _turned(pose.orientation))
    marker.color = message("std_msgs/msg/ColorRGBA")(r=colour.r, g=colour.g, b=colour.b, a=colour.a)
    return marker


def _vector(of: Any) -> Any:
    return message("geometry_msgs/msg/Vector3")(x=of.x, y=of.y, z=of.z)


def _point(of: Any) -> Any:
    return message("geometry_msgs/msg/Point")(x=of.x, y=of.y, z=of.z)


def _turned(of: Any) -> Any:
    return message("geometry_msgs/msg/Quaternion")(x=of.x, y=of.y, z=of.z, w=of.w)
