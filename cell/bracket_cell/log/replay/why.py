"""Why the cell did what it did at a time of a log, as the run noted it; nothing is ticked again."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bracket_cell.log.read.indexed import FOREVER_S, IndexedLog
from bracket_cell.log.read.reader import refuse_foreign
from bracket_cell.log.read.ticks import holding
from bracket_cell.recording.schemas import TICKED
from bracket_ground.errors import LogError


def why_at(paths: Sequence[Path], at_s: float = math.inf) -> dict[str, Any]:
    """What was noted last, with the last tick of the tree up to a time [s]: the keys of `Why.plain`, of that tick.

    Raises:
        LogError: there is no tick so early, or the run noted no reasons.
    """
    log = IndexedLog(paths)
    for path in log.paths:
        refuse_foreign(path)
    until_s = min(max(at_s, -1.0), FOREVER_S)
    found: dict[str, Any] = {}
    noted: dict[str, Any] = {}
    for message in log.messages(0.0, until_s, ("/tick", "/note/why"), reverse=True) if until_s >= 0 else ():
        with holding(log.paths[0], f"message of {message.topic} at {message.time_ns / 1e9:.3f} s"):
            fields = json.loads(message.data)
            if message.topic == "/tick" and not found and fields["status"] in TICKED:
                found = {"tick": fields["tick"], "time_s": message.time_ns / 1e9, "status": fields["status"]}
            elif message.topic == "/note/why" and not noted:
                noted = {**fields, "text": str(fields["text"]), "otherwise": str(fields["otherwise"])}
            if found and noted:
                return {**noted, **found}
    if not found:
        raise LogError(log.paths[0], "holds no tick of the tree up to the time that was asked for")
    raise LogError(log.paths[0], "holds no record of reasons, as releases before 0.13 wrote none")
