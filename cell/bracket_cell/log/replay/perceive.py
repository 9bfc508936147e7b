"""What other detectors see on the recorded images: a log whose ticks saw that."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
from foxglove import messages

from bracket_cell.configuration import Configuration
from bracket_cell.log.read.frames import CAMERA, Frames, decoded
from bracket_cell.log.read.reader import Log
from bracket_cell.recording.scene import FRAME_OF_CAMERA
from bracket_cell.running.device_reader import RobotPoseHistory
from bracket_cell.settings import Perception
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.wiring.detectors import bench_watcher, part_finder
from bracket_ground.errors import InputError, LogError, counted
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import BenchView, PartsView
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product

KINDS = ("classical", "learned")
VIEWS = {"overhead": "bench", "wrist": "parts"}


def perceived(log: Log, configuration: Configuration, product: Product, chosen: str) -> tuple[Log, str]:
    """The log with what the chosen detectors see, and what of it is as recorded, for people.

    Args:
        chosen: a kind of detectors, or a folder with the weights of trained ones.

    Raises:
        InputError: there is neither.
        LogError: the log holds no images.
    """
    perception = _chosen(configuration.perception, chosen)
    motion = MotionPlanner(product, configuration.bench, configuration.motion)
    arguments = configuration.bench, product, perception
    detect: Mapping[str, Any] = {"overhead": bench_watcher(*arguments), "wrist": part_finder(*arguments)}
    seen: dict[str, dict[int, Any]] = {camera: {} for camera in VIEWS}
    for frame in _frames(log, motion):
        seen[frame.camera][_ns(frame.time_s)] = detect[frame.camera](frame)
    if not any(seen.values()):
        raise LogError(log.path, "holds no image that could be looked at again (configuration: camera_frames)")
    made: dict[int, Any] = {}
    lacking = set()

    def again(camera: str, view: BenchView | PartsView | None) -> Any:
        if view is None:
            return None
        if id(view) not in made:
            found = seen[camera].get(_ns(view.time_s))
            made[id(view)] = view if found is None else replace(found, sequence=view.sequence)
            lacking.update([] if found is not None else [(camera, view.sequence)])
        return made[id(view)]

    ticks = []
    for tick in log.ticks:
        was = tick.observation
        ticks.append(
            replace(tick, observation=replace(was, bench=again("overhead", was.bench), parts=again("wrist", was.parts)))
        )
    remark = f"{counted(len(lacking), 'answer')} of the recording kept, as no image is in the log" if lacking else ""
    return replace(log, ticks=tuple(ticks)), remark


def _chosen(perception: Perception, chosen: str) -> Perception:
    if chosen in KINDS:
        return perception.model_copy(update={"kind": chosen, **dict.fromkeys(("hands", "actions", "holes", "parts"))})
    if Path(chosen).is_dir():
        return perception.model_copy(update={"kind": "learned", "folder": Path(chosen)})
    raise InputError(f"--perception {chosen}: is neither a folder with weights nor a kind; legal: {', '.join(KINDS)}")


def _frames(log: Log, motion: MotionPlanner) -> Iterator[Frame]:
    """All images with the poses of their cameras, in the order in which they were taken."""
    frames, bodies = Frames(log), RobotPoseHistory(motion.separation.outline, motion.kinematics.forward)
    poses = {camera: _poses(log, camera) for camera in VIEWS}
    taken = sorted(
        (message.time_ns, message.topic.removeprefix(CAMERA))
        for message in log.messages
        if message.topic.removeprefix(CAMERA) in VIEWS
    )
    ticks = iter(log.ticks)
    tick = next(ticks, None)
    for number, (time_ns, camera) in enumerate(taken):
        while tick is not None and tick.time_s <= time_ns / 1e9 + 0.05:
            bodies.keep(tick.observation.arm, tick.observation.gripper)
            tick = next(ticks, None)
        stored, known = frames.at(camera, time_ns / 1e9), poses[camera]
        place = bisect_right(known, time_ns, key=lambda pair: pair[0])
        if stored is None or not place:
            continue
        body = bodies.at(time_ns / 1e9) if camera == "overhead" else None
        rgb: Any = cv2.cvtColor(stored.image(), cv2.COLOR_BGR2RGB)
        yield Frame(camera, number, time_ns / 1e9, rgb, known[place - 1][1], body)


def _poses(log: Log, camera: str) -> list[tuple[int, Pose]]:
    """Where a camera was, from when on."""
    topic, found = FRAME_OF_CAMERA.format(camera), []
    for message in log.messages:
        if message.topic == topic:
            transform = decoded(log.path, message, messages.FrameTransform)
            at, turn = transform.translation, transform.rotation
            found.append((message.time_ns, Pose((at.x, at.y, at.z), (turn.w, turn.x, turn.y, turn.z))))
    return found


def _ns(time_s: float) -> int:
    return round(time_s * 1e9)
