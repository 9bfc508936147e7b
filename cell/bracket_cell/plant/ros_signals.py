"""Digital terminals of a UR by ur_robot_driver: io_states in, set_io out."""

from __future__ import annotations

import threading
from typing import Any

from bracket_cell.plant.dds import SENSOR, Node, waited
from bracket_cell.plant.ros_services import Caller
from bracket_cell.skills.drivers.settings import Ros2SignalSettings
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import Clock

STATES, SET_DIGITAL = "ur_msgs/msg/IOStates", 1  # FUN_SET_DIGITAL_OUT
LISTENS_S, ANSWER_S = 0.05, 1.0


class Ros2Signals:
    """Implements `Signals`; a thread listens, and sets outputs until the driver says that they are set."""

    Settings = Ros2SignalSettings

    def __init__(self, settings: Ros2SignalSettings, clock: Clock) -> None:
        node, own = Node(settings), f"{settings.namespace}/io_and_status_controller"
        self._settings, self._clock = settings, clock
        self._slower: float = getattr(clock, "slower", 1.0)
        self._topic = f"{own}/io_states"
        self._reader: Any = node.subscription(self._topic, STATES, SENSOR)
        self._setting = Caller(node, f"{own}/set_io", "ur_msgs/srv/SetIO", settings.middleware)
        self._inputs: dict[str, bool] = {}
        self._outputs: dict[str, bool] = {}
        self._wanted: dict[str, bool] = {}
        self._came_s, self._trouble = clock.now_s(), ""
        self._lock, self._closed = threading.Lock(), threading.Event()
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
            raise DeviceFault(
                "signals", f"no output {name!r}; there are: {', '.join(self._settings.outputs) or 'none'}"
            )
        with self._lock:
            self._wanted[name] = value

    def close(self) -> None:
        """Listen no more."""
        self._closed.set()
        self._thread.join(ANSWER_S * 2)

    def _run(self) -> None:
        while not self._closed.is_set():
            if (came := waited(self._reader, LISTENS_S)) is not None:
                self._note(came)
            self._set()

    def _note(self, came: Any) -> None:
        inputs, outputs = (
            {one.pin: one.state for one in of} for of in (came.digital_in_states, came.digital_out_states)
        )
        with self._lock:
            self._came_s = self._clock.now_s()
            self._inputs = {name: inputs[pin] for name, pin in self._settings.inputs.items() if pin in inputs}
            self._outputs = {name: outputs[pin] for name, pin in self._settings.outputs.items() if pin in outputs}

    def _set(self) -> None:
        with self._lock:
            wanted = dict(self._wanted)
        for name, value in wanted.items():
            pin = self._settings.outputs[name]
            done = self._setting.call(ANSWER_S * self._slower, fun=SET_DIGITAL, pin=pin, state=float(value))
            with self._lock:
                self._trouble = "" if done is not None and done.success else f"{self._setting.name} did not set {name}"
                if not self._trouble and self._wanted.get(name) is value:
                    del self._wanted[name]
                    self._outputs[name] = value
