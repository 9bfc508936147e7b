"""Digital terminals of a UR by ur_robot_driver: io_states in, set_io out."""

from __future__ import annotations

import threading
import time
from typing import Any

from bracket_cell.plant.dds import SENSOR, Node, waited
from bracket_cell.plant.ros_services import Caller
from bracket_cell.skills.drivers.settings import Ros2SignalSettings
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import Clock

STATES, SET_DIGITAL = "ur_msgs/msg/IOStates", 1  # FUN_SET_DIGITAL_OUT
LISTENS_S, ANSWER_S = 0.02, 0.4  # [s] for a message; of an answer to each request
FIRST_S = 5  # times an answer's: the first message, and the service, must be found in


class Ros2Signals:
    """Implements `Signals`; a thread listens, and sets outputs until the driver says that they are set.

    Raises:
        DeviceFault: nothing is told of the terminals, or nobody sets them.
    """

    Settings = Ros2SignalSettings

    def __init__(self, settings: Ros2SignalSettings, clock: Clock) -> None:
        node, own = Node(settings), f"{settings.namespace}/io_and_status_controller"
        self._settings, self._clock = settings, clock
        self._answer_s: float = ANSWER_S * getattr(clock, "slower", 1.0)
        self._topic = f"{own}/io_states"
        self._reader: Any = node.subscription(self._topic, STATES, SENSOR)
        self._setting = Caller(node, f"{own}/set_io", "ur_msgs/srv/SetIO", settings.middleware)
        self._inputs: dict[str, bool] = {}
        self._outputs: dict[str, bool] = {}
        self._wanted: dict[str, bool] = {}
        self._asked: tuple[str, bool, float] | None = None  # the output that is being set, and since when
        self._trouble = ""
        self._lock, self._closed = threading.Lock(), threading.Event()
        if (first := waited(self._reader, FIRST_S * self._answer_s)) is None:
            raise DeviceFault("signals", f"nothing comes on {self._topic}")
        self._note(first)
        if settings.outputs and not self._setting.there(FIRST_S * self._answer_s):
            raise DeviceFault("signals", f"no node has the service {self._setting.name}")
        self._thread = threading.Thread(target=self._run, name="signals", daemon=True)
        self._thread.start()

    def read(self) -> dict[str, bool]:
        """All inputs and outputs as last told.

        Raises:
            DeviceFault: nothing comes, or an output is not set.
        """
        with self._lock:
            silent_s = self._clock.now_s() - self._came_s
            if silent_s > self._settings.timeout_s:
                raise DeviceFault("signals", f"nothing comes on {self._topic} for {silent_s:.1f} s")
            if self._trouble:
                raise DeviceFault("signals", self._trouble)
            return self._inputs | self._outputs | self._wanted

    def write(self, name: str, value: bool) -> None:
        """Set an output.

        Raises:
            DeviceFault: there is no such output.
        """
        if name not in self._settings.outputs:
            legal = ", ".join(self._settings.outputs) or "none"
            raise DeviceFault("signals", f"no output {name!r}; there are: {legal}")
        with self._lock:
            self._wanted[name] = value

    def close(self) -> None:
        """Listen no more."""
        self._closed.set()
        self._thread.join(2 * LISTENS_S + 1.0)

    def _run(self) -> None:
        while not self._closed.is_set():
            if (came := waited(self._reader, LISTENS_S)) is not None:
                self._note(came)
            self._set()

    def _note(self, came: Any) -> None:
        told = came.digital_in_states, came.digital_out_states
        inputs, outputs = ({pin.pin: pin.state for pin in of} for of in told)
        with self._lock:
            self._came_s = self._clock.now_s()
            self._inputs = {name: inputs[pin] for name, pin in self._settings.inputs.items() if pin in inputs}
            self._outputs = {name: outputs[pin] for name, pin in self._settings.outputs.items() if pin in outputs}

    def _set(self) -> None:
        """Have one output set, and meanwhile listen on; whatever is not set is asked for again."""
        with self._lock:
            wanted = next(iter(self._wanted.items()), None)
        if self._asked is None and wanted is not None:
            name, value = wanted
            self._setting.ask(fun=SET_DIGITAL, pin=self._settings.outputs[name], state=float(value))
            self._asked = name, value, time.monotonic()
        if self._asked is None:
            return
        name, value, since_s = self._asked
        done = self._setting.answer(1e-3)
        if done is None and time.monotonic() - since_s < self._answer_s:
            return
        self._asked = None
        with self._lock:
            self._trouble = "" if done is not None and done.success else f"{self._setting.name} did not set {name}"
            if not self._trouble and self._wanted.get(name) is value:
                del self._wanted[name]
                self._outputs[name] = value
