"""Helping with what is listed against building what is not as if it were: the curve, counted exactly.

python -m tests.benchmarks.decision_curve --goals 3 --prior 0.02 0.1 --wrong 300 600 1000 --placement 8 3 --left-in 0 1
The valve bracket's parts; every arrangement, and every order of the person; what is reported is true. Person and robot
take turns: after each part of the person the robot places that part of which the guard is surest, if it lets it pass.
A part that is wrong is taken out, and the robot places nothing more. Nobody answers; then somebody answers the first
question.
bound: what no rule can better that knows the listed goals, and that all others are alike: it has the greatest
parts - price x wrong, by backward induction over states of the bracket, for a series of prices.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import permutations
from itertools import product as every

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.learned.semantic.goals import OpenGoals
from bracket_cell.learned.semantic.model import BayesPlanner
from bracket_cell.learned.semantic.settings import NewGoals
from bracket_cell.trees.guard import Guard, GuardSettings
from bracket_ground.interfaces.perception import HoleView
from bracket_ground.interfaces.planning import AssemblyState, Placement
from bracket_ground.interfaces.product import Product
from tests.benchmarks.decisions import with_goals

PRICES = (0.0, 1.0, 2.0, 3.0, 5.0, 20.0)  # of a bracket with a wrong part, in parts that the robot might have placed
ASK = "ask"
OWN = "*"  # after a part that the robot placed
Bracket = tuple[str, ...]  # part type by position, empty where nothing is
Choice = Placement | str | None  # a placement, ASK, or nothing
Rule = Callable[[Bracket], Choice]


@dataclass(frozen=True)
class Tally:
    """Means over brackets.

    Attributes:
        parts: that the robot placed, of listed products.
        unlisted, listed: share of the brackets of these with a wrong part.
        asked: share of the brackets of listed products with a question.
        begins: parts of the person before the robot does anything, of listed products.
    """

    parts: float = 0.0
    unlisted: float = 0.0
    listed: float = 0.0
    asked: float = 0.0
    begins: float = 0.0

    def plus(self, other: Tally, times: float = 1.0) -> Tally:
        """The sum, the other one so many times."""
        return Tally(*(value + times * two for value, two in zip(_values(self), _values(other), strict=True)))


class Turns:
    """Brackets in turns of person and robot."""

    def __init__(self, product: Product) -> None:
        self.product, self.size = product, len(product.positions)
        bag = [name for name, part in product.parts.items() for _ in range(part.quantity)]
        self._every = sorted(set(permutations(bag)))
        self._known = set(product.goals.values())
        self.possible = lru_cache(maxsize=None)(self._possible)

    def _possible(self, bracket: Bracket) -> tuple[float, float]:
        """Share of the listed, and of the other arrangements, that have these parts."""
        bracket = tuple(part.removesuffix(OWN) for part in bracket)
        fit = [one for one in self._every if all(a in ("", b) for a, b in zip(bracket, one, strict=True))]
        listed = sum(one in self._known for one in fit)
        return listed / len(self._known), (len(fit) - listed) / max(len(self._every) - len(self._known), 1)

    def after(self, bracket: Bracket) -> Iterator[tuple[Placement, Bracket]]:
        """Every placement that some arrangement has, and the bracket after it."""
        for at, position in enumerate(self.product.positions):
            for part in self.product.parts if not bracket[at] else ():
                then = (*bracket[:at], part, *bracket[at + 1 :])
                if any(self.possible(then)):
                    yield (part, position), then

    def played(self, rule: Rule) -> Tally:
        """What a rule leads to."""
        return self._person(lambda bracket, then, waits: self._chosen(bracket, rule(bracket), then, waits))

    def bound(self, price: float) -> Tally:
        """What the best rule leads to."""

        def best(bracket: Bracket, then: Callable[[Bracket], Tally], waits: Tally) -> Tally:
            choices: list[Choice] = [None, *(placement for placement, _ in self.after(bracket))]
            found = (self._chosen(bracket, choice, then, waits) for choice in choices)
            return max(found, key=lambda tally: tally.parts - price * (tally.unlisted + tally.listed))

        return self._person(best)

    def _person(self, robot: Callable[[Bracket, Callable[[Bracket], Tally], Tally], Tally]) -> Tally:
        @cache
        def person(bracket: Bracket) -> Tally:
            total = Tally()
            for _, then in self.after(bracket):
                total = total.plus(turn(then), 1 / bracket.count(""))
            return total

        @cache
        def turn(bracket: Bracket) -> Tally:
            return robot(bracket, person, person(bracket)) if "" in bracket else Tally()

        return person(("",) * self.size)

    def _chosen(self, bracket: Bracket, choice: Choice, then: Callable[[Bracket], Tally], waits: Tally) -> Tally:
        if choice is None:
            return waits
        listed, unlisted = self.possible(bracket)
        if isinstance(choice, str):  # a question
            return Tally(listed * ((bracket.count("") + 1) // 2), asked=listed)
        right, right_too = self.possible(after := self._with(bracket, choice))
        return Tally(right, unlisted - right_too, listed - right).plus(then(after))

    def _with(self, bracket: Bracket, placement: Placement) -> Bracket:
        """The bracket after the robot's placement, whether right or not."""
        at = self.product.positions.index(placement[1])
        return (*bracket[:at], placement[0] + OWN, *bracket[at + 1 :])


def guarded(product: Product, prior: float, settings: GuardSettings, *, answers: bool) -> Rule:
    """What planner and guard choose."""
    planner = BayesPlanner(product, OpenGoals.of(product, NewGoals(none_probability=prior)))
    guard = Guard(product, settings)

    @cache
    def choice(bracket: Bracket) -> Choice:
        placed = {at: part.removesuffix(OWN) for at, part in zip(product.positions, bracket, strict=True) if part}
        holes = {at: HoleView(placed.get(at), 1.0, 0.0) for at in product.positions}
        own = {at: placed[at] for at, part in zip(product.positions, bracket, strict=True) if part.endswith(OWN)}
        state = AssemblyState(placed, by_robot=own)
        plan = guard.planned(planner, state)
        if answers and guard.asks_for_goal(plan, state):
            return ASK
        passed = (
            (belief, placement)
            for placement, belief in plan.next_belief.items()
            if guard.judge(plan, state, holes, *placement, reachable=True, may_ask=answers).decision == "act"
        )
        return max(passed, default=(0.0, None))[1]

    return choice


def begins(turns: Turns, rule: Rule) -> float:
    """Parts of the person before the robot does anything, of listed products."""

    @cache
    def more(bracket: Bracket, goal: Bracket) -> float:
        open_at = [at for at in range(turns.size) if not bracket[at]]
        total = 0.0
        for at in open_at:
            then = (*bracket[:at], goal[at], *bracket[at + 1 :])
            total += 1.0 + (more(then, goal) if "" in then and rule(then) is None else 0.0)
        return total / len(open_at)

    goals = list(turns.product.goals.values())
    return sum(more(("",) * turns.size, goal) for goal in goals) / len(goals)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--goals", type=int, default=3)
    parser.add_argument("--prior", type=float, nargs="+", default=[0.02, 0.1], help="new_goals.none_probability")
    parser.add_argument("--wrong", type=float, nargs="+", default=[300.0, 600.0, 1000.0], help="guard.wrong_act_s")
    parser.add_argument("--placement", type=float, nargs="+", default=[8.0], help="guard.placement_s")
    parser.add_argument("--left-in", type=float, nargs="+", default=[0.0], help="guard.left_in_share")
    parser.add_argument("--answers", type=int, nargs="+", default=[0, 1], choices=(0, 1), help="whether somebody does")
    options = parser.parse_args()
    turns = Turns(with_goals(load_product(load_configuration()), options.goals))
    print(" " * 33 + "| robot's parts | wrong: unlisted | listed | asked | begins after")
    for price in PRICES:
        print(told(f"bound, price {price:g}", turns.bound(price)), flush=True)
    for prior, wrong_s, look_s, share in every(options.prior, options.wrong, options.placement, options.left_in):
        settings = GuardSettings(wrong_act_s=wrong_s, placement_s=look_s, left_in_share=share)
        for answers in options.answers:
            rule = guarded(turns.product, prior, settings, answers=bool(answers))
            found = turns.played(rule).plus(Tally(begins=begins(turns, rule)))
            name = f"{prior:g}, {wrong_s:g} s, {look_s:g} s, {share:g}, {'answers' if answers else 'nobody'}"
            print(told(name, found), flush=True)


def told(name: str, found: Tally) -> str:
    """A line of the table."""
    return f"{name:32} | " + " | ".join(f"{value:.3f}" for value in _values(found))


def _values(tally: Tally) -> tuple[float, ...]:
    return tally.parts, tally.unlisted, tally.listed, tally.asked, tally.begins


if __name__ == "__main__":
    main()
