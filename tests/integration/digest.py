"""Runs one assembly and prints how it ended and a digest of everything that was decided: `digest.py GOAL SEED`."""

from __future__ import annotations

import hashlib
import json
import sys

from tests.integration.cell_rig import ASSEMBLE, run_tree, with_person


def main(goal: str, seed: int) -> None:
    with with_person(goal, seed) as cell:
        outcome, recorded = run_tree(cell, ASSEMBLE)
        report = cell.score.report()
    decided = repr((recorded.joints, recorded.statuses, recorded.notes)).encode()
    ending = {"end": outcome.end, **report, "last_joints": repr(recorded.joints[-1]), "ticks": len(recorded.joints)}
    print(json.dumps({**ending, "digest": hashlib.sha256(decided).hexdigest()}))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
