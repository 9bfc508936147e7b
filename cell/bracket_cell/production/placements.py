"""Who placed what in a bracket: the answer that page, book, report and metrics share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

ROBOT, PERSON = "robot", "person"


class Placements:
    """Follows the notes of a tree's nodes from the beginning of a bracket.

    Attributes:
        parts: part type by position.
        by: "robot" or "person" by position. A part is the robot's if its node says so, or if it fetched this type for
            this hole and the part was seen there without a hand that placed it. A hole that is emptied and filled anew
            is decided anew.
    """

    def __init__(self) -> None:
        self.parts: dict[str, str] = {}
        self.by: dict[str, str] = {}
        self._fetched: dict[str, str] = {}

    def note(self, topic: str, fields: Mapping[str, Any]) -> None:
        """Take one note."""
        if topic == "bracket" and fields["edge"] == "begin" and not fields.get("resumed"):
            self.parts, self.by, self._fetched = {}, {}, {}
        elif topic == "verdict" and fields.get("decision") == "act" and fields.get("part"):
            self._fetched[str(fields["position"])] = str(fields["part"])
        elif topic == "belief" and fields.get("edge"):
            part, position = fields["edge"]
            self._edge(part, position, str(fields.get("source", "")))

    def _edge(self, part: str | None, position: str, source: str) -> None:
        known = self.parts.pop(position, None)
        who = self.by.pop(position, PERSON)
        if part is None:
            return
        fetched = self._fetched.get(position) == part and source != "action"
        if known != part:
            who = ROBOT if fetched else PERSON
        self.parts[position], self.by[position] = part, ROBOT if source == ROBOT else who
        self._fetched.pop(position, None)
