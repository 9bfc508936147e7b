"""Nothing that is random or hostile ends in a traceback or takes long."""

from __future__ import annotations

import pytest

from tests.trees.fuzz import fuzz


def test_random_files_scripts_and_messages_are_answered() -> None:
    fuzz(500)


@pytest.mark.slow
def test_many_random_files_scripts_and_messages_are_answered() -> None:
    fuzz(50_000, first_seed=1000)
