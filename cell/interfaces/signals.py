"""Digital signals: lamps, valves, light barriers, a conveyor that is ready."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol


class Signals(Protocol):
    """Inputs and outputs by their names in the configuration."""

    def read(self) -> Mapping[str, bool]:
        """All inputs as last told, and all outputs as last set; raises DeviceFault when the module is silent."""
        ...

    def write(self, name: str, value: bool) -> None:
        """Set an output; it keeps its value until it is set again, also after the run."""
        ...

    def close(self) -> None:
        """Let go of the bus."""
        ...
