"""A cell that reads no holes, as the paper's: what is placed is known from the hand alone."""

from __future__ import annotations

from collections.abc import Mapping

from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HandSample, HoleView


class NoHoleReader:
    """Reads nothing (HoleReader): the guard waits for ever, unless `guard.holes` is graph."""

    def read(self, frame: Frame, hand: HandSample | None) -> Mapping[str, HoleView]:
        """No hole."""
        del frame, hand
        return {}
