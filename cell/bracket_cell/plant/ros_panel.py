"""What the person at the bench sees, as topics of ROS 2 for a screen or a voice of the lab's own."""

from __future__ import annotations

from bracket_cell.plant.dds import LAST, Node
from bracket_cell.plant.ros_types import message
from bracket_cell.skills.drivers.settings import Ros2PanelSettings
from bracket_ground.interfaces.command import Display

TEXT = "std_msgs/msg/String"


class Ros2Panel:
    """Implements `Panel`; each topic keeps its last text for who comes later."""

    Settings = Ros2PanelSettings

    def __init__(self, settings: Ros2PanelSettings) -> None:
        node, names = Node(settings), ("robot", "guidance", "questions", "alarm")
        self._topics = {name: node.publisher(f"{settings.namespace}/{name}", TEXT, LAST) for name in names}
        self._said: dict[str, str] = {}

    def show(self, display: Display) -> None:
        """Replace what is shown."""
        self._say("robot", display.message)
        self._say("guidance", "; ".join(f"{part}: {', '.join(at)}" for part, at in display.guidance.items()))
        self._say("questions", "; ".join(f"{question.reason}: {question.todo}" for question in display.questions))

    def alarm(self, text: str) -> None:
        """Show a trouble beside it."""
        self._say("alarm", text)

    def close(self) -> None:
        """Nothing to let go of."""

    def _say(self, name: str, text: str) -> None:
        if self._said.get(name) != text:
            self._said[name] = text
            self._topics[name].write(message(TEXT)(data=text))
