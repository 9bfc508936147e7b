"""How a run went, by the keys of `cell run --json`."""

from __future__ import annotations

import resource

from cell.interfaces.devices import Devices
from cell.observer import Outcome
from cell.recording.recorder import McapRecorder
from cell.run_options import Files, RunOptions
from cell.running.brackets import BracketTally
from cell.running.fluency import Fluency
from cell.running.statistics import RunStatistics


def summary_of(
    options: RunOptions,
    files: Files,
    outcome: Outcome,
    statistics: RunStatistics,
    fluency: Fluency,
    tally: BracketTally,
    devices: Devices,
    recorder: McapRecorder,
    sheet: str,
) -> dict[str, object]:
    """Everything that is told of a run; of a shift bracket by bracket."""
    speed = outcome.sim_time_s / outcome.wall_time_s if outcome.wall_time_s > 0 else 0.0
    return {
        "finished": outcome.end == "finished",
        "end": outcome.end,
        "reason": outcome.reason,
        "cause": str(statistics.cause) if outcome.end == "failed" else "",
        "condition": outcome.condition,
        "observer_problems": list(outcome.observer_problems),
        **devices.report(),
        **statistics.report(),
        **fluency.report(),
        **tally.report([*devices.finished(), devices.report()]),
        "ticks": outcome.ticks,
        "overruns": outcome.overruns,
        "sim_time_s": round(outcome.sim_time_s, 3),
        "wall_time_s": round(outcome.wall_time_s, 3),
        "real_time_factor": round(speed, 2),
        "perception": files.configuration.perception.words,
        "seed": options.seed,
        "peak_rss_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
        "log": str(recorder.path),
        "log_parts": recorder.parts,
        "log_complete": recorder.complete,
        "log_shortfall": recorder.shortfall,
        "contact_sheet": sheet,
    }
