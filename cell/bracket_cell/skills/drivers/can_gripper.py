"""Driver of a gripper with fingers on CAN: registers in the frames of config/gripper.dbc."""

from __future__ import annotations

import errno
import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import can
from cantools.database.can import Database, Message

from bracket_cell.skills.drivers import gripper_database
from bracket_cell.skills.drivers.settings import CanSettings
from bracket_ground.errors import DeviceFault, LatchedFault, words_of
from bracket_ground.interfaces.can_bus import open_bus
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.command import GripperCommand
from bracket_ground.interfaces.gripper import default_gripper, ranges
from bracket_ground.interfaces.observation import GripperState, NodeState, ObjectStatus
from bracket_ground.interfaces.robot import RobotModel

MISSED_PERIODS = 1.5
KERNEL = "socketcan"  # filters; elsewhere python-can does, and a frame of others would end the reading of a tick
FRAMES_A_TICK = 500  # that are read; what is left waits, and how old it is by then nobody knows
ADOPTED_FORCE_N = 60.0  # the status does not tell with what force an adopted gripper holds
KEEP_ALIVE_S = 0.08  # the gripper faults after 1 s without a command, and a lost command is repeated by this
UNHEARD_S = 0.06  # what was sent comes back by the next tick on a bus that echoes
MAJOR_FAULT = 0x08  # lower values of gFLT only say that a command came before activation
NO_COMMUNICATION = 0x09
ADOPTION_S = 0.2  # until when an adopted gripper may say that it has heard nothing: it had no master
INTERNAL_FAULT = 0x0C
ACTIVE = 3  # gSTA
WORDS, APART_MM = ("gACT", "gGTO", "gSTA", "gPR"), 6.0  # by which statuses of two nodes are told apart
FLIPS, FLIPS_S = 2, 2.0  # so often within this time: one may be a command that was taken back
ECHOES_S = 0.1  # until when a status may echo a request that another one has followed: two ticks, and a status period
ECHO = (("gACT", "rACT"), ("gGTO", "rGTO"), ("gPR", "rPR"))
NODE_STATES: Mapping[int, NodeState] = {0x00: "boot_up", 0x04: "stopped", 0x05: "operational", 0x7F: "pre_operational"}


@dataclass(frozen=True)
class CanFrame:
    """One frame as it went over the bus, for the recorder.

    Attributes:
        sent: by the driver; otherwise received.
    """

    time_s: float
    identifier: int
    data: bytes
    sent: bool


Tap = Callable[[CanFrame], None]


class CanGripper:
    """Implements `Gripper`; everything received is read when `state` is called, nothing runs in between.

    A gripper that is active already is adopted as it is: the first status tells what it was asked for, and its fingers
    stay where they are. One that restarts is left alone: nothing activates it again but `activate`. On a bus that
    echoes what is sent, a frame that does not come back did not go out. Frames of others are passed over.

    Args:
        bus: opened already; by default the one that the settings name.

    Attributes:
        ignored_frames: received frames of another master, of the wrong length, or that the database does not explain.
    """

    Settings = CanSettings

    def __init__(
        self, settings: CanSettings, clock: Clock, bus: can.BusABC | None = None, robot: RobotModel | None = None
    ) -> None:
        gripper = default_gripper() if robot is None else robot.gripper
        database = gripper_database.load_gripper_database(settings.database or gripper_database.SHIPPED, gripper)
        self._database = database
        self._command = database.get_message_by_name(gripper_database.COMMAND)
        told = (gripper_database.STATUS, gripper_database.HEARTBEAT, gripper_database.EMERGENCY)
        self._received = {message.frame_id: message for message in map(database.get_message_by_name, told)}
        self._meanings: Mapping[int, object] = dict(
            database.get_message_by_name(gripper_database.STATUS).get_signal_by_name("gFLT").choices or {}
        )
        self._bus = bus or open_bus(settings.interface, settings.channel, settings.bitrate, echo=True)
        self._wanted = {*self._received, self._command.frame_id}
        if settings.interface == KERNEL:
            self._bus.set_filters([{"can_id": one, "can_mask": 0x7FF, "extended": False} for one in self._wanted])
        self._clock, self._settings = clock, settings
        self._tap: Tap = lambda _: None
        self._ranges = ranges(gripper)
        starts = {"rPR": self._ranges["rPR"][1], "rSP": self._ranges["rSP"][0], "rFR": self._ranges["rFR"][0]}
        self._request = {"rACT": 0.0, "rGTO": 0.0, "rATR": 0.0, "rARD": 0.0, **starts}
        self._sent_s: float | None = None
        self._echoes = False  # the bus has done so
        self._unheard_s: float | None = None  # when the oldest frame was sent that did not come back
        self._full_s: float | None = None  # since when the queue of what is to be sent is full
        self._opened_s: float | None = None  # when it was asked first: before, nobody waited for the node
        self._heartbeat_s: float | None = None
        self._status: Mapping[str, float] | None = None
        self._status_s = clock.now_s()
        self._told = False  # a status came in this tick
        self._lost = False  # it told nothing, and no status came since
        self._talk: deque[Mapping[str, float]] = deque(maxlen=2)  # the last statuses that differ
        self._asked: deque[tuple[float, bytes]] = deque(maxlen=5)  # the last requests, and when each was sent first
        self._flips_s: deque[float] = deque([-math.inf] * FLIPS, maxlen=FLIPS)  # when statuses went there and back
        self._late = self._other_master = self._restarted = False
        self._errors: list[str] = []  # of this tick
        self._node_states: deque[NodeState] = deque(maxlen=3)  # from the heartbeats
        self._emergency = self._worst = 0  # as last told; the gravest that came in this tick
        self._node_state: NodeState = "unknown"
        self._adopted_s: float | None = None
        self.ignored_frames = 0

    def tap(self, tap: Tap) -> None:
        """Tell of every frame from now on, in both directions."""
        self._tap = tap

    def change_bus(self, change: Callable[[can.BusABC, Database], can.BusABC]) -> None:
        """Go on by another bus, such as one with a fault; `change` is also given the frames' database."""
        self._bus = change(self._bus, self._database)

    def state(self) -> GripperState:
        """Read the waiting frames.

        Raises:
            LatchedFault: a major fault.
            DeviceFault: no heartbeat, or a dead or deaf bus, which may come back.
        """
        try:
            self._drain()
            if not self._late:  # else they may wait behind other frames; the status grows old meanwhile
                self._check_heartbeat()
        except DeviceFault:
            self._lost = True
            raise
        self._keep_alive()
        if not self._late:
            self._check_echo()
        if self._status is None:
            unknown = GripperState(self._status_s, False, ObjectStatus.MOVING, self._ranges["rPR"][1] / 1000, 0.0, 0)
            return self._with_bus(unknown, echoed=self._sent_s is None)
        fault = max(int(self._status["gFLT"]), self._emergency, self._worst)
        if fault >= MAJOR_FAULT and not (fault == NO_COMMUNICATION and self._just_adopted):
            kind = DeviceFault if fault == NO_COMMUNICATION else LatchedFault
            raise kind("gripper", f"fault 0x{fault:02X}: {self._meanings.get(fault, 'unknown')}")
        # Else it is an old answer, to be taken for no new one.
        echoed = self._echoed(self._status, self._command.encode(self._request))
        state = GripperState(
            self._status_s,
            self._status["gSTA"] == ACTIVE and not self._restarted,
            ObjectStatus(int(self._status["gOBJ"])) if echoed else ObjectStatus.MOVING,
            self._status["gPO"] / 1000,
            self._status["gCU"],
            fault,
        )
        return self._with_bus(state, echoed=echoed or self._sent_s is None)

    def activate(self) -> None:
        """Begin activation; takes a full open and close."""
        self._restarted = False
        self._request |= {"rACT": 1.0, "rGTO": 0.0}
        self._send()

    def command(self, command: GripperCommand) -> GripperCommand:
        """Start a motion; values beyond the registers' range are cut to it."""
        self._request |= {
            "rGTO": 1.0,
            "rPR": _clamped(command.opening_m * 1000, self._ranges["rPR"]),
            "rSP": _clamped(command.speed_m_s * 1000, self._ranges["rSP"]),
            "rFR": _clamped(command.force_n, self._ranges["rFR"]),
        }
        sent = _decoded(self._command, self._send())
        return GripperCommand(sent["rPR"] / 1000, sent["rSP"] / 1000, sent["rFR"])

    def hold(self) -> None:
        """Clear rGTO: the fingers stop and keep their grip."""
        self._request |= {"rGTO": 0.0}
        self._send()

    def close(self) -> None:
        """Let go of the bus."""
        self._bus.shutdown()

    def _with_bus(self, state: GripperState, *, echoed: bool) -> GripperState:
        """With what is known of the node and its bus."""
        return replace(
            state,
            node_state=self._node_state,
            echoed=echoed,
            other_master=self._other_master,
            bus_errors=", ".join(dict.fromkeys(self._errors)),
            two_nodes=self._clock.now_s() - self._flips_s[0] <= FLIPS_S,
        )

    def _drain(self) -> None:
        self._told = self._other_master = False
        self._errors, self._worst = [], 0
        try:
            for _ in range(FRAMES_A_TICK):
                if (message := self._bus.recv(timeout=0)) is None:
                    self._late = False
                    return
                self._receive(message)
        except (can.CanError, OSError) as error:
            raise DeviceFault("gripper", f"reading the CAN bus failed: {words_of(error)}") from error
        self._late = True
        self._errors.append(f"more than {FRAMES_A_TICK} frames wait")

    def _receive(self, message: can.Message) -> None:
        if message.is_error_frame:
            self._errors.append("error frames")
            return
        if message.arbitration_id not in self._wanted:
            return
        if message.arbitration_id == self._command.frame_id and not message.is_extended_id:
            if message.is_rx:
                self._other_master = True
                self.ignored_frames += 1
            else:
                self._echoes, self._unheard_s = True, None
            return
        now = self._clock.now_s()
        data = bytes(message.data)
        self._tap(CanFrame(now, message.arbitration_id, data, sent=False))
        known = self._received.get(message.arbitration_id)
        odd = message.is_remote_frame or message.is_extended_id
        if known is None or odd or len(data) != known.length:
            self.ignored_frames += 1
            return
        values = _decoded(known, data)
        if known.name == gripper_database.HEARTBEAT:
            self._take_heartbeat(int(values["NodeState"]))
            self._heartbeat_s = now
        elif known.name == gripper_database.EMERGENCY:
            # A node that names no gFLT but an error code has broken down in some other way.
            self._emergency = (int(values["FaultStatus"]) or INTERNAL_FAULT) if values["ErrorCode"] else 0
            self._worst = max(self._worst, self._emergency)
        else:
            self._lost = False
            self._take_status(values)
            self._listen(values)
            self._status, self._told = values, True
            if not self._late:
                self._status_s = now

    def _take_heartbeat(self, code: int) -> None:
        """Notice a node that has restarted, whatever its status says, and two that speak in turn."""
        state = NODE_STATES.get(code, "unknown")
        if state == "unknown":
            self._errors.append(f"a heartbeat tells the state {code}, which there is not")
        if state == "boot_up" and self._heartbeat_s is not None:  # the first one is no restart
            self._restarted |= self._status is not None and self._sent_s is not None
            self._forget_activation()
        if (
            len(self._node_states) == 3
            and state == self._node_states[1] != self._node_states[2] == self._node_states[0]
        ):
            self._errors.append("heartbeats contradict one another")
        self._node_states.append(state)
        self._node_state = state

    def _take_status(self, status: Mapping[str, float]) -> None:
        """Adopt a gripper that is active already, and notice one that has restarted."""
        if self._status is None and self._sent_s is None and status["gSTA"] == ACTIVE:
            self._request |= {"rACT": 1.0, "rGTO": status["gGTO"], "rPR": status["gPR"], "rFR": ADOPTED_FORCE_N}
            self._adopted_s = self._clock.now_s()
            self._send()
        elif self._status is not None and self._status["gACT"] and not status["gACT"]:
            self._forget_activation()

    def _listen(self, status: Mapping[str, float]) -> None:
        """Notice two nodes that speak in turn: what one of them tells cannot change and change back at once."""
        if self._talk and not _differ(status, self._talk[-1]):
            self._talk[-1] = status
            return
        back = len(self._talk) == 2 and not _differ(status, self._talk[0])
        if back and not (self._asked_for(status) and any(status[name] != self._talk[-1][name] for name in WORDS)):
            self._flips_s.append(self._clock.now_s())
        self._talk.append(status)

    def _asked_for(self, status: Mapping[str, float]) -> bool:
        """Whether a status echoes a request of late: fingers that are held and go on are no second node."""
        now_s = self._clock.now_s()
        until_s = [*(sent_s for sent_s, _ in self._asked), now_s][1:]
        late = [data for (_, data), end_s in zip(self._asked, until_s, strict=True) if now_s - end_s <= ECHOES_S]
        return any(self._echoed(status, data) for data in late)

    @property
    def _just_adopted(self) -> bool:
        return self._adopted_s is not None and self._clock.now_s() - self._adopted_s <= ADOPTION_S

    def _forget_activation(self) -> None:
        """The node has lost what it was told: repeating it would open and close the fingers unasked."""
        self._request |= {"rACT": 0.0, "rGTO": 0.0}
        self._sent_s = self._full_s = None

    def _check_heartbeat(self) -> None:
        now = self._clock.now_s()
        if self._heartbeat_s is None:
            self._opened_s = now if self._opened_s is None else self._opened_s
            if now - self._opened_s > self._settings.start_up_s:
                raise DeviceFault("gripper", f"no heartbeat within {self._settings.start_up_s} s of opening the bus")
            return
        limit = MISSED_PERIODS * self._settings.heartbeat_period_s
        if now - self._heartbeat_s > limit + 1e-6:
            raise DeviceFault("gripper", f"no heartbeat for {now - self._heartbeat_s:.3f} s, limit {limit:.3f} s")

    def _keep_alive(self) -> None:
        """Only right after a status, which would tell of a restart: a command would activate the node anew.

        Where another master has spoken, the next status tells what of it.
        """
        if self._full_s is not None and (self._told or self._clock.now_s() - self._full_s < KEEP_ALIVE_S):
            self._send()
        due = self._sent_s is not None and self._clock.now_s() - self._sent_s >= KEEP_ALIVE_S
        if due and self._told and not self._other_master:
            self._send()

    def _check_echo(self) -> None:
        if not self._echoes or self._unheard_s is None:
            return
        gone_s = self._clock.now_s() - self._unheard_s
        if gone_s > UNHEARD_S:
            raise DeviceFault("gripper", f"commands do not go out over the CAN bus: the last one {gone_s:.2f} s ago")

    def _echoed(self, status: Mapping[str, float], data: bytes) -> bool:
        asked = _decoded(self._command, data)
        return all(status[field] == asked[sent] for field, sent in ECHO)

    def _send(self) -> bytes:
        if self._lost:  # it may have restarted, and would be activated anew
            raise DeviceFault("gripper", "nothing is sent before it tells its status again")
        data = self._command.encode(self._request)
        message = can.Message(arbitration_id=self._command.frame_id, data=data, is_extended_id=False)
        try:
            self._bus.send(message)
        except (can.CanError, OSError) as error:
            if not self._waits(error):
                raise DeviceFault("gripper", f"writing to the CAN bus failed: {words_of(error)}") from error
            return data
        self._full_s = None
        self._sent_s = self._clock.now_s()
        if not self._asked or self._asked[-1][1] != data:
            self._asked.append((self._sent_s, data))
        self._unheard_s = self._sent_s if self._unheard_s is None else self._unheard_s
        self._tap(CanFrame(self._sent_s, self._command.frame_id, data, sent=True))
        return data

    def _waits(self, error: Exception) -> bool:
        """Whether only the queue is full, as where an adapter is busy for a moment: the next tick sends it again."""
        now = self._clock.now_s()
        codes = getattr(error, "error_code", None), getattr(error, "errno", None)
        self._full_s = now if self._full_s is None else self._full_s
        self._errors.append("the queue of what is to be sent is full")
        return errno.ENOBUFS in codes and now - self._full_s < KEEP_ALIVE_S


def _differ(status: Mapping[str, float], other: Mapping[str, float]) -> bool:
    """Whether two statuses are not of one gripper at about one time."""
    words = any(status[name] != other[name] for name in WORDS)
    return words or abs(status["gPO"] - other["gPO"]) > APART_MM


def _decoded(message: Message, data: bytes) -> dict[str, float]:
    """Physical values by signal."""
    values = message.decode(data, decode_choices=False)
    assert isinstance(values, dict)
    return {name: float(value) for name, value in values.items()}  # type: ignore[arg-type]  # choices are off


def _clamped(value: float, limits: tuple[float, float]) -> float:
    return min(max(value, limits[0]), limits[1])
