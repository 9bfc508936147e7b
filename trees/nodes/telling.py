"""Messages to the people at the bench and to the log."""

from __future__ import annotations

from enum import Enum

from py_trees.common import Status

from trees.engine.node import FAILURE, RUNNING, SUCCESS
from trees.engine.ports import InputPort, OutputPort
from trees.engine.traits import Traits
from trees.nodes.services import CellNode


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

    text = InputPort(str, "what to show")

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

    text = InputPort(str, "what to write")
    weight = InputPort(Weight, "info, warning or error", default=Weight.info)

    def update(self) -> Status:
        self.feedback_message = self.text.get()
        self.tools.journal.note("message", text=self.text.get(), weight=self.weight.get().value)
        return SUCCESS


class TakeSnapshot(CellNode):
    """Wait for the next picture of a camera and mark it in the log; `cell lab snapshots` writes it as a file."""

    camera = InputPort(CameraName, "overhead or wrist", default=CameraName.overhead)
    label = InputPort(str, "what it is a picture of", default="")
    timeout_s = InputPort(float, "longest wait in [s]", default=3.0)
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
            return FAILURE if seen.time_s - self._asked_s > self.timeout_s.get() else RUNNING
        self.number.set(view.sequence)
        mark = {"camera": camera.value, "sequence": view.sequence, "taken_s": view.time_s, "label": self.label.get()}
        self.tools.journal.note("snapshot", **mark)
        self.feedback_message = f"picture {view.sequence} of camera {camera.value}"
        return SUCCESS
