"""Live progress of a run on standard error: a panel on a terminal, plain lines elsewhere."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping

from rich.console import Console
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from bracket_cell.viewing.guidance import guidance_sentences
from bracket_cell.viewing.instruction import OperatorGuide
from bracket_cell.watching.observer import TRACEBACK, Level, Observer, Outcome, TickRecord
from bracket_ground.files.words.catalogue import SOURCE, Catalogue, catalogue
from bracket_ground.files.words.message import Message, listed
from bracket_ground.interfaces.command import Display
from bracket_ground.interfaces.operator import Question

REFRESH_S = 0.1  # of wall time
LOOK_BACK_TICKS = 50  # the tick rate is a mean over these
STYLES = {"info": "default", "warning": "yellow", "error": "bold red"}
FALLING = re.compile(r" < \d+\.\d+$")  # what a placement needs; it falls while the robot waits, which is no news
URGENT = {"help": "bold yellow", "asks": "bold yellow", "alarm": "bold red"}  # shown only where there is something


class LiveProgress(Observer):
    """An observer that shows what the person at the bench and the robot do.

    Args:
        why: the robot does what it does, in one sentence.
    """

    def __init__(
        self,
        console: Console,
        period_s: float,
        instructor: OperatorGuide | None = None,
        words: Catalogue | None = None,
        why: Callable[[], object] = str,
    ) -> None:
        self._console, self._words, self._why = console, words or catalogue(SOURCE), why
        self._instructor = instructor
        self._period_s = period_s
        self._live = Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else None
        self._display = Display()
        self._hand = "nothing seen yet"
        self._alarm = ""
        self._said: dict[str, str] = {}
        self._refreshed_s = 0.0
        self._stamps: list[float] = []
        if self._live is not None:
            self._live.start()

    def tick(self, record: TickRecord) -> None:
        now_s = time.monotonic()
        self._stamps = [*self._stamps[-LOOK_BACK_TICKS:], now_s]
        if record.command.display is not None:
            if record.command.display.beeps > self._display.beeps:
                self._console.bell()
            self._display = record.command.display
        if self._instructor is not None:
            self._instructor.take(record)
        view = record.observation.bench
        if view is not None:
            self._hand = str(view.action) if view.hand is not None else "no hand in view"
        if self._live is None:
            self._tell_changes(record.observation.time_s)
        elif now_s - self._refreshed_s >= REFRESH_S:
            self._refreshed_s = now_s
            self._live.update(self._panel(record), refresh=True)

    def message(self, time_s: float, level: Level, text: str) -> None:
        shown = self._words(text).splitlines()[-1]
        if not text.startswith(TRACEBACK):  # for the log alone; its error was said
            self._console.print(_line(time_s, "cell", shown), style=STYLES[level], markup=False)

    def alarm(self, text: str) -> None:
        """Show a trouble of the cell until another text comes; an empty one takes it away."""
        self._alarm = text

    def close(self, outcome: Outcome) -> None:  # noqa: ARG002 - its message has been shown
        if self._live is not None:
            self._live.stop()

    def _tick_rate_hz(self) -> float:
        elapsed_s = self._stamps[-1] - self._stamps[0]
        return (len(self._stamps) - 1) / elapsed_s if elapsed_s > 0 else 0.0

    def _panel(self, record: TickRecord) -> Panel:
        rate_hz = self._tick_rate_hz()
        pace = rate_hz * self._period_s
        you = () if self._instructor is None else (("you", self._instructor.now().words),)
        rows = [
            *you,
            ("time", f"{record.observation.time_s:6.1f} s, {rate_hz:.0f} ticks/s, {pace:.1f} x real time"),
            ("hand", self._hand),
            ("goal", belief_text(self._display.goal_belief)),
            *(("guidance", sentence) for sentence in self._guidance()),
            ("robot", self._display.message),
            ("why", str(self._why())),
            ("help", self._display.help_request or ""),
            *(("asks", question_text(question)) for question in self._display.questions),
            ("alarm", self._alarm),
        ]
        table = Table.grid(padding=(0, 2))
        for name, text in rows:
            text = self._words(text)
            if text or name not in URGENT:  # as Text: "[g0 | g1]" in a str would be taken for a style
                table.add_row(Text(name, URGENT.get(name, "")), Text(text, URGENT[name] if name == "alarm" else ""))
        return Panel(table, title="cell", title_align="left")

    def _guidance(self) -> list[str]:
        shown, instructor = self._display, self._instructor
        known = () if instructor is None else (instructor.product, instructor.done, instructor.built)
        return guidance_sentences(shown.guidance, shown.any_part, *known)

    def _tell_changes(self, time_s: float) -> None:
        fields = {
            "hand": self._hand,
            "goal": belief_text(self._display.goal_belief),
            "guidance": listed(self._guidance(), ". "),
            "robot": self._display.message,
            "help": self._display.help_request or "",
            "asks": listed(list(map(question_text, self._display.questions))),
        }
        news = {name: FALLING.sub("", self._words(text)) for name, text in fields.items()}
        for name, text in fields.items():
            if text and news[name] != self._said.get(name):
                self._console.print(_line(time_s, name, self._words(text)), markup=False, highlight=False)
        self._said = news


def belief_text(belief: Mapping[str, float]) -> str:
    """Goals by probability, for people."""
    ranked = sorted(belief.items(), key=lambda item: -item[1])
    return ", ".join(f"{goal} {probability:.2f}" for goal, probability in ranked)


def question_text(question: Question) -> str:
    """A question with its number and the answers that may be typed, for people."""
    answers = " | ".join(answer.value for answer in question.answers)
    words = {"number": question.number, "reason": question.reason, "todo": question.todo}
    if not answers:
        return Message("{number}: {reason}; {todo}", **words)
    return Message("{number}: {reason}; {todo} [{answers}]", **words, answers=answers)


def _line(time_s: float, who: str, text: str) -> str:
    return f"{time_s:7.2f} s  {who:<9} {text}"
