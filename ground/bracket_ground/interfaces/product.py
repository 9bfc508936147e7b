"""The product: part types, positions of the bracket and goal configurations (config/products.yaml)."""

from __future__ import annotations

from collections import Counter
from functools import cached_property
from typing import Literal

from pydantic import Field, field_validator, model_validator

from bracket_ground.files.model import Disagreement, Location, Model
from bracket_ground.files.units import Coordinate, Length, Rgb
from bracket_ground.interfaces.solid import AXES, Solid, span_m

RESERVED = ("none of these", "random")  # the unknown goal of a belief; any goal, as an option
BOX = "box"
FILLS_M = 2e-4  # the solids of a shape must reach as far as size_m says, to this much


class PartType(Model):
    """A valve type: a body on a round peg; upright, the peg points down.

    Attributes:
        title: its name for people.
        quantity: how many one product needs.
        size_m: (length, width, height) of the body; the gripper closes across the width.
        peg_diameter_m: diameter of the peg below the body, which goes into a hole.
        peg_length_m: length of that peg.
        colour_rgb: of its paint or metal; the classical detector finds parts by it.
        mass_kg: mass of the whole part.
        finish: what its surface is; bare steel shines.
        shape: the solids that the body is made of, which together fill size_m; `box` is a plain box.
    """

    title: str
    quantity: int = Field(ge=1, le=100)
    size_m: tuple[Length, Length, Length]
    peg_diameter_m: Length
    peg_length_m: Length
    colour_rgb: Rgb
    mass_kg: float = Field(gt=0, le=10)  # a UR10's payload
    finish: Literal["paint", "steel"] = "paint"
    shape: tuple[Solid, ...] = ()

    @cached_property
    def solids(self) -> tuple[Solid, ...]:
        """The body's solids; of a plain box the one that fills it."""
        return self.shape or (Solid(solid="box", size_m=self.size_m, centre_m=(0.0, 0.0, self.size_m[2] / 2)),)

    @cached_property
    def whole(self) -> tuple[Solid, ...]:
        """The body's solids and the peg."""
        diameter, length = self.peg_diameter_m, self.peg_length_m
        peg = Solid(solid="cylinder", size_m=(diameter, diameter, length), centre_m=(0.0, 0.0, -length / 2))
        return *self.solids, peg

    @cached_property
    def alike_after_half_turn(self) -> bool:
        """Whether nobody can tell the body's two ends apart."""
        return Counter(solid.mark(1) for solid in self.solids) == Counter(solid.mark(-1) for solid in self.solids)

    @field_validator("shape", mode="before")
    @classmethod
    def _box_is_a_word(cls, value: object) -> object:
        if value == BOX:
            return ()
        if isinstance(value, str):
            raise ValueError(f"must be {BOX!r} or a list of solids")
        return value

    @model_validator(mode="after")
    def _shape_fills_size(self) -> PartType:
        length, width, height = self.size_m
        wanted = ((-length / 2, length / 2), (-width / 2, width / 2), (0.0, height))
        problems: list[tuple[Location, str]] = []
        for axis, (low, high) in enumerate(wanted):
            span = span_m(self.shape, axis)
            if span is not None and max(abs(span[0] - low), abs(span[1] - high)) > FILLS_M:
                what = f"the solids reach from {span[0]:.4g} to {span[1]:.4g} m along {AXES[axis]}"
                problems.append((("shape",), f"{what}, but size_m says from {low:.4g} to {high:.4g} m"))
        if problems:
            raise Disagreement(problems)
        return self


class Bracket(Model):
    """The steel bracket: a plate with one hole for each position.

    Attributes:
        thickness_m: depth of the holes; parts' bodies rest on its upper side.
        hole_clearance_m: radial gap between a peg and its hole.
        margin_m: plate beyond the outermost hole centres.
        holes_m: hole centres (x, y) by position, in the bracket's frame (origin on its upper side).
    """

    thickness_m: Length
    hole_clearance_m: float = Field(gt=0, le=0.05)
    margin_m: Length
    holes_m: dict[str, tuple[Coordinate, Coordinate]] = Field(min_length=1)


class Product(Model):
    """Part types, positions and goals of one product; the valve bracket has 3, 6 and 3.

    Attributes:
        name: its name for people.
        parts: part types by name, in the order that planners index them.
        bracket: what the parts are put into.
        goals: by goal name, the part type at every position, in the order of `bracket.holes_m`.
        goal_titles: names of goals for people; a goal without one goes by its own.
    """

    name: str
    parts: dict[str, PartType] = Field(min_length=1)
    bracket: Bracket
    goals: dict[str, tuple[str, ...]] = Field(min_length=1)
    goal_titles: dict[str, str] = {}  # noqa: RUF012 - pydantic copies it

    @cached_property
    def positions(self) -> tuple[str, ...]:
        """Position names in order: p1, p2, ..."""
        return tuple(self.bracket.holes_m)

    @cached_property
    def hole_radius_m(self) -> float:
        """Of every hole: the widest peg fits with its clearance."""
        return max(part.peg_diameter_m for part in self.parts.values()) / 2 + self.bracket.hole_clearance_m

    def title(self, part: str) -> str:
        """Like "gate valve (o1)"; what is no part type stays as it is."""
        return f"{self.parts[part].title} ({part})" if part in self.parts else part

    def goal_title(self, goal: str) -> str:
        """Its name for people."""
        return self.goal_titles.get(goal, goal)

    def goal_placements(self, goal: str) -> dict[str, str]:
        """Part type by position in one goal."""
        return dict(zip(self.positions, self.goals[goal], strict=True))

    @model_validator(mode="after")
    def _goals_fit(self) -> Product:
        problems: list[tuple[Location, str]] = []
        seen: dict[tuple[str, ...], str] = {}
        for goal, types in self.goals.items():
            if what := self._misfit(goal, types):
                problems.append((("goals", goal), what))
            elif types in seen:
                problems.append((("goals", goal), f"goal {goal} is the same configuration as {seen[types]}"))
            seen.setdefault(types, goal)
        unknown = sorted(set(self.goal_titles) - set(self.goals))
        problems += [(("goal_titles", goal), f"no goal {goal}; legal: {', '.join(self.goals)}") for goal in unknown]
        if problems:
            raise Disagreement(problems)
        return self

    def _misfit(self, goal: str, types: tuple[str, ...]) -> str | None:
        """Why a goal does not fit parts and positions, or None where it does."""
        if goal in RESERVED:
            return f"{goal!r} cannot be the name of a goal: the cell itself uses it"
        if unknown := sorted(set(types) - set(self.parts)):
            return f"goal {goal} names unknown part types {unknown}; known: {sorted(self.parts)}"
        if len(types) != len(self.positions):
            return f"goal {goal} lists {len(types)} parts for {len(self.positions)} positions"
        needed = Counter({name: part.quantity for name, part in self.parts.items()})
        if (counts := Counter(types)) != needed:
            return f"goal {goal} needs {_quantities(counts)}, but the quantities are {_quantities(needed)}"
        return None


def _quantities(counts: Counter[str]) -> str:
    return ", ".join(f"{count} x {name}" for name, count in sorted(counts.items()))
