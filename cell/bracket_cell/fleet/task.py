"""One run of a sweep, as it is sent to a worker."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass

from bracket_cell.fleet.packing import Packed, digest


@dataclass(frozen=True)
class Task:
    """One run, with the text of every file that it needs: a worker needs nothing but the package.

    Attributes:
        packed: its tree and configuration.
        person, look: names, or names in the packed files.
        logs: folder or address for the run's log, with images; None to keep none.
        keep_one_in: of so many runs that went right, the log of one is kept; all others are.
        label: what tells it apart from the sweep's other runs, for people and for rows.
    """

    packed: Packed
    seed: int
    goal: str
    person: str | None
    look: str | None
    fault: str | None
    max_duration_s: float | None
    label: tuple[tuple[str, str], ...]
    logs: str | None = None
    keep_one_in: int = 1
    pixels: bool = True

    @property
    def key(self) -> str:
        """Names the run by all that decides it; where a file, weights or the program changed, it is another."""
        packed = self.packed
        files: list[object] = [[name, digest(content)] for name, content in packed.files]
        files += [*packed.nodes, *packed.made_of]
        asked = [packed.tree, packed.configuration, self.goal, self.person, self.look, self.fault, self.max_duration_s]
        asked = asked if self.pixels else [*asked, "without pixels"]
        return hashlib.sha256(json.dumps([files, *asked, self.seed]).encode()).hexdigest()[:32]

    def keeps(self, summary: Mapping[str, object]) -> bool:
        """Whether a run's log is worth its place: it failed, or is of the sample, which is the same every time."""
        right = summary.get("end") == "finished" and summary.get("correct") is not False
        return not right or int(self.key[:8], 16) % self.keep_one_in == 0
