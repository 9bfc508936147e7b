"""What the operator's page shows, as plain data: put together from ticks, small enough for ten times a second."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from bracket_cell.production.book import BracketRow
from bracket_cell.production.bookkeeper import Bookkeeper
from bracket_cell.recording.scene import CellModel
from bracket_cell.recording.schemas import plain
from bracket_cell.viewing.instruction import OperatorGuide
from bracket_cell.viewing.page.scene import marks_of, pose_of
from bracket_cell.watching.observer import TRACEBACK, Level, Outcome, TickRecord
from bracket_ground.files.words.message import data_of
from bracket_ground.interfaces.command import Display
from bracket_ground.interfaces.faults import ACKNOWLEDGE
from bracket_ground.interfaces.operator import Question
from bracket_ground.interfaces.perception import BenchView, PartsView
from btxml.engine.tree import Tree

HISTORY_N = 400  # changes of the belief that a newcomer sees
LINES_N = 60
BRACKETS_N = 20
TRACK_N = 45  # places of the hand


class PageState:
    """Follows a run; not thread-safe: the loop calls it, and what it answers is never changed afterwards.

    Args:
        heading: what is shown of the run, by name.
        keeper: knows the brackets.
    """

    def __init__(self, model: CellModel, heading: Mapping[str, str], tree: Tree, keeper: Bookkeeper) -> None:
        self._product, self._heading = model.product, dict(heading)
        overhead = model.bench.overhead
        self._image_px, self._marks = (overhead.width_px, overhead.height_px), marks_of(model.product, model.bench)
        self._tree = tree
        self.instructor = OperatorGuide(model.product, lambda: self._tree)
        self._display = Display()
        self._history: deque[tuple[float, dict[str, float]]] = deque(maxlen=HISTORY_N)
        self._lines: deque[tuple[float, str, Any]] = deque(maxlen=LINES_N)
        self._track: deque[tuple[int, int]] = deque(maxlen=TRACK_N)
        self._sequence = -1
        self._parts: tuple[PartsView | None, list[dict[str, object]]] = (None, [])
        self._keeper = keeper
        self._brackets: tuple[object, list[dict[str, Any]]] = (None, [])
        self._ended = ""

    def watch(self, tree: Tree) -> None:
        """Show this tree from now on."""
        self._tree = tree

    def still(self) -> dict[str, Any]:
        """What does not change with the ticks: sent to a newcomer first."""
        product = self._product
        holes = product.bracket.holes_m
        return {
            "run": self._heading,
            "image_px": self._image_px,
            "marks": self._marks,
            "goals": {
                name: {"title": product.goal_title(name), "placements": product.goal_placements(name)}
                for name in product.goals
            },
            "parts": {
                name: {"title": part.title, "rgb": [round(255 * value) for value in part.colour_rgb]}
                for name, part in product.parts.items()
            },
            "holes": {name: list(holes[name]) for name in product.positions},
            "history": list(self._history),
        }

    def take(self, record: TickRecord) -> None:
        """One more tick."""
        seen, now_s = record.observation, record.observation.time_s
        self.instructor.take(record)
        if record.command.display is not None:
            belief = dict(record.command.display.goal_belief)
            if belief and belief != dict(self._display.goal_belief):
                self._history.append((round(now_s, 2), {name: round(value, 4) for name, value in belief.items()}))
            self._display = record.command.display
        if seen.bench is not None and seen.bench.sequence != self._sequence:
            self._sequence = seen.bench.sequence
            if seen.bench.hand is None:
                self._track.clear()
            else:
                left, top, right, bottom = seen.bench.hand.box_px
                self._track.append(((left + right) // 2, (top + bottom) // 2))

    def say(self, time_s: float, level: Level, text: str) -> None:
        """The controller says something."""
        if text.startswith(TRACEBACK):
            return
        self._lines.append((round(time_s, 2), level, data_of(text) if "\n" not in text else text.splitlines()[-1]))

    def end(self, outcome: Outcome) -> None:
        """The run is over."""
        self.instructor.end(outcome)
        self._ended = f"{outcome.end}: {outcome.reason}; {outcome.condition}"

    def now(self, record: TickRecord) -> dict[str, Any]:
        """Everything that changes, as it is after this tick."""
        seen, judged, instruction = record.observation, record.judgement, self.instructor.now()
        alarms = [] if (cause := self.instructor.cause) is None else [[cause[0], data_of(cause[1])]]
        if self.instructor.asks and not alarms:
            alarms.append(["acknowledge", ACKNOWLEDGE])
        held = judged is not None and judged.action.name in ("HOLD", "STOP")
        moving = seen.arm.moving or not seen.arm.stands
        return {
            "time_s": round(seen.time_s, 2),
            "tick": seen.tick,
            "status": record.status,
            "ended": self._ended,
            "share": round(seen.speed_scale, 2),
            "instruction": {**asdict(instruction), "words": data_of(instruction.words)},
            "alarms": alarms,
            "held": held,
            "asks": self.instructor.asks,
            "questions": [_question(question) for question in self._display.questions],
            "operator": plain(seen.operator),
            "hand": self._hand(seen.bench),
            "belief": {name: _finite(value) for name, value in self._display.goal_belief.items()},
            "point": self._history[-1] if self._history else None,
            "bracket": {name: asdict(hole) for name, hole in self.instructor.holes.items()},
            "robot": {
                "now": data_of("standing still" if held and not moving else self._display.message),
                "moving": moving,
                "safety": [seen.arm.mode, seen.arm.reason],
                "holding": seen.gripper.holding,
                "next": self.instructor.next,
                "doubt": data_of(self.instructor.doubt),
            },
            "pose": pose_of(seen),
            "tray": self._seen_parts(seen.parts),
            "brackets": self._done(),
            "lines": list(self._lines),
        }

    def _done(self) -> list[dict[str, Any]]:
        """The last brackets of the book, which others may have changed."""
        if (version := self._keeper.book.version) != self._brackets[0]:
            self._brackets = version, [bracket_data(row) for row in self._keeper.book.brackets(last=BRACKETS_N)]
        return self._brackets[1]

    def _seen_parts(self, view: PartsView | None) -> list[dict[str, object]]:
        """Parts in the tray as they were seen last."""
        if view is not self._parts[0]:
            words = (
                []
                if view is None
                else [(detection.part, detection.lies or detection.world_from_part) for detection in view.detections]
            )
            self._parts = (
                view,
                [
                    {"part": part, "position_m": pose.position_m, "quaternion_wxyz": pose.quaternion_wxyz}
                    for part, pose in words
                ],
            )
        return self._parts[1]

    def _hand(self, view: BenchView | None) -> dict[str, object]:
        if view is None:
            unknown = "no view of the bench yet"
            return {"sequence": -1, "action": "", "unknown": unknown, "box": None, "track": [], "held": None}
        hand = view.hand
        return {
            "sequence": view.sequence,
            "action": str(view.action),
            "unknown": data_of(view.hand_unknown or view.health),
            "box": None if hand is None else list(hand.box_px),
            "held": None if hand is None else hand.held_part,
            "at_m": None if hand is None else [*hand.fingertips_m, *hand.palm_m],
            "track": list(self._track),
        }


def _question(question: Question) -> dict[str, Any]:
    answers = [{**plain(answer), "words": data_of(answer.words)} for answer in question.answers]
    words = {name: data_of(getattr(question, name)) for name in ("reason", "tried", "todo")}
    return {**plain(question), **words, "answers": answers}


def bracket_data(row: BracketRow) -> dict[str, Any]:
    """A bracket for a page."""
    counted = ("number", "finished", "variant", "ordered", "order", "misses_order", "correct")
    by_whom = ("robot", "person", "placed")
    return {**{name: getattr(row, name) for name in (*counted, *by_whom)}, "took_s": round(row.length_s, 1)}


def _finite(value: float) -> float:
    return round(value, 4) if math.isfinite(value) else 0.0
