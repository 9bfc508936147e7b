"""Why the cell did what it did at a time of a log: its tree is ticked again up to there, and asked."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from bracket_cell.log.read.reader import Log, LoggedTick
from bracket_cell.log.replay.loading import Changes
from bracket_cell.log.replay.replay import Replay, Step
from bracket_cell.running.controller import STOPPED, STOPPING
from bracket_cell.watching.why_now import Why, WhyNow
from bracket_ground.errors import LogError


@dataclass(frozen=True)
class WhyThen:
    """Why, at a tick of a log.

    Attributes:
        remark: why this may not be what the run decided, for people; else empty.
    """

    tick: LoggedTick
    why: Why
    remark: str = ""


def why_at(log: Log, at_s: float, changes: Changes | None = None) -> WhyThen:
    """After the last tick of the tree up to a time [s].

    Raises:
        LogError: there is no tick so early, or the log cannot be replayed.
        InputError: this version cannot load the tree.
    """
    ticks = [tick for tick in log.ticks if tick.time_s <= at_s and tick.status not in (STOPPED, STOPPING)]
    if not ticks:
        first = f"; its first one is at {log.ticks[0].time_s:.2f} s" if log.ticks else ""
        raise LogError(log.path, f"holds no tick of the tree up to {at_s:g} s{first}")
    replay, last = Replay(log, changes), ticks[-1]
    now, found = WhyNow(lambda: replay.tree), list[Why]()

    def watch(step: Step) -> bool:
        judged = step.now.judgement or {}
        now.take(step.now.notes, str(judged.get("action", "")), _words(judged.get("reasons", ())))
        if step.logged is last:
            found.append(now())
        return step.logged is not last

    compared = replay.run(until_s=last.time_s, watch=watch)
    if not found:
        raise LogError(log.path, f"cannot be ticked again up to {last.time_s:.2f} s: {'; '.join(replay.remarks)}")
    differs = compared.differing_ticks
    told = f"{differs} of {compared.ticks} ticks up to there are decided otherwise than in the run" if differs else ""
    return WhyThen(last, found[0], told)


def _words(reasons: Iterable[object]) -> str:
    return "; ".join(str(one["words"]) for one in reasons if isinstance(one, dict))
