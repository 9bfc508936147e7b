"""Moves the simulated robot for tests: its own small inverse kinematics, and the gripper by raw CAN frames."""

from __future__ import annotations

from typing import cast

import can
import mujoco
import numpy as np
from cantools.database import load_file
from cantools.database.can import Database

from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.pose import Array, Pose
from bracket_sim.cell import SimCell
from bracket_sim.devices.simulated_gripper import DATABASE

TICK_S = 0.04
OPEN_M = 0.085


def downwards(x_m: float, y_m: float, z_m: float, yaw_rad: float) -> Pose:
    """world_from_tool of a tool that points down, its x axis turned by yaw."""
    flipped = Pose((0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))
    return Pose.from_yaw((x_m, y_m, z_m), yaw_rad) @ flipped


class Rig:
    """A cell, the master's side of its CAN bus, and blocking moves that step simulated time."""

    def __init__(self, cell: SimCell, channel: str) -> None:
        self.cell = cell
        database = load_file(DATABASE)
        assert isinstance(database, Database)
        self.database = database
        self.bus = can.Bus(interface="virtual", channel=channel)
        self.status: dict[str, float] = {}
        self.heartbeats: list[int] = []
        self.emergencies: list[int] = []
        self._scratch = mujoco.MjData(cell.world.model)
        self._request = {"rACT": 1, "rGTO": 0, "rATR": 0, "rARD": 0, "rPR": 85.0, "rSP": 100.0, "rFR": 60.0}

    def close(self) -> None:
        """Let go of cell and bus."""
        self.cell.devices.close()
        self.bus.shutdown()

    def wait(self, duration_s: float) -> None:
        """Let time pass, sending the gripper's command every tick as a master does."""
        clock = self.cell.devices.clock
        end_s = clock.now_s() + duration_s
        while clock.now_s() < end_s - 1e-9:
            self.send()
            self.cell.arm.pace(1.0)
            clock.sleep_until(min(end_s, clock.now_s() + TICK_S))
            self.listen()

    def send(self) -> None:
        """One GripperCommand with the registers as they are."""
        message = self.database.get_message_by_name("GripperCommand")
        data = message.encode(self._request)
        self.bus.send(can.Message(arbitration_id=message.frame_id, data=data, is_extended_id=False))

    def request(self, **values: float) -> None:
        """Change registers of the gripper's command."""
        self._request.update(values)

    def listen(self) -> None:
        """Take in what the node has sent."""
        while (message := self.bus.recv(timeout=0)) is not None:
            name = self.database.get_message_by_frame_id(message.arbitration_id).name
            decoded = self.database.decode_message(message.arbitration_id, bytes(message.data), decode_choices=False)
            values = cast(dict[str, float], decoded)
            if name == "GripperStatus":
                self.status = values
            elif name == "GripperHeartbeat":
                self.heartbeats.append(int(values["NodeState"]))
            else:
                self.emergencies.append(int(values["ErrorCode"]))

    def activate(self) -> None:
        """Set rACT and wait for the full open and close."""
        self.wait(1.5)
        assert self.status["gSTA"] == 3

    def grip(self, opening_m: float, wait_s: float = 0.8) -> None:
        """Go to an opening."""
        self.request(rGTO=1, rPR=opening_m * 1000)
        self.wait(wait_s)

    def move(self, target: Pose, duration_s: float, waypoints: int = 20) -> None:
        """A straight line of the tool, at rest on both ends."""
        start = self.cell.world.tool_pose()
        joints = [np.array(self.cell.arm.state().positions_rad)]
        for share in np.linspace(0, 1, waypoints + 1)[1:]:
            joints.append(self.solve(_between(start, target, share), joints[-1]))
        times: Array = np.linspace(0.0, duration_s, round(duration_s / 0.008) + 1)
        phase = times / times[-1]
        progress = waypoints * (10 * phase**3 - 15 * phase**4 + 6 * phase**5)
        path = np.array(joints)
        columns = [np.interp(progress, range(waypoints + 1), column) for column in path.T]
        self.cell.arm.follow(JointTrajectory(times, np.column_stack(columns)))
        self.wait(times[-1] + 0.1)

    def solve(self, target: Pose, seed_rad: Array) -> Array:
        """Joints that bring the tool to a pose: damped least squares from a near seed."""
        world, data = self.cell.world, self._scratch
        tool = world.model.body("tool").id
        joints = seed_rad.copy()
        for _ in range(100):
            data.qpos[world.arm_qpos] = joints
            mujoco.mj_kinematics(world.model, data)
            mujoco.mj_comPos(world.model, data)
            turn = np.zeros(3)
            mujoco.mju_subQuat(turn, np.array(target.quaternion_wxyz), data.xquat[tool])
            error = np.concatenate([target.position_m - data.xpos[tool], data.xmat[tool].reshape(3, 3) @ turn])
            if np.abs(error).max() < 1e-6:
                return joints
            jacobian = np.zeros((6, world.model.nv))
            mujoco.mj_jacBody(world.model, data, jacobian[:3], jacobian[3:], tool)
            j = jacobian[:, world.arm_qvel]
            joints = joints + j.T @ np.linalg.solve(j @ j.T + 1e-6 * np.eye(6), error)
        raise AssertionError(f"no joints for {target}")


def _between(start: Pose, end: Pose, share: float) -> Pose:
    position = (1 - share) * np.array(start.position_m) + share * np.array(end.position_m)
    a, b = np.array(start.quaternion_wxyz), np.array(end.quaternion_wxyz)
    blend = (1 - share) * a + share * b * (1 if a @ b >= 0 else -1)
    blend /= np.linalg.norm(blend)
    x, y, z = (float(value) for value in position)
    w, i, j, k = (float(value) for value in blend)
    return Pose((x, y, z), (w, i, j, k))
