"""Topics of ROS 2: bytes as an independent package reads them, a camera, and a run that others look at."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import foxglove
import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.recording.scene import CellModel, SceneLog
from bracket_cell.settings import Ros2Settings
from bracket_cell.skills.drivers.settings import DdsSettings, Ros2CameraSettings, Ros2GripperSettings
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.watching.observer import Outcome, SentCommand, TickRecord
from bracket_ground.errors import DeviceFault, InputError
from bracket_ground.interfaces.clock import WallClock
from bracket_ground.interfaces.command import Command, Display
from bracket_ground.interfaces.faults import Action, SafetyDecision
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HandSample
from tests.cell.running.test_supervisor import sound

pytest.importorskip("cyclonedds", reason="the extra ros2 is not installed")
typesys = pytest.importorskip("rosbags.typesys", reason="the extra ros2 is not installed")

from bracket_cell.plant.dds import LAST, Node, Quality  # noqa: E402 - without the extra they are of no use
from bracket_cell.plant.ros_camera import Ros2Camera  # noqa: E402
from bracket_cell.plant.ros_gripper import Ros2Gripper  # noqa: E402
from bracket_cell.plant.ros_scene import CUBE, DELETE_ALL  # noqa: E402
from bracket_cell.plant.ros_services import ActionClient  # noqa: E402
from bracket_cell.plant.ros_topics import RosTopics  # noqa: E402
from bracket_cell.plant.ros_types import empty, message  # noqa: E402

DOMAIN = 87
BENCH, PRODUCT = load_configuration().bench, load_product(load_configuration())
STORE = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
KINDS = sorted(
    name
    for name in STORE.fielddefs
    if name.split("/")[0] in ("std_msgs", "sensor_msgs", "geometry_msgs", "diagnostic_msgs", "tf2_msgs", "nav_msgs")
)


def until(holds: Callable[[], Any]) -> Any:
    end_s = time.monotonic() + 15.0
    while not (found := holds()):
        assert time.monotonic() < end_s, "it did not come"
        time.sleep(0.02)
    return found


def filled(kind: Any, rng: np.random.Generator) -> Any:
    """A message with drawn content, at any depth."""
    store, name = STORE, kind.__idl_typename__.replace("::dds_", "").replace("::", "/").removesuffix("_")
    return kind(**{field: drawn(of, rng) for field, of in store.fielddefs[name][1]})


def drawn(of: Any, rng: np.random.Generator) -> Any:
    node, told = of
    if node.name == "NAME":
        return filled(message(told), rng)
    if node.name in ("SEQUENCE", "ARRAY"):
        return [drawn(told[0], rng) for _ in range(told[1] or int(rng.integers(0, 4)))]
    if told[0] == "string":
        return "".join(map(chr, rng.integers(97, 123, int(rng.integers(0, 9)))))
    if told[0] == "bool":
        return bool(rng.integers(2))
    return float(rng.integers(-99, 99)) if "float" in told[0] else int(rng.integers(0, 100))


@pytest.mark.parametrize("name", KINDS)
def test_bytes_of_every_message_are_those_of_another_implementation(name: str) -> None:
    if not STORE.fielddefs[name][1]:
        return  # std_msgs/Empty
    made = filled(message(name), np.random.default_rng(7))
    read = STORE.deserialize_cdr(made.serialize(), name)
    assert bytes(STORE.serialize_cdr(read, name)) == bytes(made.serialize())


def tick(number: int, judgement: SafetyDecision | None = None, display: Display | None = None) -> TickRecord:
    command = Command()
    command.display = display
    return TickRecord(sound(number), "RUNNING", (), (), command, SentCommand(), 0.0, overrun=False, judgement=judgement)


def with_hand(record: TickRecord) -> TickRecord:
    """The same where a hand is seen."""
    assert record.observation.bench is not None
    bench = replace(record.observation.bench, hand=HandSample(0.0, (10, 20, 60, 80), (0.7, 0.1), (0.8, 0.1)))
    return replace(record, observation=replace(record.observation, bench=bench))


def model() -> CellModel:
    configuration = load_configuration()
    return CellModel(PRODUCT, BENCH, MotionPlanner(PRODUCT, BENCH, configuration.motion))


def test_a_lab_sees_joints_transforms_diagnostics_and_words() -> None:
    settings = Ros2Settings(domain=DOMAIN, namespace="bench_4")
    cell = model()
    scene = SceneLog(foxglove.Context(), cell)
    topics = RosTopics(settings, cell.motion, scene, lambda: "a guard waits")
    lab = Node(settings)
    of = {
        "/joint_states": ("sensor_msgs/msg/JointState", Quality()),
        "/tf": ("tf2_msgs/msg/TFMessage", Quality(kept=100)),
        "/diagnostics": ("diagnostic_msgs/msg/DiagnosticArray", Quality()),
        "/rosout": ("rcl_interfaces/msg/Log", Quality(lasting=True)),
        "/bench_4/robot": ("std_msgs/msg/String", Quality(kept=1, lasting=True)),
        "/bench_4/why": ("std_msgs/msg/String", LAST),
        "/bench_4/hands": ("geometry_msgs/msg/PoseArray", Quality()),
        "/tf_static": ("tf2_msgs/msg/TFMessage", LAST),
        "/bench_4/scene/bench": ("visualization_msgs/msg/MarkerArray", Quality()),
        "/bench_4/scene/hands": ("visualization_msgs/msg/MarkerArray", Quality()),
        "/bench_4/scene/assembly": ("visualization_msgs/msg/MarkerArray", Quality()),
    }
    hears = {topic: lab.subscription(topic, kind, quality) for topic, (kind, quality) in of.items()}
    heard: dict[str, list[Any]] = {topic: [] for topic in of}
    hold = SafetyDecision(Action.HOLD, 0.0, (("hand_unknown", "where the hand is, is not known"),))
    number = 0

    def all_came() -> bool:
        nonlocal number
        guidance = {"o1": ("p1", "p3")}
        ticked = with_hand(tick(number, hold, Display(message="moving to look", guidance=guidance)))
        scene.tick(ticked, 0)
        topics.tick(ticked)
        topics.message(0.1, "warning", "hold: it is dark")
        number += 1
        for topic, reader in hears.items():
            heard[topic] += reader.take(100)
        return all(heard.values())

    until(all_came)
    joints = heard["/joint_states"][-1]
    assert list(joints.name) == list(load_configuration().robot.joint_names), "as robot_state_publisher knows them"
    assert len(joints.position) == len(joints.velocity) == 6
    [transform] = heard["/tf"][-1].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("world", "tool")
    tool = cell.motion.kinematics.forward(np.array(joints.position))
    assert transform.transform.translation.z == pytest.approx(tool.position_m[2])
    assert transform.transform.rotation.w == pytest.approx(tool.quaternion_wxyz[0])
    assert [one.name for one in heard["/diagnostics"][-1].status] == ["cell", "cell: hand_unknown"]
    values = {one.key: one.value for one in heard["/diagnostics"][-1].status[0].values}
    assert values["tree"] == "RUNNING"
    frames = {one.child_frame_id: one.transform.translation for one in heard["/tf_static"][-1].transforms}
    assert frames.keys() == {"bracket", "tray"}
    assert (frames["bracket"].x, frames["bracket"].y) == BENCH.bracket.position_m[:2]
    bench = heard["/bench_4/scene/bench"][-1].markers
    assert {marker.header.frame_id for marker in bench} == {"world", "bracket"}
    assert {marker.text for marker in bench if marker.text} == set(PRODUCT.positions)
    goals = heard["/bench_4/scene/assembly"][-1].markers
    assert goals[0].action == DELETE_ALL
    assert {marker.ns for marker in goals[1:]} == {"o1 at p1", "o1 at p3"}
    assert all(marker.color.a < 0.5 for marker in goals if marker.type == CUBE)
    [_, hand] = heard["/bench_4/scene/hands"][-1].markers
    assert len(hand.points) == 36, "twelve triangles of a wall"
    assert max(point.z for point in hand.points) > 0.1
    assert heard["/bench_4/why"][-1].data == "a guard waits"
    assert heard["/bench_4/robot"][-1].data == "moving to look"
    assert heard["/rosout"][-1].msg == "hold: it is dark"
    topics.close(Outcome("finished", "the tree is done", 6, 0, 0.3, 0.3))
    assert until(lambda: [one.data for one in hears["/bench_4/robot"].take(10)]) == ["finished: the tree is done"]


def camera(topic: str, **more: Any) -> Ros2Camera:
    return Ros2Camera(Ros2CameraSettings(domain=DOMAIN, topic=topic, **more), WallClock(), BENCH, "overhead")


def picture() -> np.ndarray:
    setup = BENCH.overhead.model
    rng = np.random.default_rng(1)
    return cv2.resize(rng.integers(0, 255, (6, 8, 3), np.uint8), (setup.width_px, setup.height_px))


def sent(image: np.ndarray, encoding: str, **changes: Any) -> Any:
    now_ns = time.time_ns()
    stamp = message("builtin_interfaces/msg/Time")(sec=now_ns // 10**9, nanosec=now_ns % 10**9)
    header = message("std_msgs/msg/Header")(stamp=stamp, frame_id="camera")
    height, width = image.shape[:2]
    fields = {"height": height, "width": width, "encoding": encoding, "is_bigendian": 0, "step": image[0].size}
    return message("sensor_msgs/msg/Image")(header=header, **fields | changes, data=image.tobytes())


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "bgra8"])
@pytest.mark.parametrize("reliable", [True, False])
def test_images_come_in_rgb_with_their_stamp(encoding: str, reliable: bool) -> None:
    topic = f"/camera_{encoding}_{reliable}/image_raw"
    writer = Node(DdsSettings(domain=DOMAIN)).publisher(topic, "sensor_msgs/msg/Image", Quality(reliable=reliable))
    overhead, image = camera(topic), picture()
    raw = {"rgb8": image, "bgr8": image[..., ::-1], "bgra8": np.dstack([image[..., ::-1], image[..., :1]])}[encoding]

    def came() -> Frame | None:
        writer.write(sent(np.ascontiguousarray(raw), encoding))
        try:
            return overhead.latest()
        except DeviceFault:
            return None

    frame = until(came)
    assert np.array_equal(frame.image, image)
    assert abs(overhead._clock.now_s() - frame.time_s) < 5.0
    overhead.close()


def test_compressed_images_are_decoded() -> None:
    topic = "/camera/image_raw/compressed"
    writer = Node(DdsSettings(domain=DOMAIN)).publisher(topic, "sensor_msgs/msg/CompressedImage")
    overhead, image = camera(topic), picture()
    data = cv2.imencode(".png", image[..., ::-1])[1].tobytes()
    header = sent(image, "rgb8").header

    def came() -> Frame | None:
        writer.write(message("sensor_msgs/msg/CompressedImage")(header=header, format="png", data=data))
        try:
            return overhead.latest()
        except DeviceFault:
            return None

    assert np.array_equal(until(came).image, image)
    overhead.close()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"encoding": "16UC1"}, "images are '16UC1', must be rgb8"),
        ({"height": 2**31}, "an image of"),
        ({"step": 3}, "an image of"),
        ({"width": 8, "height": 6, "step": 24}, "an image of"),
    ],
)
def test_an_image_that_cannot_be_is_told(changes: dict[str, Any], words: str) -> None:
    topic = f"/camera_{abs(hash(words + str(changes))) % 10**6}/image_raw"
    writer = Node(DdsSettings(domain=DOMAIN)).publisher(topic, "sensor_msgs/msg/Image")
    overhead = camera(topic, lost_s=0.2)

    def told() -> str:
        writer.write(sent(picture(), **{"encoding": "rgb8", **changes}))
        try:
            overhead.latest()
        except DeviceFault as fault:
            return str(fault)
        return ""

    until(lambda: words in told())
    overhead.close()


def test_a_network_that_is_not_there_and_another_one_are_refused(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match=r"no network 'nothing0' here; there are: .*lo"):
        Node(DdsSettings(domain=DOMAIN + 1, network="nothing0"))
    assert capfd.readouterr().err == ""
    Node(DdsSettings(domain=DOMAIN))
    with pytest.raises(InputError, match=rf"domain {DOMAIN} is on 127\.0\.0\.1 already"):
        Node(DdsSettings(domain=DOMAIN, network="192.0.2.1"))


def test_joints_without_positions_are_nothing_told_of_a_gripper(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever publishes speeds alone, or NaN, on the same topic."""
    monkeypatch.setattr(ActionClient, "there", lambda *_: True)
    settings, kind = (
        Ros2GripperSettings(domain=DOMAIN, namespace="/gripper_4", lost_s=10.0),
        "sensor_msgs/msg/JointState",
    )
    gripper = Ros2Gripper(settings, WallClock(), load_configuration().robot)
    writer = Node(settings).publisher("/gripper_4/joint_states", kind)

    def opens_after(*position: float) -> float:
        about = {"header": empty("std_msgs/msg/Header"), "velocity": [], "effort": []}
        writer.write(message(kind)(name=["other", settings.joint], position=list(position), **about))
        return gripper.state().opening_m

    until(lambda: opens_after(0.0, 0.4) == pytest.approx(0.0421, abs=1e-4))
    for odd in ((), (0.0,), (0.0, math.nan), (0.0, math.inf)):
        assert opens_after(*odd) == pytest.approx(0.0421, abs=1e-4)
    until(lambda: opens_after(0.0, 0.2) == pytest.approx(0.0636, abs=1e-4))
    gripper.close()


def test_a_topic_that_nobody_publishes_is_a_lost_camera() -> None:
    overhead = camera("/nobody/image_raw", lost_s=0.2)

    def told() -> str:
        try:
            overhead.latest()
        except DeviceFault as fault:
            return str(fault)
        return ""

    until(lambda: "nothing comes on /nobody/image_raw" in told())
    overhead.close()
