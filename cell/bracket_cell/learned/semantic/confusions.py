"""What the action detector takes for what: a matrix over actions, given by a pattern or learned from confirmed actions.

Actions are numbered part by part: part i at position p of m is i * m + p.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from math import comb
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from pydantic import Field, ValidationError

from bracket_cell.learned.records import EXPORT, DetectedAction, SegmentRow, read_rows
from bracket_cell.learned.semantic.graph import Bools, Floats, Ints, Layout, action_pairs
from bracket_cell.learned.semantic.settings import DETECTION_ERROR
from bracket_ground.errors import InputError, Place, Problem, mistakes
from bracket_ground.files.files import regular, write_whole
from bracket_ground.files.model import Model

Pattern = Literal["uniform", "neighbouring holes", "alike types"]
PATTERNS: tuple[Pattern, ...] = get_args(Pattern)
KINDS_PSEUDO_N, ROW_PSEUDO_N = 4.0, 20.0  # imagined mistakes of every kind, and imagined reports of every action
CACHED = 4096

Reported = tuple[tuple[str, str], tuple[str, str]]  # (part, position) as it was, and as it was reported


class ConfusionFile(Model):
    """A learned matrix.

    Attributes:
        reports_n: confirmed actions that it was learned from.
        wrong: by action as it was, by action as it was reported, how probable that is; words as in "o1 at p2".
    """

    format: Literal["cell.confusions"] = "cell.confusions"
    version: Literal[1] = 1
    parts: tuple[str, ...]
    positions: tuple[str, ...]
    reports_n: int = Field(ge=0)
    source: str = ""
    wrong: dict[str, dict[str, float]]


@dataclass(frozen=True, eq=False)
class Confusions:
    """P(reported | action).

    Attributes:
        matrix: (actions, actions), rows sum to 1: row as it was, column as it was reported.
    """

    matrix: Floats

    @staticmethod
    def of(layout: Layout, pattern: Pattern = "uniform", error: float = DETECTION_ERROR) -> Confusions:
        """A detector that is wrong about every action alike often, in one way."""
        weights = _kinds(layout)[pattern].astype(float)
        found = _known(layout)
        bare = weights.sum(axis=1) == 0
        weights[bare] = _kinds(layout)["uniform"][bare] & found
        share = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1.0)
        return Confusions(_with_diagonal(error * share))

    @staticmethod
    def learned(layout: Layout, reports: Iterable[Reported]) -> Confusions:
        """From confirmed actions: rates of every kind of mistake, and on top of them every action's own.

        Raises:
            ValueError: a report names a part or a position that the product does not have.
        """
        counts = np.zeros((len(layout.parts) * len(layout.positions),) * 2)
        for true, reported in reports:
            counts[_number(layout, *true), _number(layout, *reported)] += 1.0
        uniform = _kinds(layout)["uniform"]
        kinds = [kind & uniform for name, kind in _kinds(layout).items() if name != "uniform"]
        kinds.append(uniform & ~np.logical_or.reduce(kinds))
        expected = np.zeros_like(counts)
        total = counts.sum() + KINDS_PSEUDO_N / DETECTION_ERROR
        for kind in kinds:
            rate = (counts[kind].sum() + KINDS_PSEUDO_N / len(kinds)) / total
            width = kind.sum(axis=1, keepdims=True)
            expected += rate * kind / np.maximum(width, 1)
        wrong = (counts + ROW_PSEUDO_N * expected) / (counts.sum(axis=1, keepdims=True) + ROW_PSEUDO_N)
        np.fill_diagonal(wrong, 0.0)
        return Confusions(_with_diagonal(wrong))

    @staticmethod
    def counted(layout: Layout, classes: Any, counts: Any) -> Confusions:
        """From a table of how often which class was taken for which, as action detectors have on their cards.

        Args:
            classes: words as in "o1 at p2"; other classes do not count.
            counts: (classes, classes) row as it was, column as it was reported.
        """
        pairs = [tuple(str(name).split(" at ", 1)) for name in classes]
        known = [len(pair) == 2 and pair[0] in layout.parts and pair[1] in layout.positions for pair in pairs]
        reports: list[Reported] = []
        for was, row in enumerate(counts):
            for said, count in enumerate(row):
                if known[was] and known[said]:
                    reports += [((pairs[was][0], pairs[was][-1]), (pairs[said][0], pairs[said][-1]))] * int(count)
        return Confusions.learned(layout, reports)

    @property
    def error(self) -> float:
        """Mean share of wrong reports."""
        return float(1.0 - np.diag(self.matrix).mean())

    def save(self, path: Path, layout: Layout, reports_n: int, source: str) -> None:
        """Write the matrix for people and programs."""
        names = [f"{part} at {position}" for part in layout.parts for position in layout.positions]
        wrong = {
            name: {names[j]: round(float(row[j]), 6) for j in np.flatnonzero(row) if names[j] != name}
            for name, row in zip(names, self.matrix, strict=True)
        }
        content = ConfusionFile(
            parts=layout.parts, positions=layout.positions, reports_n=reports_n, source=source, wrong=wrong
        )
        write_whole(path, content.model_dump_json(indent=1).encode() + b"\n")

    @staticmethod
    def load(path: Path, layout: Layout) -> Confusions:
        """Read a file that `save` wrote.

        Raises:
            InputError: it is missing, damaged, or of another product.
        """
        try:
            read = ConfusionFile.model_validate(json.loads(regular(path).read_text(encoding="utf-8")))
        except (OSError, ValueError, ValidationError) as error:
            raise InputError(Problem(Place(path), f"no confusions of actions: {mistakes(error)[0]}")) from error
        if (read.parts, read.positions) != (layout.parts, layout.positions):
            what = f"learned for parts {', '.join(read.parts)} and positions {', '.join(read.positions)}"
            raise InputError(Problem(Place(path), what, "learn them again: cell train --only noise --recorded DIR"))
        numbers = {
            f"{part} at {position}": i * len(layout.positions) + p
            for i, part in enumerate(layout.parts)
            for p, position in enumerate(layout.positions)
        }
        wrong = np.zeros((len(numbers), len(numbers)))
        for true, row in read.wrong.items():
            for reported, share in row.items():
                if true not in numbers or reported not in numbers or not 0.0 <= share <= 1.0:
                    raise InputError(Problem(Place(path), f"{true} reported as {reported}: {share}"))
                wrong[numbers[true], numbers[reported]] = share
        if (wrong.sum(axis=1) >= 1.0).any():
            raise InputError(Problem(Place(path), "the wrong reports of an action sum to 1 or more"))
        return Confusions(_with_diagonal(wrong))


class Reports:
    """Reports as chances: how probable each action is reported as each of them."""

    def __init__(self, confusions: Confusions, positions: int) -> None:
        self._m, self._right = positions, np.diag(confusions.matrix)
        wrong = confusions.matrix - np.diag(self._right)
        actions = len(wrong)
        self._at = wrong.reshape(actions, -1, positions).sum(axis=1)  # (actions, m) reported at a position
        self._scaled = (wrong.sum(axis=1)[:, None] * wrong).T.copy()

    def chances(self, seen: Floats) -> tuple[Ints, Floats]:
        """Positions (k,) of the reports, and (k, actions) how probable each action is reported so.

        A position that is taken by another report is not reported again.

        Args:
            seen: (n, m) 1 for what was reported; where the detector was in doubt, the shares of the parts there: their
                mean counts.
        """
        places = np.flatnonzero(seen.sum(axis=0))
        open_ones = np.ones(self._m, dtype=bool)
        open_ones[places] = False
        still = self._at[:, open_ones].sum(axis=1)
        found = np.zeros((len(places), len(self._at)))
        for number, place in enumerate(places.tolist()):
            total = np.maximum(still + self._at[:, place], 1e-12)
            for part in np.flatnonzero(seen[:, place]):
                report = int(part) * self._m + place
                column = self._scaled[report] / total
                column[report] = self._right[report] if total[report] > 1e-12 else 1.0
                found[number] += seen[part, place] * column
        return places, found


class ConfusionLikelihood:
    """P(reports | goal) under confusions, for people without habits: any k of the slots are done, all choices alike.

    Summed over all ways in which the k reports may stem from k slots: a recursion over the reports whose states are the
    sets of slots that were used.
    """

    approximate = ""

    def __init__(self, layout: Layout, confusions: Confusions) -> None:
        m = len(layout.positions)
        self._some = layout.hypotheses
        self._reports = Reports(confusions, m)
        self._choices = np.array([[comb(int(slots), k) for k in range(m + 1)] for slots in self._some.slots], float)
        masks = np.arange(2**m)[:, None]
        bits = 1 << np.arange(m)
        self._before = np.where(masks & bits, masks ^ bits, 2**m)  # where the recursion comes from; 2^m: nowhere
        self._still = ((masks & bits) == 0).astype(float)
        self.likelihoods = lru_cache(maxsize=CACHED)(self._likelihoods)

    def __call__(self, edges: Floats) -> tuple[Floats, Floats]:
        """Likelihood (z,) of the edges (n, m), and (z, m) that together with each slot being open.

        Args:
            edges: 1 for what was reported; where the detector was in doubt, the shares of the parts at that position.
        """
        return self.likelihoods(tuple(tuple(row) for row in np.round(edges.astype(float), 3).tolist()))

    def _likelihoods(self, seen: tuple[tuple[float, ...], ...]) -> tuple[Floats, Floats]:
        some, m = self._some, len(seen[0])
        _, found = self._reports.chances(np.array(seen))
        chances = np.einsum("knm,gnm->kgm", found.reshape(len(found), *some.wanted.shape[1:]), some.wanted)
        state = np.zeros((len(some.goal), 2**m + 1))
        state[:, 0] = 1.0
        for chance in chances:
            state[:, :-1] = np.einsum("gsp,gp->gs", state[:, self._before], chance)
        every: Floats = state[:, :-1] / np.maximum(self._choices[:, [len(found)]], 1.0)
        return every.sum(axis=1), every @ self._still


def _with_diagonal(wrong: Floats) -> Floats:
    matrix: Floats = wrong + np.diag(1.0 - wrong.sum(axis=1))
    return matrix


def _number(layout: Layout, part: str, position: str) -> int:
    return layout.parts.index(part) * len(layout.positions) + layout.positions.index(position)


def _known(layout: Layout) -> Bools:
    """(actions,) whether some goal has an action."""
    known = np.zeros(len(layout.parts) * len(layout.positions), bool)
    for part, position in action_pairs(layout):
        known[part * len(layout.positions) + position] = True
    return known


def _kinds(layout: Layout) -> dict[Pattern, Bools]:
    """(actions, actions) by pattern: which mistakes belong to it; reports are of actions that some goal has."""
    m = len(layout.positions)
    part, position = np.divmod(np.arange(len(layout.parts) * m), m)
    known = np.broadcast_to(_known(layout), (len(part), len(part)))
    same_part, apart = part[:, None] == part, np.abs(position[:, None] - position)
    return {
        "uniform": known & ~np.eye(len(part), dtype=bool),
        "neighbouring holes": known & same_part & (apart == 1),
        "alike types": known & (apart == 0) & (np.abs(part[:, None] - part) == 1),
    }


def confirmed_reports(path: Path) -> list[Reported]:
    """Detected actions of a file of segments (`cell log export --to training`) beside what the holes showed later.

    Where the hole of a detected assembly turned out to be empty, the action was what filled another hole meanwhile.

    Raises:
        InputError: the file cannot be read or holds no segments.
    """

    def made(row: SegmentRow) -> tuple[SegmentRow, DetectedAction]:
        if row.detected is None:
            raise ValueError("detected: is missing: noise is learned from recorded runs")
        return row, row.detected

    rows = read_rows(path, SegmentRow, made, header="cell.segments", how=EXPORT)
    found: list[Reported] = []
    for number, (row, detected) in enumerate(rows):
        true = _true_action(row, detected, [later for later, _ in rows[number + 1 :]])
        if true is None or detected.shown:  # the hole told it: that says nothing about the network
            continue
        said = detected.part, detected.position
        if said[0] is not None and said[1] is not None and (not number or detected != rows[number - 1][1]):
            found.append((true, (said[0], said[1])))
    return found


def _true_action(row: SegmentRow, detected: DetectedAction, later: list[SegmentRow]) -> tuple[str, str] | None:
    confirmed = row.confirmed
    if detected.kind != "assembly" or confirmed is None:
        return None
    if confirmed.part is not None:
        return confirmed.part, confirmed.position
    for after in later:
        if after.log != row.log:
            return None
        filled = [(part, hole) for hole, part in after.holes.items() if part and not row.holes.get(hole)]
        if filled:
            return filled[0] if len(filled) == 1 else None
    return None
