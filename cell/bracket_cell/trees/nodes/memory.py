"""Counters, timers, the last result of a branch, and values that are kept in files."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from typing import Any

from bracket_cell.trees.nodes.each import rows_of
from bracket_cell.trees.nodes.poses import FARTHEST_M, FramedPose
from bracket_cell.trees.nodes.services import CellNode
from btxml.engine.blackboard import UNSET
from btxml.engine.errors import NodeError
from btxml.engine.literals import shown
from btxml.engine.node import FAILURE, RUNNING, SUCCESS, Decorator
from btxml.engine.ports import InOutPort, InputPort, OutputPort, Port, further_of
from btxml.engine.status import Status
from btxml.engine.traits import Traits

FORMAT = "cell.blackboard"


class CountUp(CellNode):
    """Add to a counter, which begins with 0."""

    traits = Traits(instant=True)

    count = InOutPort(int, "the counter", unset_ok=True)
    by = InputPort(int, "how much", default=1)

    def update(self) -> Status:
        self.count.set(self.count.get_or(0) + self.by.get())
        return SUCCESS


class CountIsReached(CellNode):
    """A counter is at a number, or above it."""

    node_type = "Condition"
    traits = Traits(instant=True)

    count = InputPort(int, "the counter", unset_ok=True)
    limit = InputPort(int, "the number")

    def update(self) -> Status:
        count = self.count.get_or(0)
        self.feedback_message = f"{count} of {self.limit.get()}"
        return SUCCESS if self.compare(count, ">=", self.limit) else FAILURE


class StartTimer(CellNode):
    """Start a timer, or start it again."""

    traits = Traits(instant=True)

    timer = OutputPort(float, "when it was started in [s]")

    def update(self) -> Status:
        self.timer.set(self.now.observation.time_s)
        return SUCCESS


class ReadTimer(CellNode):
    """Tell how long ago a timer was started."""

    traits = Traits(instant=True)

    timer = InputPort(float, "when it was started in [s]")
    elapsed_s = OutputPort(float, "time since then in [s]")

    def update(self) -> Status:
        self.elapsed_s.set(self.now.observation.time_s - self.timer.get())
        return SUCCESS


class TimerIsOver(CellNode):
    """A timer was started at least this long ago."""

    node_type = "Condition"
    traits = Traits(instant=True)

    timer = InputPort(float, "when it was started in [s]")
    after_s = InputPort(float, "how long in [s]", least=0)

    def update(self) -> Status:
        elapsed = self.now.observation.time_s - self.timer.get()
        self.feedback_message = f"{elapsed:.2f} of {self.after_s.get():g} s"
        return SUCCESS if self.compare(elapsed, ">=", self.after_s) else FAILURE


class KeepResult(Decorator):
    """Passes its child's result on and keeps it, with the reason of the child, for later."""

    result = OutputPort(str, "SUCCESS, FAILURE or SKIPPED")
    reason = OutputPort(str, "what the child said when it ended")
    traits = Traits(comes_back=False)

    def run(self) -> Status:
        self.set_status(RUNNING)
        status = self.decorated.execute()
        if status is not RUNNING:
            self.result.set(status.name)
            self.reason.set(self.decorated.feedback_message)
        return status


class SaveBlackboard(CellNode):
    """Save values in a JSON file; further ports name them: count="{count}"."""

    file = InputPort(str, "file below the working folder; a file that SaveBlackboard wrote is replaced")

    @classmethod
    def further_port(cls, name: str) -> Port | None:
        """A value, under its name."""
        return InputPort(Any, f"saved as '{name}'")

    def update(self) -> Status:
        path, files, journal = self.file.get(), self.tools.files, self.tools.journal
        if (before := files.read(path, journal)) is not None:
            entries_in(before, path)  # what is another's stays
        entries = {name: _plain(name, port.get()) for name, port in further_of(self).items()}
        files.write(path, text_of(entries), journal)
        self.feedback_message = f"saved {', '.join(entries)} in {path}"
        return SUCCESS


class LoadBlackboard(CellNode):
    """Load values that SaveBlackboard saved; further ports name them: count="{count}"."""

    file = InputPort(str, "file below the working folder")

    @classmethod
    def further_port(cls, name: str) -> Port | None:
        """A value, by its name."""
        return OutputPort(Any, f"what was saved as '{name}'")

    def update(self) -> Status:
        path = self.file.get()
        text = self.tools.files.read(path, self.tools.journal)
        if text is None:
            raise NodeError(f"there is no file {path}")
        entries, ports = entries_in(text, path), further_of(self)
        if missing := [name for name in ports if name not in entries]:
            raise NodeError(f"{path} has no '{missing[0]}'; it has: {', '.join(entries) or 'nothing'}")
        for name, port in ports.items():
            port.set(_value(entries[name], path))
        self.feedback_message = f"loaded {', '.join(ports)} from {path}"
        return SUCCESS


class AppendRow(CellNode):
    """Append a row to a CSV file; further ports name the columns: hole="{hole}"."""

    file = InputPort(str, "file below the working folder; a new file begins with the names of the columns")

    @classmethod
    def further_port(cls, name: str) -> Port | None:
        """A column."""
        return InputPort(Any, f"the column '{name}'", unset_ok=False)

    def update(self) -> Status:
        path, ports = self.file.get(), further_of(self)
        before = self.tools.files.read(path, self.tools.journal) or ""
        if before:
            rows_of(before, path, tuple(ports))  # it is such a table
        text = io.StringIO()
        head = next(csv.reader(io.StringIO(before))) if before else list(ports)
        if set(head) != set(ports):
            raise NodeError(f"{path} has the columns {', '.join(head)}, and not {', '.join(ports)}")
        writer = csv.writer(text, lineterminator="\n")
        if not before:
            writer.writerow(head)
        writer.writerow([_cell(ports[column].get()) for column in head])
        joint = "" if not before or before.endswith("\n") else "\n"
        self.tools.files.write(path, before + joint + text.getvalue(), self.tools.journal)
        return SUCCESS


def text_of(entries: Mapping[str, object]) -> str:
    """A file of saved values."""
    return json.dumps({"format": FORMAT, "version": 1, "entries": entries}, indent=1, allow_nan=False) + "\n"


def _plain(name: str, value: object) -> object:
    if isinstance(value, FramedPose):
        return {
            "frame": value.frame,
            "position_m": value.pose.position_m,
            "quaternion_wxyz": value.pose.quaternion_wxyz,
        }
    if isinstance(value, list | tuple):
        return [_plain(name, item) for item in value]
    if isinstance(value, bool | int | str):
        return value
    if isinstance(value, float) and value == value and abs(value) != float("inf"):
        return value
    raise NodeError(f"'{name}' is {shown(value)}, which cannot be saved; numbers, texts, lists and poses can")


def _value(plain: object, path: str) -> Any:
    if not isinstance(plain, dict):
        return plain
    from bracket_ground.interfaces.pose import Pose

    try:
        x, y, z = (float(value) for value in plain["position_m"])
        a, b, c, d = (float(value) for value in plain["quaternion_wxyz"])
        if not all(abs(metres) <= FARTHEST_M for metres in (x, y, z)):  # NaN is no place either
            raise ValueError(f"a place farther than {FARTHEST_M:g} m")
        return FramedPose(str(plain["frame"]), Pose((x, y, z), (a, b, c, d)))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise NodeError(f"{path} holds a pose that is none: {error!r}") from None


def entries_in(text: str, path: str) -> dict[str, object]:
    """What a file that SaveBlackboard wrote holds.

    Raises:
        NodeError: it was written otherwise.
    """
    try:
        content = json.loads(text)
        entries = content["entries"]
        if content["format"] != FORMAT or content["version"] != 1 or not isinstance(entries, dict):
            raise ValueError("another format")
        json.dumps(entries, ensure_ascii=False).encode()  # no half characters, which neither log nor file can hold
    except (ValueError, KeyError, TypeError, RecursionError):
        raise NodeError(f"{path} was not written by SaveBlackboard") from None
    return {key: UNSET if value is None else value for key, value in entries.items()}


def _cell(value: object) -> object:
    return str(value).lower() if isinstance(value, bool) else value
