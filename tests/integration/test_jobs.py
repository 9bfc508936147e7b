"""The example jobs do what they say, from pixels; on more seeds by tests/integration/jobs.py."""

from __future__ import annotations

import pytest

from tests.integration import jobs


def test_a_bracket_is_inspected_and_reported() -> None:
    assert [jobs.inspect(seed) for seed in (1, 2)] == [None, None]


@pytest.mark.slow
@pytest.mark.parametrize("job", ["palletise", "kit", "teach"])
def test_the_other_jobs_are_done(job: str) -> None:
    assert jobs.ALL[job](7) is None
