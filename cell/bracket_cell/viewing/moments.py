"""Moments of a run that are worth a picture."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from bracket_cell.watching.observer import Observer, TickRecord
from bracket_ground.interfaces.observation import Observation

MOST_FRAMES = 30
MOST_KEPT = 4 * MOST_FRAMES  # moments; of more every other one is forgotten

Thing = TypeVar("Thing")
Boxes = tuple[tuple[int, int, int, int], ...]


@dataclass(frozen=True)
class Moment:
    """When something worth a picture happened, and what is framed in it.

    Attributes:
        boxes_px: (left, top, right, bottom) of what is framed.
    """

    time_s: float
    camera: str
    caption: str
    boxes_px: Boxes = ()


class Moments(Observer):
    """An observer that notes when something worth a picture happened; the pictures are taken from the log at the end.

    It keeps no image, and of a long run only a limited number of moments, evenly spread.
    """

    def __init__(self) -> None:
        self._kept: list[Moment] = []
        self._every, self._offered = 1, 0
        self._last = ""
        self._action = ""
        self._parts = -1

    def tick(self, record: TickRecord) -> None:
        self.see(record.observation, record.notes)

    def see(self, seen: Observation, notes: Iterable[tuple[str, Mapping[str, object]]]) -> None:
        """One tick: of a run, or of a log."""
        view, parts = seen.bench, seen.parts
        if parts is not None and parts.sequence != self._parts:
            self._parts = parts.sequence
            found = " ".join(sorted(part.part for part in parts.detections)) or "nothing"
            self._note(Moment(parts.time_s, "wrist", f"tray: {found}", tuple(part.box_px for part in parts.detections)))
        boxes = (view.hand.box_px,) if view is not None and view.hand is not None else ()
        time_s = seen.time_s if view is None else view.time_s
        action = view.action.kind if view is not None else ""
        if action == "screw" != self._action:
            self._note(Moment(time_s, "overhead", "person: screw", boxes))
        self._action = action
        for topic, fields in notes:
            if caption := _caption(topic, fields):
                self._note(Moment(time_s, "overhead", caption, boxes))

    def chosen(self) -> list[Moment]:
        """Those that the sheet shows beside begin and end, in order of time."""
        return spread(sorted(self._kept, key=lambda moment: moment.time_s), MOST_FRAMES - 2)

    def _note(self, moment: Moment) -> None:
        if moment.caption == self._last:
            return
        self._last = moment.caption
        if self._offered % self._every == 0:
            self._kept.append(moment)
        self._offered += 1
        if len(self._kept) > MOST_KEPT:
            self._kept, self._every = self._kept[::2], 2 * self._every


def spread(things: list[Thing], most: int) -> list[Thing]:
    """At most this many of them, evenly spread; always the first and the last."""
    if len(things) <= most:
        return things
    return [things[round(place * (len(things) - 1) / (most - 1))] for place in range(most)]


def _caption(topic: str, fields: Mapping[str, object]) -> str:
    """What a note means in a picture, or nothing."""
    if topic == "belief" and "edge" in fields:
        edge = fields["edge"]
        return f"seen: {' at '.join(map(str, edge)) if isinstance(edge, list | tuple) else edge}"
    if topic == "skill" and fields.get("status") in ("success", "failure"):
        return f"{fields.get('node')}: {fields.get('reason')}"
    if topic == "help":
        return f"help: {fields.get('text')}"
    return ""
