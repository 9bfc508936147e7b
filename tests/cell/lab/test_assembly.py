"""Many assemblies in one process need no more memory than a few."""

from __future__ import annotations

import gc
import weakref

from bracket_cell.configuration import DEFAULT_CONFIGURATION
from bracket_lab.evaluations.assembly import assembly


def test_a_cell_is_gone_when_the_next_one_is_opened() -> None:
    gc.disable()  # as rarely as `cell` searches for garbage
    try:
        with assembly(DEFAULT_CONFIGURATION, "careful", 1) as opened:
            first = weakref.ref(opened.cell.world)
        del opened
        with assembly(DEFAULT_CONFIGURATION, "careful", 2):
            assert first() is None
    finally:
        gc.enable()
