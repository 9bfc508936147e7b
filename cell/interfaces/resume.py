"""Where a run was left off, for one that goes on with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from cell.interfaces.planning import AssemblyState


@dataclass(frozen=True)
class LeftOff:
    """What a controller knew that no camera sees, when it was gone.

    Attributes:
        placed, told_goal, kept, known_wrong, told_parts, taken_out: as in AssemblyState, of the bracket that was worked
            on.
        bracket: number of the last bracket that was begun; 0 outside of a shift.
        ended: that bracket was ended.
        held_part: type of the part that was picked last; whether it is still held, the gripper tells.
        finished: what stood in brackets whose goal was learned, type by position in the product's order.
    """

    placed: Mapping[str, str] = field(default_factory=dict)
    told_goal: str | None = None
    bracket: int = 0
    ended: bool = False
    held_part: str | None = None
    finished: tuple[tuple[str, ...], ...] = ()
    kept: Mapping[str, str | None] = field(default_factory=dict)
    known_wrong: Mapping[str, str | None] = field(default_factory=dict)
    told_parts: Mapping[str, str] = field(default_factory=dict)
    taken_out: Mapping[str, str] = field(default_factory=dict)

    @property
    def state(self) -> AssemblyState:
        """The assembly graph of the bracket that is there; empty where that was ended."""
        if self.ended:
            return AssemblyState({})
        return AssemblyState(
            dict(self.placed),
            self.told_goal,
            kept=self.kept,
            known_wrong=self.known_wrong,
            told_parts=self.told_parts,
            taken_out=self.taken_out,
        )

    @property
    def told(self) -> str:
        """For people."""
        placed = {} if self.ended else self.placed
        words = [", ".join(f"{part} at {position}" for position, part in sorted(placed.items())) or "nothing is placed"]
        words += [f"{self.held_part} was picked last"] if self.held_part else []
        return "; ".join(([f"bracket {self.bracket}"] if self.bracket else []) + words)

    def plain(self) -> dict[str, Any]:
        """For a log."""
        return asdict(self)

    @classmethod
    def of(cls, plain: Mapping[str, Any]) -> LeftOff:
        """From a log."""
        return cls(**{**plain, "finished": tuple(tuple(parts) for parts in plain["finished"])})
