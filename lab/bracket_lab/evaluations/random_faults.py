"""Assemblies with several random faults each: right in the end, or ended as the table of faults promises."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bracket_cell.watching.work_state import OTHER_STATES, STATES
from bracket_ground.files.row_store import Row
from bracket_lab.evaluations.assembly import assembly
from bracket_sim.faults.injection import Injection, Injections
from bracket_sim.faults.named_faults import FAULTS

RECOVERABLE = 0.8  # share of faults that a run can recover from
EVERY_STATE = (*STATES, *OTHER_STATES)


def troubled_assembly(path: Path, seed: int, faults: int, *, rendered: bool = False) -> dict[str, object]:
    """One assembly beside a careful person; a fault comes the first time that the work is in its state.

    Returns:
        what happened. `as_promised`: finished and right, or ended as one of the faults that came may end it. `unknown`:
        it says that it is finished, and the bracket is wrong.
    """
    rng = np.random.default_rng([seed, faults])
    drawn = [_fault(rng) for _ in range(faults)]
    injected = Injections([Injection(*pair) for pair in drawn])
    with assembly(path, "careful", seed, rendered=rendered) as opened:
        outcome = opened.run([], injected)
        score = opened.cell.score.report()
    came = [injection.fault for injection in injected.injections if injection.began_s is not None]
    ends = {end for fault in came for end in (*FAULTS[fault].ends, *(FAULTS[fault].holding_ends or ()))}
    finished, right = outcome.end == "finished", bool(score["correct"])
    return {
        "seed": seed,
        "faults": [f"{fault}@{state}" for fault, state in drawn],
        "came": came,
        "end": outcome.end,
        "exit_status": outcome.exit_status,
        "reason": outcome.reason,
        "condition": outcome.condition,
        "sim_time_s": round(outcome.sim_time_s, 1),
        "correct": right,
        "wrong_placements": score["wrong_placements"],
        "as_promised": right if finished else outcome.end in ends,
        "unknown": finished and not right,
    }


def _fault(rng: np.random.Generator) -> tuple[str, str]:
    """A fault and when it comes; mostly one that a run can recover from, as a single other one ends the run."""
    recoverable = [name for name, kind in FAULTS.items() if "finished" in kind.ends]
    others = [name for name in FAULTS if name not in recoverable]
    fault = str(rng.choice(recoverable if rng.random() < RECOVERABLE else others))
    return fault, str(rng.choice(FAULTS[fault].states or EVERY_STATE))


def counted(rows: Sequence[Row]) -> Row:
    """How many finished right, how many ended in the condition that the table of faults states, and how."""
    right = sum(row["end"] == "finished" and bool(row["correct"]) for row in rows)
    promised = sum(bool(row["as_promised"]) for row in rows)
    return {
        "assemblies": len(rows),
        "as_promised": promised,
        "finished_right": right,
        "ended_as_stated": promised - right,
        "unknown": sum(bool(row["unknown"]) for row in rows),
        "ends": dict(Counter(str(row["end"]) for row in rows).most_common()),
    }
