"""Messages and beeps to people, digital signals to and from other machines, notes for the log."""

from __future__ import annotations

from enum import Enum

from bracket_cell.trees.nodes.services import CellNode
from bracket_cell.trees.vocabulary import OutputSignal, Signal
from btxml.engine.errors import NodeError
from btxml.engine.node import FAILURE, RUNNING, SUCCESS
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits

KNOWN_WITHIN_S = 1.0  # a module that was just started has not told its inputs yet


class SignalNode(CellNode):
    """Base of the nodes that read a signal."""

    abstract = True

    signal = InputPort(Signal, "its name in the configuration")
    value = InputPort(bool, "on (true) or off", default=True)

    def is_so(self) -> bool:
        """Whether the signal has the value.

        Raises:
            NodeError: nothing is known of it.
        """
        known, name = self.now.observation.signals, self.signal.get()
        if name not in known:
            raise NodeError(f"the state of this signal is unknown: {name!r}; known: {', '.join(known) or 'none'}")
        self.feedback_message = f"{name} is {'on' if known[name] else 'off'}"
        self.what_if = f"if {name} were {'off' if known[name] else 'on'}"
        return known[name] == self.value.get()


class SignalIs(SignalNode):
    """A signal is on, or off."""

    node_type = "Condition"
    traits = Traits(instant=True)

    def update(self) -> Status:
        return SUCCESS if self.is_so() else FAILURE


class WaitForSignal(SignalNode):
    """Wait until a signal is on, or off."""

    timeout_s = InputPort(float, "longest wait in [s]; 0 waits for ever", default=0.0, least=0)

    _begun_s = 0.0

    def initialise(self) -> None:
        self._begun_s = self.now.observation.time_s

    def update(self) -> Status:
        seen, timeout_s = self.now.observation, self.timeout_s.get()
        waited_s = seen.time_s - self._begun_s
        if self.signal.get() not in seen.signals and waited_s <= KNOWN_WITHIN_S:
            self.feedback_message = "waits for the module"
            return RUNNING
        if self.is_so():
            return SUCCESS
        return FAILURE if timeout_s > 0 and waited_s > timeout_s else RUNNING


class SetSignal(CellNode):
    """Set an output; it keeps its value until it is set again, also after the run."""

    signal = InputPort(OutputSignal, "its name in the configuration")
    value = InputPort(bool, "on (true) or off", default=True)
    timeout_s = InputPort(float, "longest wait until it is set in [s]", default=1.0, least=0)

    _begun_s = 0.0

    def initialise(self) -> None:
        name, known = self.signal.get(), self.now.observation.signals
        if name not in known:
            raise NodeError(f"the state of this signal is unknown: {name!r}; known: {', '.join(known) or 'none'}")
        self._begun_s = self.now.observation.worked_s

    def update(self) -> Status:
        services, name, value = self.services, self.signal.get(), self.value.get()
        if services.now.observation.signals.get(name) == value:
            self.feedback_message = f"{name} is {'on' if value else 'off'}"
            return SUCCESS
        self.feedback_message = f"sets {name}"
        services.now.command.signals = {**services.now.command.signals, name: value}
        late = self.compare(services.now.observation.worked_s - self._begun_s, ">", self.timeout_s)
        return FAILURE if late else RUNNING


class Weight(Enum):
    """How much a message matters."""

    info = "info"
    warning = "warning"
    error = "error"


class CameraName(Enum):
    """Cameras of the cell."""

    overhead = "overhead"
    wrist = "wrist"


class ShowMessage(CellNode):
    """Show a text at the bench."""

    traits = Traits(instant=True)

    text = InputPort(str, "what to show", least=1)

    def update(self) -> Status:
        self.feedback_message = self.text.get()
        self.now.show(message=self.text.get())
        return SUCCESS


class Beep(CellNode):
    """Sound the bell at the bench once."""

    traits = Traits(instant=True)

    def update(self) -> Status:
        self.now.show(beeps=self.now.display.beeps + 1)
        return SUCCESS


class LogMessage(CellNode):
    """Write a text into the log."""

    traits = Traits(instant=True)

    text = InputPort(str, "what to write", least=1)
    weight = InputPort(Weight, "info, warning or error", default=Weight.info)

    def update(self) -> Status:
        self.feedback_message = self.text.get()
        self.tools.journal.note("message", text=self.text.get(), weight=self.weight.get().value)
        return SUCCESS


class TakeSnapshot(CellNode):
    """Wait for the next picture of a camera and mark it in the log; `cell lab snapshots` writes it as a file."""

    camera = InputPort(CameraName, "overhead or wrist", default=CameraName.overhead)
    label = InputPort(str, "what it is a picture of", default="")
    timeout_s = InputPort(float, "longest wait in [s]", default=3.0, least=0)
    number = OutputPort(int, "number of the picture among those of this camera")

    _asked_s = 0.0

    def initialise(self) -> None:
        self._asked_s = self.now.observation.time_s
        if self.camera.get() is CameraName.wrist:
            self.now.command.look = True

    def update(self) -> Status:
        seen, camera = self.now.observation, self.camera.get()
        view = seen.bench if camera is CameraName.overhead else seen.parts
        if view is None or view.time_s <= self._asked_s:
            self.feedback_message = f"waits for a picture of camera {camera.value}"
            return FAILURE if self.compare(seen.time_s - self._asked_s, ">", self.timeout_s) else RUNNING
        self.number.set(view.sequence)
        mark = {"camera": camera.value, "sequence": view.sequence, "taken_s": view.time_s, "label": self.label.get()}
        self.tools.journal.note("snapshot", **mark)
        self.feedback_message = f"picture {view.sequence} of camera {camera.value}"
        return SUCCESS
