"""What the operator's page shows, as plain data: put together from ticks, small enough for ten times a second."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import Any

from cell.interfaces.bench import Bench
from cell.interfaces.command import Display
from cell.interfaces.faults import ACKNOWLEDGE, USUAL
from cell.interfaces.perception import BenchView
from cell.interfaces.product import Product
from cell.recording.schemas import plain
from cell.watching.observer import Level, Outcome, TickRecord
from cell.watching.why_now import WhyNow
from trees.engine.node import StatusChange
from trees.engine.tree import Tree

HISTORY_N = 400  # changes of the belief that a newcomer sees
LINES_N = 60
TRACK_N = 45  # places of the hand


class PageState:
    """Follows a run; not thread-safe: the loop calls it, and what it answers is never changed afterwards.

    Args:
        goals: of the product, by name.
    """

    def __init__(self, product: Product, bench: Bench, heading: Mapping[str, str], tree: Tree) -> None:
        self._product, self._heading = product, dict(heading)
        self._image_px = bench.overhead.width_px, bench.overhead.height_px
        self._display = Display()
        self._placed: dict[str, str] = {}
        self._by: dict[str, str] = {}
        self._next: dict[str, object] = {}
        self._why = ""
        self._history: deque[tuple[float, dict[str, float]]] = deque(maxlen=HISTORY_N)
        self._lines: deque[tuple[float, str, str]] = deque(maxlen=LINES_N)
        self._track: deque[tuple[int, int]] = deque(maxlen=TRACK_N)
        self._sequence = -1
        self._brackets: list[dict[str, object]] = []
        self._statuses: dict[int, tuple[str, str]] = {}
        self._ended, self._asks = "", False
        self._why_now = WhyNow(lambda: self._tree)
        self.watch(tree)

    def watch(self, tree: Tree) -> None:
        """Show this tree from now on."""
        self._statuses = {}
        self._tree = tree
        depth: dict[int, int] = {}
        for node in tree.nodes:
            depth |= {id(child): depth.get(id(node), 0) + 1 for child in node.children}
        self._nodes = [
            {"uid": node.uid, "name": node.name, "kind": type(node).__name__, "depth": depth.get(id(node), 0)}
            for node in tree.nodes
        ]

    def still(self) -> dict[str, Any]:
        """What does not change with the ticks: sent to a newcomer first."""
        product = self._product
        holes = product.bracket.holes_m
        return {
            "run": self._heading,
            "image_px": self._image_px,
            "goals": {name: product.goal_placements(name) for name in product.goals},
            "parts": {
                name: {"title": part.title, "rgb": [round(255 * value) for value in part.colour_rgb]}
                for name, part in product.parts.items()
            },
            "holes": {name: list(holes[name]) for name in product.positions},
            "nodes": self._nodes,
            "history": list(self._history),
        }

    def take(self, record: TickRecord) -> None:
        """One more tick."""
        seen, now_s = record.observation, record.observation.time_s
        if seen.acknowledged or record.judgement is None or not record.judgement.reasons:
            self._asks = False
        self._why_now.tick(record)
        for change in record.changes:
            self._statuses[change.uid] = (change.new.name, change.feedback)
        for topic, fields in record.notes:
            self._note(topic, fields, now_s)
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
        if "PutBack" in {_tag(change) for change in record.changes if change.new.name == "SUCCESS"}:
            self._next.pop("robot", None)

    def say(self, time_s: float, level: Level, text: str) -> None:
        """The controller says something; it may wait for somebody to acknowledge that."""
        self._asks |= text.endswith(ACKNOWLEDGE)
        self._lines.append((round(time_s, 2), level, text.splitlines()[-1]))

    def end(self, outcome: Outcome) -> None:
        """The run is over."""
        self._ended = f"{outcome.end}: {outcome.reason}; {outcome.condition}"

    def now(self, record: TickRecord) -> dict[str, Any]:
        """Everything that changes, as it is after this tick."""
        seen, judged = record.observation, record.judgement
        reasons = [] if judged is None else [list(reason) for reason in judged.reasons if reason[0] not in USUAL]
        if self._asks:
            reasons.append(["acknowledge", ACKNOWLEDGE])
        moving = seen.arm.moving or not seen.arm.stands
        return {
            "time_s": round(seen.time_s, 2),
            "tick": seen.tick,
            "status": record.status,
            "ended": self._ended,
            "share": round(seen.share, 2),
            "alarms": reasons,
            "why": self._why_now().plain(),
            "held": judged is not None and judged.action.name in ("HOLD", "STOP"),
            "questions": plain(self._display.questions),
            "operator": plain(seen.operator),
            "hand": self._hand(seen.bench),
            "belief": {name: _finite(value) for name, value in self._display.goal_belief.items()},
            "point": self._history[-1] if self._history else None,
            "bracket": self._bracket(seen.bench),
            "robot": {
                "now": self._display.message,
                "moving": moving,
                "holding": seen.gripper.holding,
                "next": self._next.get("robot"),
                "why": self._why,
                "help": self._display.help_request,
            },
            "brackets": self._brackets[-20:],
            "lines": list(self._lines),
            "statuses": {uid: list(told) for uid, told in self._statuses.items()},
        }

    def _note(self, topic: str, fields: Mapping[str, Any], now_s: float) -> None:
        if topic == "belief" and fields.get("edge"):
            part, position = fields["edge"]
            if part is None:
                self._placed.pop(position, None)
            else:
                self._placed[position] = part
                source, planned = fields.get("source"), self._next.get("robot")
                mine = planned == {"part": part, "positions": [position]} and source != "action"
                self._by[position] = "robot" if source == "robot" or mine else self._by.get(position, "person")
        elif topic == "plan" and fields.get("next"):
            part, *positions = fields["next"]
            self._next["robot"] = {"part": part, "positions": list(positions)}
        elif topic == "verdict":
            self._why = "" if fields.get("decision") == "act" else str(fields.get("reason", ""))
            if fields.get("decision") == "act":
                part, _, position = str(fields.get("subject")).partition(" at ")
                self._next["robot"] = {"part": part, "positions": [position]}
        elif topic == "bracket":
            self._bracket_noted(fields, now_s)

    def _bracket_noted(self, fields: Mapping[str, Any], now_s: float) -> None:
        if fields["edge"] == "begin":
            self._placed, self._by, self._next, self._why = {}, {}, {}, ""
            self._brackets.append({"number": fields["number"], "begin_s": round(now_s, 1)})
        elif self._brackets:
            self._brackets[-1] |= {"end_s": round(now_s, 1), "finished": fields["finished"], "goal": fields["goal"]}

    def _bracket(self, view: BenchView | None) -> list[dict[str, object]]:
        """Every position: what is there, what belongs there, and who does it."""
        wanted = {position: part for part, to in self._display.guidance.items() for position in to}
        robot: Any = self._next.get("robot") or {}
        told = []
        for position in self._product.positions:
            hole = view.holes.get(position) if view is not None else None
            part = self._placed.get(position)
            mine = part is None and position in robot.get("positions", ())[:1]
            told.append(
                {
                    "position": position,
                    "part": part or (robot.get("part") if mine else wanted.get(position)),
                    "any_part": position in self._display.any_part,
                    "placed": part is not None,
                    "upright": hole is None or hole.upright,
                    "who": self._by.get(position) if part is not None else ("robot" if mine else "person"),
                }
            )
        return told

    def _hand(self, view: BenchView | None) -> dict[str, object]:
        if view is None:
            unknown = "no view of the bench yet"
            return {"sequence": -1, "action": "", "unknown": unknown, "box": None, "track": [], "held": None}
        hand = view.hand
        return {
            "sequence": view.sequence,
            "action": str(view.action),
            "unknown": view.hand_unknown or view.health,
            "box": None if hand is None else list(hand.box_px),
            "held": None if hand is None else hand.held_part,
            "track": list(self._track),
        }


def _tag(change: StatusChange) -> str:
    return change.path.rpartition("/")[2].partition("::")[0]


def _finite(value: float) -> float:
    return round(value, 4) if math.isfinite(value) else 0.0
