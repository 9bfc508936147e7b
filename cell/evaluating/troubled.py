"""Assemblies with several random faults each: right in the end, or ended as the table of faults promises."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cell.evaluating.assembly import assembly
from cell.running.injection import FAULTS, OTHER_STATES, STATES, Injection, Injections

EVERY_STATE = (*STATES, *OTHER_STATES)


def troubled_assembly(path: Path, seed: int, faults: int, *, rendered: bool = False) -> dict[str, object]:
    """One assembly beside a careful person; a fault comes the first time that the work is in its state.

    Returns:
        what happened. `as_promised`: finished and right, or ended as one of the faults that came may end it. `unknown`:
        it says that it is finished, and the bracket is wrong.
    """
    rng = np.random.default_rng([seed, faults])
    drawn = [(str(rng.choice(list(FAULTS))), str(rng.choice(EVERY_STATE))) for _ in range(faults)]
    injected = Injections([Injection(*pair) for pair in drawn])
    with assembly(path, "careful", seed, rendered=rendered) as opened:
        outcome = opened.run([], injected)
        score = opened.cell.score.report()
    came = [one.fault for one in injected.injections if one.began_s is not None]
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
