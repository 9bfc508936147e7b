"""The product: part types, slots of the bracket, goals, and their order (config/products.yaml)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from functools import cached_property
from itertools import combinations
from math import dist
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from pydantic import ConfigDict, Field, ValidationInfo, field_validator, model_validator

from bracket_ground.files.model import Disagreement, Location, Model
from bracket_ground.files.units import Coordinate, Gap, Length, Rgb, Side
from bracket_ground.files.yaml_file import has_key, load_yaml
from bracket_ground.interfaces.brackets import with_brackets
from bracket_ground.interfaces.meshes import hull_of, read_mesh
from bracket_ground.interfaces.places import FRAMES
from bracket_ground.interfaces.solid import AXES, Solid, span_m
from bracket_ground.interfaces.steps import Fastening, in_order
from bracket_ground.interfaces.variants import (
    EMPTY,
    Choice,
    OtherBracket,
    arrangements_n,
    can_be_expanded,
    completed,
    places,
    types_of,
    with_listed_goals,
    with_quantities,
)
from bracket_ground.interfaces.wholes import unfit_wholes, with_wholes

PARTING = ",;:{}"  # what parts names from each other in commands, and in ports and poses of tree files
RESERVED = ("none of these", "random")  # the unknown goal of a belief; any goal, as an option
BOX = "box"
MOST_SOLIDS = 200  # of a part: what physics and pictures still follow
FILLS_M = 2e-4  # the solids of a shape must reach as far as size_m says, to this much


def _made_of_parts_too(schema: dict[str, Any]) -> None:
    """In a file a sub-assembly needs neither size nor colour nor mass: they follow from its parts."""
    schema["anyOf"] = [{"required": schema.pop("required")}, {"required": ["title", "made_of", "built_at"]}]


class PartType(Model):
    """A type of part: a body, on a round peg if it has one; upright, the peg points down.

    Attributes:
        title: its name for people.
        quantity: how many lie ready for one product; by default what the goal that takes most takes. A type of quantity
            0 is in no goal, and stands at places of the bench alone.
        size_m: (length, width, height) of the body; the gripper closes across the width.
        peg_diameter_m: diameter of the peg below the body, which goes into a hole; 0 for a part that stands on its
            body.
        peg_length_m: length of that peg.
        colour_rgb: of its paint or metal; the classical detector finds parts by it.
        mass_kg: mass of the whole part.
        finish: what its surface is; bare steel shines.
        magnetic: a magnet holds it.
        shape: the solids that the body is made of, which together fill size_m; `box` is a plain box.
        mesh: file (.stl or .obj, in metres) in place of a shape: the hulls of its shells, in the part's frame.
            `cell new part` makes it.
        made_of: of a sub-assembly, the types that it is built of, from the bottom up: they stand on each other. Size,
            shape, peg and mass follow, and the colour is that of the uppermost.
        built_at: of a sub-assembly, the place of the bench where it is built; from there it is put in whole.
    """

    model_config = ConfigDict(json_schema_extra=_made_of_parts_too)

    title: str
    quantity: int = Field(default=1, ge=0, le=100)
    size_m: tuple[Side, Side, Side]
    peg_diameter_m: Gap = 0.0
    peg_length_m: Gap = 0.0
    colour_rgb: Rgb
    mass_kg: float = Field(gt=0, le=10)  # what large arms of such cells carry
    finish: Literal["paint", "steel"] = "paint"
    magnetic: bool = False
    shape: tuple[Solid, ...] = Field(default=(), max_length=MOST_SOLIDS)
    mesh: Path | None = None
    made_of: tuple[str, ...] = ()
    built_at: str = ""

    @cached_property
    def solids(self) -> tuple[Solid, ...]:
        """The body's solids; of a plain box the one that fills it."""
        return self.shape or (Solid(solid="box", size_m=self.size_m, centre_m=(0.0, 0.0, self.size_m[2] / 2)),)

    @cached_property
    def whole(self) -> tuple[Solid, ...]:
        """The body's solids and the peg."""
        diameter, length = self.peg_diameter_m, self.peg_length_m
        if not length:
            return self.solids
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

    @model_validator(mode="before")
    @classmethod
    def _mesh_is_a_shape(cls, value: Any, info: ValidationInfo) -> Any:
        """The hulls of a mesh; who gets the product ready made needs no file."""
        if not isinstance(value, dict) or not isinstance(value.get("mesh"), str | Path):
            return value
        if value.get("shape"):
            raise Disagreement([(("mesh",), "give either mesh or shape")])
        path = Path((info.context or {}).get("folder", ".")).resolve() / value["mesh"]
        try:
            hulls = [Solid.hull(hull_of(piece.points_m).points_m) for piece in read_mesh(path).pieces]
        except ValueError as error:
            raise Disagreement([(("mesh",), str(error))]) from None
        return {**value, "mesh": None, "shape": hulls}

    @model_validator(mode="after")
    def _peg_is_whole(self) -> PartType:
        if (self.peg_diameter_m > 0) != (self.peg_length_m > 0):
            raise ValueError("a peg has a diameter and a length; a part without one has neither")
        return self

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
        plates: positions of each plate, where there are several in one frame; by default one has them all.
    """

    thickness_m: Side
    hole_clearance_m: float = Field(gt=0, le=0.05)
    margin_m: Length
    holes_m: dict[str, tuple[Coordinate, Coordinate]] = Field(min_length=1)
    plates: tuple[tuple[str, ...], ...] = ()


def _by_slot_too(schema: dict[str, Any]) -> None:
    """In a file a goal may be by slot name, too."""
    listed = schema["additionalProperties"]
    by_slot = {"type": "object", "additionalProperties": listed["items"]}
    schema["additionalProperties"] = {"anyOf": [listed, by_slot]}


class Product(Model):
    """A family of products: part types, slots (the bracket's holes), goals, and what comes before what.

    The valve bracket has 3 part types, 6 slots and 3 goals.

    Attributes:
        name: its name for people.
        parts: part types by name, in the order that planners index them.
        bracket: what the parts are put into.
        goals: by goal name, what every slot takes, in the order of `bracket.holes_m`: a part type, `empty`, or a list
            of part types of which any one is right. Or by slot name; slots that are not named stay empty.
        goal_titles: names of goals for people; a goal without one goes by its own.
        goal_quantities: by goal name, at most how many parts of a type it takes, where lists leave that open.
        accepts: by slot, the part types that fit into it; without an entry all do.
        fastenings: steps that fasten what is placed, by name.
        before: pairs of steps of which the first comes before the second: slots, and names of fastenings.
        carried_by: by slot of a second layer, the slot whose part carries it. Its place (x, y) is among
            `bracket.holes_m`, its height is that of the part.
        brackets: by name, where brackets stand (x, y), in the frame of the own one: copies of it, or others by their
            product files. Each is built as any goal, whatever the others are: slots are named like left_p1, goals
            like g0+g2.
    """

    name: str
    parts: dict[str, PartType] = Field(min_length=1)
    bracket: Bracket
    goals: dict[str, tuple[Choice, ...]] = Field(min_length=1, json_schema_extra=_by_slot_too)
    goal_titles: dict[str, str] = {}  # noqa: RUF012 - pydantic copies it
    goal_quantities: dict[str, dict[str, int]] = {}  # noqa: RUF012
    accepts: dict[str, tuple[str, ...]] = {}  # noqa: RUF012
    fastenings: dict[str, Fastening] = {}  # noqa: RUF012
    before: tuple[tuple[str, str], ...] = ()
    carried_by: dict[str, str] = {}  # noqa: RUF012
    brackets: dict[str, tuple[Coordinate, Coordinate] | OtherBracket] = {}  # noqa: RUF012 - gone after loading, see with_brackets

    @cached_property
    def positions(self) -> tuple[str, ...]:
        """Position names in order: p1, p2, ..."""
        return tuple(self.bracket.holes_m)

    @cached_property
    def hole_radius_m(self) -> float:
        """Of every hole: the widest peg fits with its clearance."""
        return max(part.peg_diameter_m for part in self.parts.values()) / 2 + self.bracket.hole_clearance_m

    @cached_property
    def assembled(self) -> tuple[str, ...]:
        """Types that lie ready in bins; the others are built, or stand at places of the bench alone."""
        return tuple(name for name, part in self.parts.items() if part.quantity and not part.made_of)

    @cached_property
    def wholes(self) -> dict[str, PartType]:
        """Sub-assemblies."""
        return {name: part for name, part in self.parts.items() if part.made_of}

    def longest_m(self, types: Collection[str]) -> float:
        """The longest body of some types; of all where there are none."""
        return max(self.parts[part].size_m[0] for part in types or self.parts)

    def title(self, part: str) -> str:
        """Like "gate valve (o1)"; what is no part type stays as it is."""
        return f"{self.parts[part].title} ({part})" if part in self.parts else part

    def goal_title(self, goal: str) -> str:
        """Its name for people."""
        return self.goal_titles.get(goal, goal)

    def accepted(self, goal: str) -> dict[str, tuple[str, ...]]:
        """By slot that a goal fills, the part types that are right there."""
        return dict(self._accepted[goal])

    def goal_placements(self, goal: str, placed: Mapping[str, str] = MappingProxyType({})) -> dict[str, str]:
        """Part type by position in one goal, of the positions that it fills.

        Args:
            placed: part type by position; of several types that are right the one that is there already counts.
        """
        found = completed(self._accepted[goal], self.goal_quantities.get(goal, {}), placed)
        assert found is not None  # checked when the file was read
        return found

    def places(self, goal: str, placed: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
        """By part type, the open positions of one goal that take it, no more than parts of it are left."""
        return places(self._accepted[goal], self.goal_quantities.get(goal, {}), placed, self.most)

    def fits(self, goal: str, placed: Mapping[str, str]) -> bool:
        """Whether everything that is placed can stay in this goal."""
        return placed.items() <= self.goal_placements(goal, placed).items()

    def goal_of(self, placed: Mapping[str, str]) -> str | None:
        """The narrowest goal that these parts, by position, make; None where they make none that is whole."""
        return next(iter(self.goals_listed_as(self.as_listed(placed))), None)

    def goals_listed_as(self, parts: tuple[str, ...]) -> list[str]:
        """Goals that an arrangement makes, see `as_listed`: the fewer others make one, the earlier it comes."""
        placed = {slot: part for slot, part in zip(self.positions, parts, strict=False) if part != EMPTY}
        made = [goal for goal in self.goals if self.goal_placements(goal, placed) == placed]
        return sorted(made, key=lambda goal: arrangements_n(self.goals[goal]))

    def slot_m(self, slot: str) -> tuple[float, float, float]:
        """Where a part stands in a slot, in the bracket's frame."""
        return *self.bracket.holes_m[slot], self.height_m(slot)

    def height_m(self, slot: str) -> float:
        """Of a slot above the plate."""
        if (below := self.carried_by.get(slot)) is None:
            return 0.0
        return self.height_m(below) + max(self.parts[part].size_m[2] for part in self.types_at(below))

    def types_at(self, slot: str) -> frozenset[str]:
        """Part types that some goal puts into a slot."""
        return frozenset(part for goal in self.goals for part in self._accepted[goal].get(slot, ()))

    @property
    def through(self) -> dict[str, tuple[float, float]]:
        """Centres (x, y) of the holes in the plate, by slot; slots on parts have none."""
        return {slot: at for slot, at in self.bracket.holes_m.items() if slot not in self.carried_by}

    @cached_property
    def varies(self) -> bool:
        """Whether goals differ in more than the arrangement of the same parts over all slots."""
        counts = {frozenset(Counter(choices).items()) for choices in self.goals.values()}
        return len(counts) > 1 or any(len(types_of(part)) != 1 for part in next(iter(self.goals.values())))

    @cached_property
    def most(self) -> Counter[str]:
        """By part type, how many of it the goal takes that may take most."""
        return Counter({part: max(self.remaining(goal, {})[part] for goal in self.goals) for part in self.parts})

    def remaining(self, goal: str, placed: Mapping[str, str]) -> Counter[str]:
        """By part type, in how many open slots of a goal it is right; of alternatives each counts."""
        limits, there = self.goal_quantities.get(goal, {}), Counter(placed.values())
        slots = Counter(part for slot, parts in self._accepted[goal].items() if slot not in placed for part in parts)
        return Counter({part: min(n, limits.get(part, n + there[part]) - there[part]) for part, n in slots.items()})

    @cached_property
    def predecessors(self) -> dict[str, frozenset[str]]:
        """By step, the steps that come right before it."""
        found: dict[str, set[str]] = {step: set() for step in (*self.positions, *self.fastenings)}
        for first, then in self.before:
            found[then].add(first)
        for slot, below in self.carried_by.items():
            found[slot].add(below)
        for name, fastening in self.fastenings.items():
            found[name] |= set(fastening.at)
        return {step: frozenset(steps) for step, steps in found.items()}

    def missing_before(self, step: str, done: Collection[str], filled: Collection[str] | None = None) -> list[str]:
        """What must be done before a step can be.

        Args:
            done: filled slots and finished fastenings.
            filled: slots that get a part, where that is known. Others are left out, and the fastenings at them: what
                precedes these counts instead.
        """
        steps = None if filled is None else self.steps_of(filled)
        found: list[str] = []
        look = sorted(self.predecessors[step], reverse=True)
        seen = set(look)
        while look:
            earlier = look.pop()
            if steps is None or earlier in steps:
                found += [earlier] if earlier not in done else []
                continue
            fresh = sorted(self.predecessors[earlier] - seen, reverse=True)
            seen |= set(fresh)
            look += fresh
        return found

    def steps(self, goal: str) -> list[str]:
        """Placements and fastenings of a goal, in an order that precedence allows."""
        steps = self.steps_of(self._accepted[goal])
        return in_order(steps, {step: self.missing_before(step, (), self._accepted[goal]) for step in steps})

    def steps_of(self, filled: Collection[str]) -> list[str]:
        """Placements into these slots, and the fastenings of what is placed there."""
        fastened = [name for name, fastening in self.fastenings.items() if any(slot in filled for slot in fastening.at)]
        return [*(slot for slot in self.positions if slot in filled), *fastened]

    def unfastened(self, filled: Collection[str], done: Collection[str]) -> list[str]:
        """Fastenings whose turn it is: what precedes them is done, and they are not.

        Args:
            filled: slots that get a part.
            done: filled slots and finished fastenings.
        """
        names = [name for name in self.steps_of(filled) if name in self.fastenings and name not in done]
        return [name for name in names if not self.missing_before(name, done, filled)]

    def as_listed(self, placed: Mapping[str, str]) -> tuple[str, ...]:
        """What stands in every slot, in their order; EMPTY where nothing does."""
        return tuple(placed.get(slot, EMPTY) for slot in self.positions)

    @cached_property
    def _accepted(self) -> dict[str, dict[str, tuple[str, ...]]]:
        return {
            goal: {slot: types_of(some) for slot, some in zip(self.positions, choices, strict=False) if types_of(some)}
            for goal, choices in self.goals.items()
        }

    @model_validator(mode="before")
    @classmethod
    def _shorthands(cls, value: Any, info: ValidationInfo) -> Any:
        """Goals by slot name become lists, brackets copies, and quantities that are left out what the goals take."""
        if not isinstance(value, dict):
            return value
        listed = with_wholes(with_listed_goals(value), PartType, info.context)
        folder = Path((info.context or {}).get("folder", "."))

        def read(other: Path) -> dict[str, Any]:
            if has_key(path := folder / other, "brackets"):
                raise Disagreement([(("brackets",), f"{path} has brackets itself")])
            return load_yaml(path, cls).model_dump()

        return with_quantities(with_brackets(listed, read)) if can_be_expanded(listed) else listed

    @model_validator(mode="after")
    def _goals_fit(self) -> Product:
        problems = self._misnamed()
        seen: dict[tuple[frozenset[str], ...], str] = {}
        for goal, choices in self.goals.items():
            if what := self._misfit(goal, choices):
                problems.append((("goals", goal), what))
            taken = tuple(frozenset(types_of(choice)) for choice in choices)
            twin = seen.setdefault(taken, goal)
            if twin != goal and self.goal_quantities.get(goal) == self.goal_quantities.get(twin):
                problems.append((("goals", goal), f"goal {goal} is the same configuration as {twin}"))
        for key in ("goal_titles", "goal_quantities"):
            unknown = sorted(set(getattr(self, key)) - set(self.goals))
            problems += [((key, goal), f"no goal {goal}; legal: {', '.join(self.goals)}") for goal in unknown]
        if self.brackets:
            what = "copies can be made of a bracket, goals and parts as files have them alone"
            problems.append((("brackets",), what))
        problems = problems or [*unfit_wholes(self)] or self._unused() or self._unordered() or self._unseated()
        if problems:
            raise Disagreement(problems)
        return self

    def _misfit(self, goal: str, choices: tuple[Choice, ...]) -> str | None:
        """Why a goal does not fit parts and positions, or None where it does."""
        if goal in RESERVED:
            return f"{goal!r} cannot be the name of a goal: the cell itself uses it"
        named = {part for choice in choices for part in types_of(choice)}
        if unknown := sorted((named | set(self.goal_quantities.get(goal, {}))) - set(self.parts)):
            return f"goal {goal} names unknown part types {unknown}; known: {sorted(self.parts)}, or {EMPTY}"
        if len(choices) != len(self.positions):
            return f"goal {goal} lists {len(choices)} parts for {len(self.positions)} positions"
        if not named:
            return f"goal {goal} leaves every slot empty"
        for slot, choice in zip(self.positions, choices, strict=True):
            if isinstance(choice, tuple) and len(set(choice)) != max(len(choice), 1):
                twice = choice and f"{max(choice, key=choice.count)} twice for {slot}"
                return f"goal {goal} lists {twice or f'nothing for {slot}; write {EMPTY}'}"
            if barred := [part for part in types_of(choice) if part not in self.accepts.get(slot, (part,))]:
                return f"goal {goal} puts {barred[0]} into {slot}, which accepts {', '.join(self.accepts[slot])}"
        limits = self.goal_quantities.get(goal, {})
        if completed(self._accepted[goal], limits, {}) is None:
            return f"goal {goal} has more slots than goal_quantities.{goal} has parts for"
        sure = Counter(part for choice in choices for part in types_of(choice) if len(types_of(choice)) == 1)
        if over := [part for part in sure if sure[part] > self.parts[part].quantity]:
            needed = ", ".join(f"{sure[name]} x {name}" for name in sorted(over))
            there = ", ".join(f"{self.parts[name].quantity} x {name}" for name in sorted(over))
            return f"goal {goal} needs {needed}, but the quantities are {there}"
        ready = {name: min(kind.quantity, limits.get(name, kind.quantity)) for name, kind in self.parts.items()}
        if completed(self._accepted[goal], ready, {}) is None:
            return f"goal {goal} has more slots than parts lie ready by their quantities"
        return None

    def _misnamed(self) -> list[tuple[Location, str]]:
        """Names that nobody could read, or that mean something else."""
        named: list[Location] = [("parts", part) for part in self.parts]
        named += [*(("bracket", "holes_m", slot) for slot in self.positions), *(("goals", goal) for goal in self.goals)]
        bad: list[tuple[Location, str]] = [
            (at, f"{name!r} is no name: it has letters, and none of {' '.join(PARTING)}")
            for at in named
            if (name := str(at[-1])) != name.strip() or not (name and name.isprintable()) or set(name) & set(PARTING)
        ]
        frame = "cannot be the name of a slot: poses are given in a frame of that name"
        bad += [(("bracket", "holes_m", slot), f"{slot!r} {frame}") for slot in self.positions if slot in FRAMES]
        titles = Counter(map(self.goal_title, self.goals))
        bad += [
            (("goal_titles", goal), f"{title!r} is said of another goal, too")
            for goal, title in self.goal_titles.items()
            if titles[title] > 1
        ]
        for slot, types in self.accepts.items():
            legal = f"part types: {', '.join(self.parts)}"
            bad += [(("accepts", slot), f"no part type {name}; {legal}") for name in types if name not in self.parts]
            bad += [(("accepts", slot), f"{slot} accepts nothing; {legal}")] * (not types)
        if EMPTY in self.parts:
            bad.append((("parts", EMPTY), f"{EMPTY!r} says that nothing goes into a slot; give the type another name"))
        return bad

    def _unseated(self) -> list[tuple[Location, str]]:
        """Parts that their holes do not carry, holes over the plate's edge, and holes that run into each other."""
        wide_m = 2 * self.hole_radius_m
        seated = {name for slot in self.through for name in self.types_at(slot)}
        through = f"falls through the holes, which are {1e3 * wide_m:.0f} mm wide for the pegs"
        wrong: list[tuple[Location, str]] = [
            (("parts", name, "size_m"), f"{name} {through}")
            for name, kind in self.parts.items()
            if name in seated and max(kind.size_m[:2]) < wide_m
        ]
        if self.bracket.margin_m <= self.hole_radius_m:
            what = f"holes of {1e3 * wide_m:.0f} mm reach over the plate's edge; legal: more than {wide_m / 2:.4g} m"
            wrong.append((("bracket", "margin_m"), what))
        for (slot, at), (other, there) in combinations(self.through.items(), 2):
            if (away_m := dist(at, there)) < wide_m:
                what = f"{other} runs into {slot}: between their middles are {1e3 * away_m:.0f} mm"
                wrong.append((("bracket", "holes_m", other), what))
        return wrong

    def _unused(self) -> list[tuple[Location, str]]:
        """Part types that no goal takes."""
        pieces = {piece for whole in self.wholes.values() for piece in whole.made_of}
        return [
            (("parts", name), f"no goal takes a part of type {name}; if none should, its quantity is 0")
            for name, kind in self.parts.items()
            if kind.quantity and not self.most[name] and name not in pieces
        ]

    def _unordered(self) -> list[tuple[Location, str]]:
        """Steps that nothing has the name of, and such as precede each other."""
        steps = {*self.positions, *self.fastenings}
        problems: list[tuple[Location, str]] = [
            (("fastenings", name), f"{name} is a slot; give the fastening another name")
            for name in self.fastenings
            if name in self.positions
        ]
        named: list[tuple[Location, str]] = [(("accepts", slot), slot) for slot in self.accepts]
        named += [(("carried_by", slot), name) for slot, below in self.carried_by.items() for name in (slot, below)]
        named += [
            (("fastenings", name, "at"), slot) for name, fastening in self.fastenings.items() for slot in fastening.at
        ]
        slots, listed = ", ".join(self.positions), ", ".join(sorted(steps))
        problems += [(at, f"no slot {slot}; slots: {slots}") for at, slot in named if slot not in self.positions]
        for number, pair in enumerate(self.before):
            problems += [(("before", number), f"no step {step}; steps: {listed}") for step in pair if step not in steps]
        if not problems:
            try:
                in_order(sorted(steps), self.predecessors)
            except ValueError as error:
                key = "before" if self.before else "carried_by"
                problems.append(((key,), f"no step can be the first of these: {error}"))
        return problems or [
            (("carried_by", slot), what) for slot in self.carried_by if (what := self._unsupported(slot))
        ]

    def _unsupported(self, slot: str) -> str:
        """Why the parts below a slot cannot carry it; empty where they can."""
        below = self.carried_by[slot]
        heights = sorted({self.parts[part].size_m[2] for part in self.types_at(below)})
        if bare := [goal for goal in self.goals if slot in self._accepted[goal] and below not in self._accepted[goal]]:
            return f"goal {bare[0]} fills {slot}, but leaves {below} below it empty"
        if len(heights) > 1:
            ends = ", ".join(f"{height:g}" for height in heights)
            return f"the parts at {below} end at {ends} m: they must be equally high"
        if both := sorted(self.types_at(slot) & self.types_at(below)):
            return f"{both[0]} may stand at {slot} and at {below}: the camera above could not tell which it is"
        return ""
