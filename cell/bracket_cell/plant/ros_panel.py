"""What the person at the bench sees, as topics of ROS 2 for a screen or a voice of the lab's own."""

from __future__ import annotations

from typing import Any

from bracket_cell.plant.dds import LAST, Node
from bracket_cell.plant.ros_types import message
from bracket_cell.skills.drivers.settings import Ros2PanelSettings
from bracket_ground.interfaces.command import Display

TEXT = "std_msgs/msg/String"


class Ros2Panel:
    """Implements `Panel`; each topic keeps its last text for who comes later."""

    Settings = Ros2PanelSettings

    def __init__(self, settings: Ros2PanelSettings) -> None:
        self._node, self._namespace = Node(settings), settings.namespace
        self._topics: dict[str, Any] = {}
        self._said: dict[str, str] = {}

    def show(self, display: Display) -> None:
        """Replace what is shown."""
        self.say("robot", display.message)
        self.say("guidance", "; ".join(f"{part}: {', '.join(at)}" for part, at in display.guidance.items()))
        self.say("questions", "; ".join(f"{question.reason}: {question.todo}" for question in display.questions))

    def alarm(self, text: str) -> None:
        """Show a trouble beside it."""
        self.say("alarm", text)

    def close(self) -> None:
        """Nothing to let go of."""

    def say(self, name: str, text: str) -> None:
        """A text of a topic, where it is a new one."""
        if name not in self._topics:
            self._topics[name] = self._node.publisher(f"{self._namespace}/{name}", TEXT, LAST)
        if self._said.get(name) != text:
            self._said[name] = text
            self._topics[name].write(message(TEXT)(data=text))
