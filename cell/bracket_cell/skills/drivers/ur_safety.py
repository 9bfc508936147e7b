"""What the safety mode of Universal Robots' controllers says: its name, and whether the arm may move.

Numbers and names: Universal Robots' client library, `SafetyMode`. A number that is not here is a fault.
"""

from __future__ import annotations

from typing import NamedTuple

from bracket_ground.interfaces.observation import ArmMode


class Safety(NamedTuple):
    """A safety mode, and its name in words."""

    mode: ArmMode
    name: str

    @property
    def reason(self) -> str:
        """Why the arm must not move; empty where it may."""
        return "" if self.mode in ("normal", "reduced") else f"the controller is in {self.name}"


SAFETY: dict[int, Safety] = {
    1: Safety("normal", "normal"),
    2: Safety("reduced", "reduced"),
    3: Safety("protective_stop", "protective stop"),
    4: Safety("recovery", "recovery"),
    5: Safety("safeguard_stop", "safeguard stop"),
    6: Safety("emergency_stop", "system emergency stop"),
    7: Safety("emergency_stop", "robot emergency stop"),
    8: Safety("violation", "violation"),
    9: Safety("fault", "fault"),
    10: Safety("fault", "validate joint id"),
    11: Safety("fault", "undefined safety mode"),
    12: Safety("safeguard_stop", "automatic mode safeguard stop"),
    13: Safety("safeguard_stop", "system three position enabling stop"),
    14: Safety("safeguard_stop", "tp three position enabling stop"),
    15: Safety("emergency_stop", "immi emergency stop"),
    16: Safety("safeguard_stop", "immi safeguard stop"),
    17: Safety("fault", "profisafe waiting for parameters"),
    18: Safety("safeguard_stop", "profisafe automatic mode safeguard stop"),
    19: Safety("safeguard_stop", "profisafe safeguard stop"),
    20: Safety("emergency_stop", "profisafe emergency stop"),
    22: Safety("safeguard_stop", "safety api safeguard stop"),
}


def safety_of(number: int | None) -> Safety:
    """What a controller tells as its safety mode; None where it told none."""
    mode = "not told" if number is None else number
    return SAFETY.get(number or 0, Safety("fault", f"an unknown safety mode, {mode}"))
