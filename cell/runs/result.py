"""How a run went, by the keys of `cell run --json`."""

from __future__ import annotations

import resource
from dataclasses import dataclass

from cell.interfaces.devices import Devices
from cell.recording.recorder import McapRecorder
from cell.runs.options import Files, RunOptions
from cell.watching.brackets import BracketTally
from cell.watching.fluency import Fluency
from cell.watching.lateness import Lateness
from cell.watching.observer import Observer, Outcome
from cell.watching.statistics import RunStatistics


@dataclass(frozen=True)
class Counts:
    """Observers that count what a summary shows.

    Attributes:
        tally: knows the brackets of a run that this one goes on with, too.
        judged_before: brackets that were judged at this bench before the first one of the tally.
    """

    statistics: RunStatistics
    lateness: Lateness
    fluency: Fluency
    tally: BracketTally
    judged_before: int = 0

    @property
    def observers(self) -> tuple[Observer, ...]:
        return (self.statistics, self.tally, self.fluency, self.lateness)

    def job(self, devices: Devices) -> dict[str, object]:
        """How the job was done; of a shift bracket by bracket."""
        done = devices.report()
        judged = [*devices.finished(), done]
        unknown: list[dict[str, object]] = [{}] * -self.judged_before
        shift = self.tally.report([*unknown, *judged[max(0, self.judged_before) :]])
        return {**done, **self.statistics.report(), **self.fluency.report(), **shift}


def summary_of(
    options: RunOptions,
    files: Files,
    outcome: Outcome,
    counts: Counts,
    devices: Devices,
    recorder: McapRecorder,
    sheet: str,
) -> dict[str, object]:
    """Everything that is reported about a run."""
    speed = outcome.sim_time_s / outcome.wall_time_s if outcome.wall_time_s > 0 else 0.0
    return {
        "finished": outcome.end == "finished",
        "end": outcome.end,
        "reason": outcome.reason,
        "cause": str(counts.statistics.cause) if outcome.end == "failed" else "",
        "condition": outcome.condition,
        "observer_problems": list(outcome.observer_problems),
        **counts.job(devices),
        **counts.lateness.report(),
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
