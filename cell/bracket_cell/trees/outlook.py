"""What acting, asking and waiting are expected to cost, in seconds, from a belief over goals.

A placement that is right with probability q costs (1 - q) W, W being the cost of a wrong act; a question costs Q and
is answered; to wait costs time, T for each placement of the person, and then the least of what is left:

    wait = min(min_k  k T + E[min((1 - q_k) W, Q)],  h T) + u Q

q_k being the best placement after k more, over what the person may place next and in which order; h every other of the
open positions, as the robot that never acts places no more than these too few; u the probability of none of the listed
goals, which ends in a question. That is the expected value of sample information (Raiffa and Schlaifer, 1961), for
plans that wait and then decide; the mean is over drawn continuations, the same for the same belief. Nothing but a
probability by listed goal, and of none of them, is asked of a planner.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, AssemblyState
from bracket_ground.interfaces.product import Product

LIKELY = 1e-4  # goals below this change no cost by a second
FARTHEST = 4  # placements that are looked ahead
DRAWN = 48  # continuations: costs are good to half a second, and take about 1 ms

Floats = npt.NDArray[np.float64]
Looks = tuple[tuple[int, float], ...]  # placements by the person that are waited for, and the cost [s] after them


@dataclass(frozen=True)
class Outlook:
    """Expected costs [s].

    Attributes:
        act_s: of the best placement that is possible now; infinite where there is none.
        wait_s: of further looks, and of the best that can be done after them.
        ask_s: of a question; infinite where nobody answers.
        after_one_s: of the best that can be done after one more placement by the person, without the wait for it.
    """

    act_s: float
    wait_s: float
    ask_s: float
    after_one_s: float


def waiting_s(looks: Looks, placement_s: float, waited_s: float = 0.0) -> float:
    """Expected cost [s] of waiting.

    Args:
        looks: see `after_looks`.
        placement_s: to wait for one placement by the person.
        waited_s: since a part was placed last; who has waited long will wait longer.
    """
    look_s = max(placement_s, waited_s / 2)
    return min(number * look_s + cost_s for number, cost_s in looks)


def after_looks(product: Product, plan: AssemblyPlan, state: AssemblyState, wrong_s: float, most_s: float) -> Looks:
    """Expected cost of the best that can be done after one more placement by the person, after two and so on.

    The last is to wait to the end, at the price of the parts that the robot might have placed.

    Args:
        wrong_s: cost of a wrong act.
        most_s: of what can be done in the place of acting.
    """
    open_at = [at for at in product.positions if at not in state.placed]
    likely = [goal for goal in product.goals if plan.goal_belief.get(goal, 0.0) > LIKELY]
    unknown = plan.goal_belief.get(UNKNOWN_GOAL, 0.0)
    to_the_end = (len(open_at) + 1) // 2, unknown * most_s
    looks = min(FARTHEST, len(open_at) - 1)
    if looks < 1:  # the next one ends the bracket, and what the robot holds goes back
        return ((2, 0.0),)
    if not likely:
        return (1, most_s), to_the_end
    belief = np.array([plan.goal_belief[goal] for goal in likely])
    wanted = _wanted(product, likely, state, open_at)
    rng = np.random.default_rng(len(open_at))
    reached = np.cumsum(belief)
    truth = np.searchsorted(reached, (np.arange(DRAWN) + 0.5) / DRAWN * reached[-1])
    orders = rng.permuted(np.tile(np.arange(len(open_at)), (DRAWN, 1)), axis=1)
    fits: Floats = np.ones((DRAWN, len(likely)))
    by_chance, rest = np.ones(DRAWN), np.tile(_rest(product, state), (DRAWN, 1))
    shut = np.zeros((DRAWN, len(open_at)), dtype=bool)
    rows, left_s = np.arange(DRAWN), [to_the_end]
    for look in range(looks):
        at = orders[:, look]
        part = wanted[truth, at]
        fits *= part[:, None] == wanted[:, at].T
        by_chance *= rest[rows, part] / np.maximum(rest.sum(axis=1), 1.0)
        rest[rows, part] = np.maximum(rest[rows, part] - 1.0, 0.0)
        shut[rows, at] = True
        sure = _best(fits * belief, wanted, shut, len(product.parts) + 1)
        risk_s = wrong_s * (1.0 - sure / (fits @ belief + unknown * by_chance))
        after_s = (1.0 - unknown) * np.minimum(risk_s, most_s).mean() + unknown * most_s
        left_s.append((look + 1, float(after_s)))
    return tuple(left_s)


def _best(weights: Floats, wanted: npt.NDArray[np.int_], shut: npt.NDArray[np.bool_], kinds: int) -> Floats:
    """(s,) greatest weight of the goals (s, z) that agree on an open position, all goals (z, m) counted together."""
    best: Floats = np.zeros(len(weights))
    for kind in range(kinds - 1):  # the last kind is an empty position: nothing is placed there
        agree = np.where(shut, 0.0, weights @ (wanted == kind))
        best = np.maximum(best, agree.max(axis=1))
    return best


def _wanted(product: Product, goals: list[str], state: AssemblyState, open_at: list[str]) -> npt.NDArray[np.int_]:
    """(z, m) number of the part type that each goal wants at each open position; one more than there are for none."""
    number = {part: index for index, part in enumerate(product.parts)}
    rows = [product.goal_placements(goal, state.placed) for goal in goals]
    return np.array([[number.get(row.get(at, ""), len(number)) for at in open_at] for row in rows])


def _rest(product: Product, state: AssemblyState) -> Floats:
    """(n + 1,) how many of each type remain to be placed; the last, of empty positions, is none."""
    used = Counter(state.placed.values())
    return np.array([*(max(product.most[name] - used[name], 0) for name in product.parts), 0], dtype=float)
