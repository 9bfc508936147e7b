"""Rules over logs: which were broken, in which tick and why (`cell log rules`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bracket_cell.log.read.reader import Log, LoggedTick, read_log
from bracket_cell.log.replay.loading import Changes
from bracket_cell.log.replay.logged_tree import logged_motion, logged_tree
from bracket_cell.log.replay.replay import Replay, Step
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.trees.rules import Situation, watch_of
from bracket_ground.errors import counted
from btxml.rules import Violation, nodes_of

OUTCOMES = ("kept", "broken", "unknown")


@dataclass(frozen=True)
class Judged:
    """What became of the rules in one log.

    Attributes:
        rules: by name, in how many ticks each was kept, broken and unknown, as what it names had no value.
        lacks: what is missing from the log, in words; else empty.
    """

    log: Path
    ticks: int
    violations: tuple[Violation, ...]
    rules: Mapping[str, tuple[int, int, int]]
    lacks: str = ""

    def plain(self) -> dict[str, object]:
        """For programs."""
        found = [{"rule": v.rule, "tick": v.tick, "time_s": v.time_s, "reason": v.reason} for v in self.violations]
        rules = {name: dict(zip(OUTCOMES, ticks, strict=True)) for name, ticks in self.rules.items()}
        return {"log": str(self.log), "ticks": self.ticks, "violations": found, "rules": rules, "lacks": self.lacks}


def judge(path: Path, rules: Sequence[Path], nodes: Sequence[str] = (), beside: Sequence[Path] = ()) -> Judged:
    """Judge a log by the rules of some files; where they name entries, the log is replayed to know them.

    Raises:
        InputError, LogError: a file or the log cannot be used.
    """
    watch, log = watch_of(rules), read_log(path)
    known, kinematics = nodes_of(logged_tree(log, nodes)), Kinematics(logged_motion(log))
    violations: list[Violation] = []
    count = 0

    def take(tick: LoggedTick, entries: Mapping[str, Any]) -> None:
        nonlocal count
        count += 1
        known.follow(tick.changes)
        violations.extend(
            watch.step(tick.number, Situation(tick.time_s, tick.observation, tick.command, entries, known, kinematics))
        )

    lacks = [log.unfinished] if log.unfinished else []
    if watch.names_entries:
        lacks += _replayed(log, Changes(nodes=tuple(nodes), beside=tuple(beside)), lambda step: take(*step))
    else:
        for tick in log.ticks:
            take(tick, {})
    return Judged(path, count, tuple(violations), watch.ticks, "; ".join(lacks))


def _replayed(log: Log, changes: Changes, take: Any) -> list[str]:
    """Replay a log for its entries; what of it does not go as it was, in words."""
    found: list[str] = []

    def step(replayed: Step) -> None:
        if replayed.differences and not found:
            found.append(
                f"from {replayed.logged.time_s:.2f} s on the replay differs: its entries are not those of the run"
            )
        take((replayed.logged, replayed.blackboard))

    Replay(log, changes).run(watch=step)
    return found


def rule_lines(judged: Sequence[Judged]) -> list[str]:
    """For people: each violation with its log, then of each rule in how many logs it was broken, and ticks by outcome.

    A log in which a rule was unknown in some tick, and never broken, does not count as kept.
    """
    lines = [f"{verdict.log}: {violation}" for verdict in judged for violation in verdict.violations]
    lines += [f"{verdict.log}: {verdict.lacks}" for verdict in judged if verdict.lacks]
    rows: list[tuple[str, ...]] = [("rule", *OUTCOMES)]
    for name in judged[0].rules if judged else ():
        ticks = [verdict.rules[name] for verdict in judged]
        logs = [sum(not broken and not unknown for _, broken, unknown in ticks), sum(bool(tick[1]) for tick in ticks)]
        counts = (*logs, len(ticks) - sum(logs))
        rows.append((name, *(f"{logs} ({sum(tick[n] for tick in ticks)})" for n, logs in enumerate(counts))))
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines.append(f"{counted(len(judged), 'log')} (ticks):")
    return lines + [
        "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]
