"""What holds for every test."""

from __future__ import annotations

import os
import re
import signal
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

import bracket_sim as _sim  # noqa: F401  (it says how MuJoCo renders, before a test imports that)
from tests.processes import children

KEPT = ("multiprocessing.resource_tracker", "multiprocessing.forkserver")  # Python's own; they end with the process


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Files of the other half of the suite are not even imported: see .ci/test."""
    marks = str(config.option.markexpr)
    if "torch" not in marks or collection_path.suffix != ".py":
        return None
    text = collection_path.read_text()
    whole = re.search(r"^pytestmark = .*mark\.torch", text, re.MULTILINE)
    return (bool(whole) if "not torch" in marks else "mark.torch" not in text) or None


def pytest_collection_finish(session: pytest.Session) -> None:
    if named := [item.nodeid for item in session.items if re.search(r" at 0x[0-9a-f]+", item.nodeid)]:
        raise pytest.UsageError(f"an address names a test, so that workers collect different ones: {named[0]}")
    if "not torch" in str(session.config.option.markexpr) and "torch" in sys.modules:
        raise pytest.UsageError("a file without 'pytestmark = pytest.mark.torch' imports torch, which takes seconds")


@pytest.fixture(autouse=True)
def _no_child_survives() -> Iterator[None]:
    """A child that outlives its test is killed, and the test that left it fails, not a later one."""
    before = children()
    yield
    left = {one: line for one, line in children().items() if one not in before and not any(k in line for k in KEPT)}
    for one in left:
        with suppress(ProcessLookupError):
            os.kill(one, signal.SIGKILL)
    assert not left, f"still running after the test: {'; '.join(left.values())}"
