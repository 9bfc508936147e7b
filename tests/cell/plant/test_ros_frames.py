"""What a lab tells of places: frames of tf, mounts of cameras, and obstacles of its planning scene."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from bracket_cell.commands.main import main
from bracket_cell.configuration import DEFAULT_CONFIGURATION, load_configuration
from bracket_cell.skills.drivers.settings import DdsSettings, Ros2ArmSettings, Ros2CameraSettings
from bracket_ground.interfaces.pose import Pose

pytest.importorskip("cyclonedds", reason="the extra ros2 is not installed")

from bracket_cell.plant import ros_obstacles
from bracket_cell.plant.dds import Node, Quality
from bracket_cell.plant.ros_camera import _mount
from bracket_cell.plant.ros_frames import Frames
from bracket_cell.plant.ros_scene import TF
from bracket_cell.plant.ros_services import Answerer
from bracket_cell.plant.ros_types import empty, message

DOMAIN = 1 + (os.getpid() + 37) % 200
CONFIGURATION = load_configuration()
BASE_FROM_SHELF = Pose((0.5, 0.2, 0.1), (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))  # turned by 90 degrees
CAMERA = Ros2CameraSettings(topic="/camera/image_raw", info="/camera/camera_info", frame="tool0")


def transform(parent: str, child: str, pose: Pose) -> Any:
    stamped, (w, x, y, z) = empty("geometry_msgs/msg/TransformStamped"), pose.quaternion_wxyz
    stamped.header.frame_id, stamped.child_frame_id = parent, child
    stamped.transform.translation = message("geometry_msgs/msg/Vector3")(*map(float, pose.position_m))
    stamped.transform.rotation = message("geometry_msgs/msg/Quaternion")(*map(float, (x, y, z, w)))
    return stamped


@contextmanager
def told(*frames: Any) -> Iterator[Node]:
    """A lab that tells frames for good."""
    node = Node(DdsSettings(domain=DOMAIN))
    still = node.publisher("/tf_static", TF, Quality(kept=100, lasting=True))
    still.write(message(TF)(transforms=list(frames)))
    yield node
    del still


def test_frames_are_chained_by_what_they_hang_from() -> None:
    first, second = Pose((1.0, 0.0, 0.5)), Pose.from_yaw((0.0, 2.0, 0.0), 0.3)
    odd = transform("base", "odd", first)
    odd.transform.rotation.w = float("nan")
    ring = [transform("ring_a", "ring_b", first), transform("ring_b", "ring_a", first)]
    with told(transform("/world", "base", first), transform("base", "camera", second), odd, *ring) as node:
        frames = Frames(node)
        found = frames.pose("world", "camera", 10.0)
        assert found is not None
        assert np.allclose(found.matrix, (first @ second).matrix)
        back = frames.pose("camera", "world", 0.0)
        assert back is not None
        assert np.allclose(back.matrix, (first @ second).inverse().matrix)
        assert frames.pose("base", "base", 0.0) == Pose((0.0, 0.0, 0.0))
        for unknown in ("odd", "ring_a", "nowhere"):
            assert frames.pose("world", unknown, 0.0) is None


def remedy(found: Pose | None, role: str = "wrist") -> str:
    return _mount(found, "optical", CONFIGURATION.bench, role, CAMERA, CONFIGURATION.robot).remedy


def test_a_mount_by_tf_is_compared_from_the_flange() -> None:
    flange_from_tool = Pose((0.0, 0.0, CONFIGURATION.robot.gripper.tcp_from_flange_m))
    right = flange_from_tool @ CONFIGURATION.bench.wrist.mount.pose
    assert remedy(right) == ""
    assert remedy(None) == "/tf and /tf_static do not tell it"
    assert remedy(CONFIGURATION.bench.overhead.mount.pose, "overhead") == ""
    beside = Pose((0.0, 0.02, 0.0)) @ right
    assert remedy(beside).startswith("20 mm and 0.0 degrees from the bench file's; by tf mount: {position_m: [")
    turned = right @ Pose.from_yaw((0.0, 0.0, 0.0), 0.05)
    assert remedy(turned).startswith("0 mm and 2.9 degrees")


def pose_message(position_m: tuple[float, float, float]) -> Any:
    made = empty("geometry_msgs/msg/Pose")  # its quaternion of zeros is not turned
    made.position = message("geometry_msgs/msg/Point")(*position_m)
    return made


def thing(name: str, frame: str, kind: int = 1, size: tuple[float, ...] = (0.2, 0.1, 0.3)) -> Any:
    made = empty("moveit_msgs/msg/CollisionObject")
    made.id, made.header.frame_id, made.pose = name, frame, pose_message((0.1, 0.0, 0.0))
    made.primitives = [message("shape_msgs/msg/SolidPrimitive")(kind, list(size), empty("geometry_msgs/msg/Polygon"))]
    made.primitive_poses = [pose_message((0.0, 0.0, 0.15))]
    return made


def mesh() -> Any:
    made = empty("moveit_msgs/msg/CollisionObject")
    made.id, made.header.frame_id, made.pose = "a mesh", "base_link", pose_message((0.0, -0.6, 0.0))
    corners = [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, 0.0, 0.3)]
    made.meshes = [message("shape_msgs/msg/Mesh")([], [message("geometry_msgs/msg/Point")(*at) for at in corners])]
    made.mesh_poses = [pose_message((0.0, 0.0, 0.0))]
    return made


def damaged() -> Iterator[tuple[Any, str]]:
    """What a stranger's scene may hold, and what is said of it."""
    yield thing("thin", "base_link", size=(0.2, 0.0, 0.3)), "thin: box_m.1 is 0.0, which bench.obstacles does not take"
    yield thing("short", "base_link", size=(0.2,)), "short: a shape of type 1 with 1 numbers"
    yield thing("x" * 99, "base_link"), f"{'x' * 99}: name is "
    yield thing("odd", "base_link", size=(0.2, float("nan"), 0.3)), "odd: box_m.1 is nan, which"
    poseless, empty_mesh, lost = thing("poseless", "base_link"), mesh(), thing("lost", "base_link")
    poseless.primitive_poses = []
    yield poseless, "poseless: it has not as many poses as shapes"
    empty_mesh.meshes[0].vertices = []
    yield empty_mesh, "a mesh: a mesh has no corners"
    lost.pose.position.x = float("inf")
    yield lost, "lost: a pose has numbers that are none"


def test_what_is_damaged_is_left_out_in_words() -> None:
    settings = Ros2ArmSettings(domain=DOMAIN, middleware="cyclonedds")
    things, said = zip(*damaged(), strict=True)
    with move_group(*things, thing("good", "base_link")):
        found, left_out = ros_obstacles.planning_scene(settings)
    assert [obstacle.name for obstacle in found] == ["good"]
    assert all(told.startswith(begin) for told, begin in zip(left_out, said, strict=True)), left_out


@contextmanager
def move_group(*things: Any) -> Iterator[None]:
    """Answers get_planning_scene as move_group does, with rmw_cyclonedds_cpp's numbers."""
    over = threading.Event()
    answerer = Answerer(Node(DdsSettings(domain=DOMAIN)), "/get_planning_scene", ros_obstacles.SERVICE)
    scene = empty("moveit_msgs/msg/PlanningScene")
    scene.world.collision_objects = list(things)

    def answer() -> None:
        while not over.wait(0.02):
            for asked in answerer.asked():
                answerer.reply(asked, scene=scene)

    thread = threading.Thread(target=answer)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A cell behind ROS 2 whose bench has a post and an old box."""
    data = yaml.safe_load(DEFAULT_CONFIGURATION.read_text())
    data["product"] = str(DEFAULT_CONFIGURATION.with_name("products.yaml"))
    data["devices"] = {
        "arm": {"kind": "ros2", "domain": DOMAIN, "middleware": "cyclonedds"},
        **{role: {"kind": "ros2", "domain": DOMAIN, "topic": f"/{role}/image_raw"} for role in ("overhead", "wrist")},
    }
    post = {"name": "the post", "position_m": [0.9, 0.5, 0.2], "cylinder_m": [0.05, 0.4]}
    data["bench"]["obstacles"] = [post, {"name": "box", "position_m": [0.0, 0.9, 0.1], "box_m": [0.1, 0.1, 0.1]}]
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


def test_obstacles_come_from_the_planning_scene(
    config: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ros_obstacles, "TOLD_S", 3.0)
    lost, prism = thing("lost", "nowhere"), thing("a prism", "base_link", kind=5)
    ball, drum = thing("ball", "base_link", 2, (0.1,)), thing("drum", "base_link", 3, (0.4, 0.1))
    things = thing("box", "shelf"), ball, drum, mesh(), lost, prism
    with told(transform("base_link", "shelf", BASE_FROM_SHELF)), move_group(*things):
        assert main(["setup", "teach", "obstacles", "--config", str(config)]) == 1, "something was left out"
    said = capsys.readouterr()
    assert "left out: lost: /tf tells no way from base_link to its frame 'nowhere'" in said.out + said.err
    assert "left out: a prism: a shape of type 5 with 3 numbers is not known" in said.out + said.err
    found = {obstacle.name: obstacle for obstacle in load_configuration(config).bench.obstacles}
    assert list(found) == ["the post", "box", "ball", "drum", "a mesh"]
    expected = BASE_FROM_SHELF @ Pose((0.1, 0.0, 0.15))
    assert found["box"].box_m == (0.2, 0.1, 0.3)
    assert np.allclose(found["box"].pose.matrix, expected.matrix)
    assert found["ball"].cylinder_m == (0.2, 0.2)
    assert found["drum"].cylinder_m == (0.2, 0.4)
    assert found["a mesh"].box_m == (0.1, 0.2, 0.3)
    assert np.allclose(found["a mesh"].position_m, (0.05, -0.5, 0.15))


def refused(config: Path, capsys: pytest.CaptureFixture[str], also: Callable[[], None] = lambda: None) -> str:
    before = config.read_text()
    also()
    assert main(["setup", "teach", "obstacles", "--config", str(config)]) != 0
    assert config.read_text() == before
    said = capsys.readouterr()
    assert "Traceback" not in said.err
    return " ".join((said.out + said.err).split())


def test_without_move_group_nothing_is_written(
    config: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ros_obstacles, "ANSWER_S", 0.2)
    said = refused(config, capsys)
    assert f"no node answers /get_planning_scene in domain {DOMAIN}: is move_group running?" in said


def test_another_kind_of_arm_has_no_planning_scene(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = yaml.safe_load(config.read_text())
    data["devices"]["arm"] = {"kind": "ur", "host": "192.0.2.1"}
    config.write_text(yaml.safe_dump(data))
    assert "devices.arm: obstacles come by an arm of kind ros2" in refused(config, capsys)
