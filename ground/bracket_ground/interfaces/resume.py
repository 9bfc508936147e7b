"""Where a run was left off, for one that goes on with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from bracket_ground.interfaces.planning import AssemblyState


@dataclass(frozen=True)
class ResumeState:
    """What a controller knew that no camera sees, when it was gone.

    Attributes:
        graph: the assembly graph of the bracket that was worked on.
        bracket: number of the last bracket that was begun; 0 outside of a shift.
        ended: that bracket was ended.
        held_part: type of the part that was picked last; whether it is still held, the gripper tells.
        finished: what stood in brackets whose goal was learned, type by position in the product's order.
    """

    graph: AssemblyState = field(default_factory=lambda: AssemblyState({}))
    bracket: int = 0
    ended: bool = False
    held_part: str = ""
    finished: tuple[tuple[str, ...], ...] = ()

    @property
    def state(self) -> AssemblyState:
        """The assembly graph of the bracket that is there; empty where that was ended."""
        return AssemblyState({}) if self.ended else self.graph

    @property
    def under_way(self) -> bool:
        """It broke off within a bracket of a shift."""
        return self.bracket > 0 and not self.ended

    @property
    def summary(self) -> str:
        """For people."""
        placed = self.state.placed
        words = [", ".join(f"{part} at {position}" for position, part in sorted(placed.items())) or "nothing is placed"]
        words += [f"{self.held_part} was picked last"] if self.held_part else []
        return "; ".join(([f"bracket {self.bracket}"] if self.bracket else []) + words)

    def plain(self) -> dict[str, Any]:
        """For a log."""
        return asdict(self)

    @classmethod
    def of(cls, plain: Mapping[str, Any]) -> ResumeState:
        """From a log; older ones have the fields of the graph among the others."""
        names = {entry.name for entry in fields(cls)}
        graph = plain.get("graph") or {name: value for name, value in plain.items() if name not in names}
        others = {name: value for name, value in plain.items() if name in names}
        finished = tuple(tuple(parts) for parts in plain["finished"])
        held_part = plain["held_part"] or ""
        graph = {**graph, **{name: tuple(graph.get(name, ())) for name in ("denied", "fastened")}}
        return cls(**{**others, "graph": AssemblyState(**graph), "finished": finished, "held_part": held_part})
