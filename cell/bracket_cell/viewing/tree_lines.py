"""A running tree as lines that fit a window: what runs is always among them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

from rich.text import Text

from bracket_cell.viewing.stepping import WAITS

RUNNING = 1
MARKS = {0: ("○", "dim"), RUNNING: ("▶", "bold yellow"), 2: ("✔", "green"), 3: ("✘", "red"), 4: ("–", "dim")}
HELD = ("‖", "bold yellow")


@dataclass(frozen=True)
class Line:
    """One node.

    Attributes:
        status: its number in Groot2's protocol.
        below: how many nodes are below it.
        runs: it, or a node below it, runs.
        said: why it waits, or how it ended.
        place: the SubTree that it stands in.
    """

    depth: int
    label: str
    status: int
    below: int
    runs: bool
    said: str = ""
    place: str = ""

    @property
    def acts(self) -> bool:
        """It is a leaf that runs, or a node that waits at a breakpoint."""
        return self.held or (self.status == RUNNING and not self.below)

    def flat(self) -> Text:
        """As it is shown alone, with the tree that it stands in."""
        mark, style = HELD if self.held else MARKS[self.status]
        line = Text(f"{mark} {self.label}", style=style).append(f"  {self.said}", style="default")
        return line.append(f"  ({self.place})", style="dim") if self.place else line

    @property
    def held(self) -> bool:
        """It waits at a breakpoint."""
        return self.said == WAITS

    def text(self, hidden: int = 0) -> Text:
        """As it is shown; `hidden` nodes below it are left out."""
        mark, style = HELD if self.held else MARKS[self.status]
        more = f"  … {hidden}" if hidden else ""
        line = Text(f"{'  ' * self.depth}{mark} {self.label}{more}", style=style)
        return line.append(f"  {self.said}", style="default") if self.said else line


def lines_of(xml: ElementTree.Element, statuses: Mapping[int, int], said: Mapping[int, str]) -> list[Line]:
    """All nodes of a monitored tree with SubTrees in their places, from the top."""
    trees = {element.get("_fullpath", ""): element for element in xml.iter("BehaviorTree")}
    lines: list[Line] = []
    _take(lines, list(trees[""]), 0, trees, statuses, said, "")
    return lines


def _take(
    lines: list[Line],
    elements: Sequence[ElementTree.Element],
    depth: int,
    trees: Mapping[str, ElementTree.Element],
    statuses: Mapping[int, int],
    said: Mapping[int, str],
    inside: str,
) -> bool:
    """Add elements and all below them; whether one of them runs."""
    any_runs = False
    for element in elements:
        uid = int(element.get("_uid", "0"))
        status = statuses.get(uid, 0) % 10
        label, kind = element.get("name") or element.tag, element.get("ID", element.tag)
        place = len(lines)
        lines.append(Line(depth, "", 0, 0, runs=False))
        inner = trees[element.get("_fullpath", "")] if element.tag == "SubTree" else element
        words = said.get(uid, "")
        within = label if element.tag == "SubTree" else inside
        runs = (
            _take(lines, list(inner), depth + 1, trees, statuses, said, within) or status == RUNNING or words == WAITS
        )
        words = words if words == WAITS or (not len(inner) and status != 0) else ""
        name = label if label == kind else f"{label}  ({kind})"
        lines[place] = Line(depth, name, status, len(lines) - place - 1, runs, words, inside)
        any_runs = any_runs or runs
    return any_runs


def fitted(lines: Sequence[Line], rows: int) -> list[Text]:
    """At most this many rows: what does not run is folded, then the rows around the last node that runs are shown."""
    if len(lines) <= rows:
        return [line.text() for line in lines]
    shown: list[tuple[Line, int]] = []
    place = 0
    while place < len(lines):
        line = lines[place]
        folded = line.below if line.below and not line.runs else 0
        shown.append((line, folded))
        place += 1 + folded
    texts = [line.text(hidden) for line, hidden in shown]
    if len(texts) <= rows or rows < 3:
        return texts[:rows]
    focus = max((n for n, (line, _) in enumerate(shown) if line.status == RUNNING or line.held), default=0)
    first = min(max(0, focus - rows // 2), len(texts) - rows)
    window = texts[first : first + rows]
    if first:
        window[0] = Text(f"↑ {first + 1} more", style="dim")
    if (rest := len(texts) - first - rows) > 0:
        window[-1] = Text(f"↓ {rest + 1} more", style="dim")
    return window
