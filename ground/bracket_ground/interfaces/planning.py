"""Questions to planners and their answers: graph in, belief and plans out (one interface for all planners)."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.product import Product

Placement = tuple[str, str]  # (part type, position), for example ("o1", "p3")

UNKNOWN_GOAL = "none of these"
FOLLOWS_ORDER = 0.95  # share of brackets that are what the work order says
TAKEN_IN_ERROR = 0.01  # share of the parts that people take out again though they belong there


def weights_file(planner: str, kind: str) -> str:
    """Name of the shipped file of weights of a kind of planner or detector."""
    return f"{planner}_{'factored' if kind == 'auto' else kind}.onnx"


def crops_file(weights: Path) -> Path:
    """Where the network of the crops is kept: beside the weights of the grasp planner that it was trained with."""
    return weights.with_name(f"{weights.stem}_crops.onnx")


@dataclass(frozen=True)
class AssemblyState:
    """Edges (object, position) of the assembly graph; each position holds at most one part.

    Attributes:
        placed: part type by position, filled positions only.
        told_goal: what the person said when asked: a goal's name, or UNKNOWN_GOAL; None where nothing was said.
        doubts: by position, how probable each part type is there by the action that filled it; of positions whose hole
            has not shown its part yet.
        kept: part type by position, of what looks wrong and stays as it is: it is not asked about again.
        known_wrong: of these, what nobody said is right.
        told_parts: part type by position, where a person said that it goes, of a product that nobody knows.
        by_robot: part type by position, of what the robot placed.
        taken_out: of that, what a person took out again: it does not belong there.
        against_told: of that, what was taken out since the goal was told, and so speaks against it.
        replaced: of what people placed and the holes showed, what they took out again; another part may stand there.
        denied: goals that a person said it is not.
        fastened: names of the fastenings that are done.
    """

    placed: Mapping[str, str]
    told_goal: str | None = None
    doubts: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    kept: Mapping[str, str | None] = field(default_factory=dict)
    known_wrong: Mapping[str, str | None] = field(default_factory=dict)
    told_parts: Mapping[str, str] = field(default_factory=dict)
    by_robot: Mapping[str, str] = field(default_factory=dict)
    taken_out: Mapping[str, str] = field(default_factory=dict)
    against_told: Mapping[str, str] = field(default_factory=dict)
    replaced: Mapping[str, str] = field(default_factory=dict)
    denied: tuple[str, ...] = ()
    fastened: tuple[str, ...] = ()

    def seen(self, placed: Mapping[str, str], unread: Collection[str] = ()) -> AssemblyState:
        """The state where the holes show this, part type by position; notices what was taken out.

        Args:
            unread: positions whose holes never showed what the state has there.
        """
        own = {at: part for at, part in self.placed.items() if at not in {*self.by_robot, *unread}}
        replaced = {at: part for at, part in {**own, **self.replaced}.items() if placed.get(at) != part}
        gone = {at: part for at, part in self.by_robot.items() if at in self.placed and placed.get(at) != part}
        by_robot = {at: part for at, part in self.by_robot.items() if at not in gone}
        taken_out = {at: part for at, part in {**self.taken_out, **gone}.items() if placed.get(at) != part}
        since = {
            at: part for at, part in taken_out.items() if at in self.against_told or (self.told_goal and at in gone)
        }
        now = replace(self, placed=placed, by_robot=by_robot, replaced=replaced)
        return replace(now, taken_out=taken_out, against_told=since)

    def with_goal(self, goal: str) -> AssemblyState:
        """The state after a person said which goal it is; what was taken out before no longer counts."""
        return replace(self, told_goal=goal, against_told={}, replaced={}, denied=())

    def without(self, goal: str) -> AssemblyState:
        """The state after a person said that it is not this goal."""
        return replace(self, told_goal=self.told_goal if self.told_goal != goal else None, denied=(*self.denied, goal))

    @property
    def by_people(self) -> AssemblyState:
        """The state without what the robot placed."""
        return replace(self, placed={at: part for at, part in self.placed.items() if at not in self.by_robot})

    @property
    def confirmed(self) -> Mapping[str, str]:
        """Part type by position, of what a person said is right as it is."""
        return {at: part for at, part in self.kept.items() if part is not None and at not in self.known_wrong}

    def with_placement(self, part: str, position: str, shares: Mapping[str, float] | None = None) -> AssemblyState:
        """The state after one more part; what is put back where it was taken out belongs there.

        Args:
            shares: how probable each type is, where that is not sure.
        """
        doubts, placed = {**self.doubts, position: shares} if shares else self.doubts, {**self.placed, position: part}
        taken_out, against_told, replaced = (
            {at: kind for at, kind in gone.items() if placed.get(at) != kind}
            for gone in (self.taken_out, self.against_told, self.replaced)
        )
        now = replace(self, placed=placed, doubts=doubts, taken_out=taken_out)
        return replace(now, against_told=against_told, replaced=replaced)


@dataclass(frozen=True)
class AssemblyPlan:
    """Answer of a semantic planner, about all objects at once.

    Attributes:
        goal_belief: probability by goal name, and of UNKNOWN_GOAL where the planner gives one; sums to 1.
        next_belief: probability that a part is the right one for a position that is open; sums to at most the number
            of positions that are seen to be open. Whether one of them is filled after all is for the guard to see.
        next_part: the type to fetch next, None where nothing remains.
        guidance: by part type, the plan decoded for it: the positions where it is still to be put, in order;
            of the next type that is `[o, p...]` of Alg. 1.
        inference: how the belief was found: "exact", or what of it is approximate; empty where the planner cannot tell.
    """

    goal_belief: Mapping[str, float]
    next_belief: Mapping[Placement, float]
    next_part: str | None
    guidance: Mapping[str, tuple[str, ...]]
    inference: str = ""

    @property
    def goal(self) -> str:
        """The most probable goal."""
        return max(self.goal_belief, key=lambda name: self.goal_belief[name])

    def shared(self, least: float, positions: Sequence[str]) -> tuple[dict[str, tuple[str, ...]], tuple[str, ...]]:
        """What of the guidance is the same in all likely goals, and the positions where they differ.

        Args:
            least: probability from which a part belongs at a position whichever of them it is.
            positions: all, in order.

        Returns:
            Positions by part type, without the types of which all positions are open; and the open positions.
        """
        sure = {
            part: tuple(at for at in to if self.next_belief.get((part, at), 0.0) >= least)
            for part, to in self.guidance.items()
        }
        wanted = {part for (part, _), share in self.next_belief.items() if share > 1.0 - least}
        undecided = {at for to in self.guidance.values() for at in to}.difference(*sure.values())
        said = {part: to for part, to in sure.items() if to or not (self.guidance[part] or part in wanted)}
        return said, tuple(at for at in positions if at in undecided)

    def with_told(self, parts: Mapping[str, str]) -> AssemblyPlan:
        """The plan where a person said what goes into some open positions.

        Args:
            told: part type by position.
        """
        if not parts:
            return self
        sure = {(part, position): 1.0 for position, part in parts.items()}
        others = {edge: share for edge, share in self.next_belief.items() if edge[1] not in parts}
        first = {part: tuple(at for at in parts if parts[at] == part) for part in (*self.guidance, *parts.values())}
        rest = {part: tuple(at for at in to if at not in parts) for part, to in self.guidance.items()}
        guidance = {part: (*first[part], *rest.get(part, ())) for part in first}
        return replace(self, next_belief={**others, **sure}, next_part=next(iter(parts.values())), guidance=guidance)

    def expecting(self, variant: str, product: Product, state: AssemblyState) -> AssemblyPlan:
        """The plan where a work order says what to expect: by Bayes' rule, so that what is placed still decides.

        Args:
            variant: name of the goal that was ordered.
        """
        if variant not in product.goals:
            return self
        rare = (1.0 - FOLLOWS_ORDER) / max(len(self.goal_belief) - 1, 1)
        shares = {goal: FOLLOWS_ORDER if goal == variant else rare for goal in self.goal_belief}
        return self._given(shares, product, state)

    def after_reactions(self, product: Product, state: AssemblyState) -> AssemblyPlan:
        """The plan where a person took out again what the robot placed, or said that it is not a goal.

        That is evidence against goals, by Bayes' rule.
        """
        against = {
            goal
            for goal in product.goals
            if goal in state.denied
            or any(product.accepted(goal).get(at) == (part,) for at, part in state.taken_out.items())
        }
        shares = {goal: TAKEN_IN_ERROR if goal in against else 1.0 for goal in self.goal_belief}
        return self._given(shares, product, state) if against else self

    def left_in(self, product: Product, state: AssemblyState, share: float) -> AssemblyPlan:
        """The plan for a state, made from what people placed alone: what the robot placed is filled, and little known.

        A part that is right there stays; of wrong ones people leave a share in. By Bayes' rule that is how much the
        robot's own parts say of a goal; at share 1 nothing, as they are there because the goal was believed in.

        Args:
            state: with the robot's own parts.
            share: of its wrong parts, how many people leave where they are; more than 0.
        """
        right = {
            goal: [part in product.accepted(goal).get(at, ()) for at, part in state.by_robot.items()]
            for goal in product.goals
        }
        shares = {goal: share ** fits.count(False) for goal, fits in right.items()}
        none = self.goal_belief.get(UNKNOWN_GOAL, 0.0)
        by_chance = 1.0
        for number, (at, part) in enumerate(state.by_robot.items()):
            known = sum(self.goal_belief.get(goal, 0.0) for goal in product.goals if right[goal][number])
            chance = min(max(self.next_belief.get((part, at), 0.0) - known, 0.0) / none, 1.0) if none else 0.0
            by_chance *= chance + (1.0 - chance) * share
        weighed = {goal: shares.get(goal, by_chance) for goal in self.goal_belief}
        plan = self._given(weighed, product, state) if share < 1.0 else self
        nexts = {edge: belief for edge, belief in plan.next_belief.items() if edge[1] not in state.placed}
        guidance = {part: tuple(at for at in to if at not in state.placed) for part, to in plan.guidance.items()}
        most = max(guidance, key=lambda part: len(guidance[part]), default=None)
        following = plan.next_part if guidance.get(plan.next_part or "") else most if any(guidance.values()) else None
        return replace(plan, next_belief=nexts, guidance=guidance, next_part=following)

    def _given(self, shares: Mapping[str, float], product: Product, state: AssemblyState) -> AssemblyPlan:
        """The plan after evidence that has these likelihoods, by goal."""
        joint = {goal: p * shares[goal] for goal, p in self.goal_belief.items()}
        total = sum(joint.values())
        if state.told_goal is not None or total <= 0.0:
            return self
        belief = {goal: share / total for goal, share in joint.items()}
        wanted = [goal for goal in product.goals if goal in belief]
        nexts = self._next_belief(belief, wanted, product, state)
        likeliest = max(belief, key=lambda goal: belief[goal])
        if likeliest == self.goal or likeliest not in wanted:
            return replace(self, goal_belief=belief, next_belief=nexts)
        guidance = product.places(likeliest, state.placed)
        most = max(guidance, key=lambda part: len(guidance[part])) if any(guidance.values()) else None
        return replace(self, goal_belief=belief, next_belief=nexts, next_part=most, guidance=guidance)

    def _next_belief(
        self, belief: Mapping[str, float], wanted: Collection[str], product: Product, state: AssemblyState
    ) -> dict[Placement, float]:
        """Probability of every placement that is still open, from that of the goals, `wanted` those of the product."""
        accepted = {goal: product.accepted(goal) for goal in wanted}
        known, before = (sum(shares[goal] for goal in wanted) for shares in (belief, self.goal_belief))
        rest = (1.0 - known) / (1.0 - before) if before < 1.0 - 1e-9 else 0.0  # of what is no goal of the product
        nexts: dict[Placement, float] = {}
        for position in product.positions:
            for part in product.parts if position not in state.placed else ():
                of = [goal for goal in wanted if part in accepted[goal].get(position, ())]
                other = self.next_belief.get((part, position), 0.0) - sum(self.goal_belief[goal] for goal in of)
                nexts[part, position] = min(1.0, sum(belief[goal] for goal in of) + rest * max(other, 0.0))
        return nexts


class SemanticPlanner(Protocol):
    """Infers the goal and what remains to be done (section 3.1)."""

    def plan(self, state: AssemblyState) -> AssemblyPlan:
        """Belief, next object and a plan for every object, in well under 1 ms."""
        ...


@dataclass(frozen=True)
class GraspPlan:
    """Answer of a grasp planner for one required object.

    Attributes:
        graspable: probability that the required object can be grasped as it stands.
        blockers: indices of the detections to move away first, in order; empty where graspable or help is needed.
        needs_help: no sequence of moves frees the object.
        text: the decoded solution as the paper words it: "grasp", "move b", "move b and c", "help".
    """

    graspable: float
    blockers: tuple[int, ...]
    needs_help: bool
    text: str


class GraspPlanner(Protocol):
    """Judges graspability in clutter and names what blocks (section 3.2)."""

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:
        """A plan for `parts[required]`, in well under 1 ms an object."""
        ...
