"""How late a camera's stamps are follows from when its image changes and when the joints moved."""

from __future__ import annotations

import numpy as np
import pytest

from bracket_cell.runs.camera_delay import delay_of

TIMES_S = np.arange(0.0, 8.0, 0.008)
PHASE_S = TIMES_S % 2.0
SPEEDS = np.clip(np.minimum(PHASE_S / 0.3, (1.2 - PHASE_S) / 0.3), 0.0, 1.0)  # four swings with a rest after each
PLACES = np.concatenate([[0.0], np.cumsum((SPEEDS[1:] + SPEEDS[:-1]) / 2 * 0.008)])


def seen(late_s: float, rate_hz: float) -> tuple[list[float], list[float]]:
    """Stamps of images that are so late, and how much each differs from the one before it."""
    stamps_s = np.arange(0.3, 8.0, 1 / rate_hz)
    places = np.interp(stamps_s - late_s, TIMES_S, PLACES)
    noise = np.random.default_rng(1).normal(0.0, 0.002, len(stamps_s))
    changes = np.concatenate([[0.0], np.abs(np.diff(places))]) + np.abs(noise)
    return stamps_s.tolist(), changes.tolist()


@pytest.mark.parametrize("rate_hz", [15.0, 30.0])
@pytest.mark.parametrize("late_s", [0.0, 0.03, 0.08, 0.5])
def test_stamps_that_are_late_are_measured(late_s: float, rate_hz: float) -> None:
    found = delay_of(*seen(late_s, rate_hz), TIMES_S.tolist(), SPEEDS.tolist())
    assert found == pytest.approx(late_s, abs=0.012)


def test_images_that_do_not_show_the_arm_tell_nothing() -> None:
    stamps_s, _ = seen(0.0, 15.0)
    noise = np.random.default_rng(2).random(len(stamps_s))
    for changes in (noise.tolist(), [0.0] * len(stamps_s)):
        assert delay_of(stamps_s, changes, TIMES_S.tolist(), SPEEDS.tolist()) is None
