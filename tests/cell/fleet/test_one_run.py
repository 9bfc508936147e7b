"""The process that calls are made in: what it cannot read is an error, and keeps no other call from it."""

from __future__ import annotations

import os
import sys
import threading
from types import ModuleType
from typing import Any

import pytest

from cell.errors import CellError
from cell.fleet import one_run
from cell.fleet.one_run import in_child
from tests.cell.fleet import working


@pytest.fixture(autouse=True)
def ended() -> Any:
    yield
    if one_run._child is not None:
        one_run._child._process.kill()
        one_run._child.close()
        one_run._child = None


def test_a_function_that_is_not_there_is_an_error_and_the_next_call_is_answered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    module = ModuleType("only_here")
    exec("def answer(): return 1", module.__dict__)
    monkeypatch.setitem(sys.modules, "only_here", module)
    with pytest.raises(ModuleNotFoundError, match="only_here"):
        in_child(module.answer)
    assert next_call_is_answered()


def test_an_error_that_cannot_be_made_again_is_told_in_words_and_the_next_call_is_answered() -> None:
    with pytest.raises(CellError, match="Awkward: the run: it is odd"):
        in_child(working.awkward)
    assert next_call_is_answered()


def next_call_is_answered() -> bool:
    """By another process than this one, in a time."""
    found: list[int] = []
    asking = threading.Thread(target=lambda: found.append(in_child(os.getpid)), daemon=True)
    asking.start()
    asking.join(20)
    return bool(found) and found[0] != os.getpid()
