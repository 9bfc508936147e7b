"""What really happened, where somebody knows it: for logs, labels and judges; the controller never reads it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class TruthEvent:
    """Something that happened at the bench.

    Attributes:
        kind: "action" (of the hand: begins or ends), "act" (of the person, a mistake or a habit), "contact" (of
            person and robot), "resting" (of a part in the tray as the run begins).
        fields: what else is known, with units in the names.
    """

    time_s: float
    kind: str
    fields: Mapping[str, object] = field(default_factory=dict)
