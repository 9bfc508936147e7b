"""Errors go from one process to another as they are."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

from bracket_ground.errors import CellError, DeviceFault, InputError, LogError, Place, Problem, SettingError

ERRORS = [
    CellError("something"),
    InputError(Problem(Place(Path("a.yaml"), 3, 4), "unknown key", "legal: b"), "and this"),
    SettingError((("bench", "tray"), "too small"), (("product",), "no colour")),
    DeviceFault("arm", "left its trajectory"),
    LogError(Path("a.mcap"), "damaged"),
]


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_a_pickled_error_says_and_knows_the_same(error: CellError) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert (str(again), again.args, vars(again)) == (str(error), error.args, vars(error))
