"""A real node of ROS 2 (Jazzy, rclpy over Fast DDS) hears our topics and answers our calls; it is installed here."""

from __future__ import annotations

import os
import select
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import foxglove
import pytest

from bracket_cell.plant import ros_types
from bracket_cell.plant.dds import SENSOR, Node, waited
from bracket_cell.plant.ros_services import ActionClient, Caller, Status
from bracket_cell.plant.ros_topics import RosTopics
from bracket_cell.plant.ros_types import empty, message
from bracket_cell.recording.scene import SceneLog
from bracket_cell.settings import Ros2Settings
from bracket_cell.skills.drivers.settings import DdsSettings
from bracket_ground.interfaces.faults import Action, SafetyDecision
from tests.cell.plant.test_ros2 import model, tick, with_hand
from tests.processes import started

pytestmark = pytest.mark.slow
DOMAIN = 1 + (os.getpid() + 111) % 200
SHOWN = "visualization-msgs", "diagnostic-msgs"
PACKAGES = ("rclpy", "rmw-fastrtps-cpp", "sensor-msgs", "std-srvs", "test-msgs", *SHOWN)
NODE = """
import time, rclpy
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from diagnostic_msgs.msg import DiagnosticArray
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray
from test_msgs.action import Fibonacci

def run(goal):
    numbers = [0, 1]
    for _ in range(goal.request.order):
        if goal.is_cancel_requested:
            goal.canceled()
            return Fibonacci.Result(sequence=numbers)
        numbers.append(numbers[-1] + numbers[-2])
        goal.publish_feedback(Fibonacci.Feedback(sequence=numbers))
        time.sleep(0.1)
    goal.succeed()
    return Fibonacci.Result(sequence=numbers)

def tell():
    said = JointState(name=["b", "a"], position=[1.0, 2.0], velocity=[0.1, 0.2])
    said.header.stamp = node.get_clock().now().to_msg()
    joints.publish(said)

def answer(asked, answer):
    answer.success, answer.message = True, "real"
    return answer

rclpy.init()
node = rclpy.create_node("real")
node.create_service(Trigger, "/real/trigger", answer)
joints = node.create_publisher(JointState, "/joint_states", 10)
node.create_timer(0.01, tell)
node.create_subscription(JointState, "/from_cell", lambda m: print("heard", *m.name, *m.position, flush=True), 10)
kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
def drawn(m):
    print("drawn", *sorted({f"{k.ns}:{k.header.frame_id}:{k.type}:{len(k.points)}" for k in m.markers}), flush=True)
node.create_subscription(MarkerArray, "/cell/scene/bench", drawn, kept)
node.create_subscription(MarkerArray, "/cell/scene/hands", drawn, 10)
ill = lambda m: print("ill", *[f"{s.name}={s.level[0]}" for s in m.status], flush=True)
node.create_subscription(DiagnosticArray, "/diagnostics", ill, 10)
group = ReentrantCallbackGroup()
taken = lambda goal: GoalResponse.ACCEPT if goal.order < 100 else GoalResponse.REJECT
cancelled = lambda goal: CancelResponse.ACCEPT
ActionServer(node, Fibonacci, "/fib", run, goal_callback=taken, cancel_callback=cancelled, callback_group=group)
executor = MultiThreadedExecutor()
executor.add_node(node)
print("up", flush=True)
executor.spin()
"""


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> Iterator[subprocess.Popen[str]]:
    """A node in an environment of its own."""
    folder = tmp_path_factory.mktemp("ros")
    python, uv = folder / "venv/bin/python", Path(sys.executable).with_name("uv")
    subprocess.run([uv, "venv", "-q", "--python", sys.executable, folder / "venv"], check=True)
    names = [f"ros-jazzy-{name}" for name in PACKAGES]
    subprocess.run([uv, "pip", "install", "-q", "--python", python, *names], check=True)
    changes = {"ROS_DOMAIN_ID": str(DOMAIN), "ROS_LOCALHOST_ONLY": "1"}
    with pytest.MonkeyPatch.context() as patch:
        for name, value in changes.items():
            patch.setenv(name, value)
        with started([str(python), "-c", NODE], folder) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == "up\n"
            yield process


@pytest.fixture
def node(real: subprocess.Popen[str]) -> Node:
    assert real.poll() is None
    return Node(DdsSettings(domain=DOMAIN))


def test_topics_both_ways(node: Node, real: subprocess.Popen[str]) -> None:
    reader = node.subscription("/joint_states", "sensor_msgs/msg/JointState", SENSOR)
    came: Any = waited(reader, 10.0)
    assert (came.name, list(came.position), list(came.velocity)) == (["b", "a"], [1.0, 2.0], [0.1, 0.2])
    assert abs(time.time() - came.header.stamp.sec) < 5
    writer = node.publisher("/from_cell", "sensor_msgs/msg/JointState")
    said = empty("sensor_msgs/msg/JointState")
    said.name, said.position = ["x"], [0.5]
    end_s = time.monotonic() + 10.0
    while not writer.get_matched_subscriptions():
        assert time.monotonic() < end_s
        time.sleep(0.05)
    writer.write(said)
    assert real.stdout is not None
    assert real.stdout.readline() == "heard x 0.5\n"


def test_rviz_and_rqt_are_shown_a_run(real: subprocess.Popen[str]) -> None:
    cell = model()
    scene, hold = (
        SceneLog(foxglove.Context(), cell),
        SafetyDecision(Action.HOLD, 0.0, (("hand_unknown", "where the hand is, is not known"),)),
    )
    topics = RosTopics(Ros2Settings(domain=DOMAIN), cell.motion, scene, str)
    assert real.stdout is not None
    heard: dict[str, set[str]] = {}
    wanted = {
        "ill": {"cell=1", "cell:", "hand_unknown=1"},
        "drawn": {"hand", "0:world:11:36", "bench:world:1:0", "holes:bracket:3:0", "holes:bracket:9:0"},
    }
    end_s, number = time.monotonic() + 20.0, 0
    while any(not some <= heard.get(name, set()) for name, some in wanted.items()):
        assert time.monotonic() < end_s, heard
        ticked = with_hand(tick(number, hold))
        scene.tick(ticked, 0)
        topics.tick(ticked)
        number += 1
        while select.select([real.stdout], [], [], 0.05)[0]:
            name, *words = real.stdout.readline().split()
            heard.setdefault(name, set()).update(words)


def test_a_service_is_called(node: Node) -> None:
    answer = Caller(node, "/real/trigger", "std_srvs/srv/Trigger", "fastrtps").call(10.0)
    assert (answer.success, answer.message) == (True, "real")


def test_an_action_with_feedback_result_refusal_and_cancel(node: Node, monkeypatch: pytest.MonkeyPatch) -> None:
    kind, numbers = "test_msgs/action/Fibonacci", "int32[] sequence"
    for part, text in {"Goal": "int32 order", "Result": numbers, "Feedback": numbers}.items():
        monkeypatch.setitem(ros_types.DEFINITIONS, f"{kind}_{part}", text)
    action, goal = ActionClient(node, "/fib", kind, "fastrtps"), message(f"{kind}_Goal")
    assert action.there(10.0)

    def until(name: bytes, status: Status) -> None:
        end_s = time.monotonic() + 10.0
        while action.status(name) is not status:
            assert time.monotonic() < end_s, action.status(name)
            time.sleep(0.02)

    done = action.send(goal(order=5))
    until(done, Status.SUCCEEDED)
    assert [len(told.sequence) for _, told in action.feedback()] == [3, 4, 5, 6, 7]
    assert list(action.result(done, 10.0).sequence) == [0, 1, 1, 2, 3, 5, 8]
    action.send(goal(order=200))
    end_s = time.monotonic() + 10.0
    while not action.refused():
        assert time.monotonic() < end_s
    under_way = action.send(goal(order=50))
    until(under_way, Status.EXECUTING)
    action.cancel()
    until(under_way, Status.CANCELED)
