"""Sections on what planners believe: noise, calibration and acting, unknown goals, habits."""

from __future__ import annotations

from learned.experiments import Cells, markdown, score_of, shown, values_of
from learned.semantic.experiments.belief import ERRORS, OPTIMUM
from learned.semantic.experiments.habits import DEMONSTRATIONS, SEEDS, STRENGTHS
from learned.semantic.experiments.models import KINDS
from learned.semantic.scenarios import DETECTION_ERROR

ACTIONS = range(1, 6)
ALL = (OPTIMUM, *KINDS)


def noise_section(cells: Cells) -> str:
    """Fig. 13 as a table."""
    rows = []
    for error in ERRORS:
        for kind in ALL:
            picks = [score_of(f"goal_accuracy_{k}", f"runs_{error}") for k in ACTIONS]
            rows.append([f"{100 * error:g} %", kind, *(shown(values_of(cells, pick, kind=kind)) for pick in picks)])
    return (
        "## Goal accuracy under misdetections (Fig. 13)\n"
        "After 1 to 5 actions of an assembly in random order; each action is, with the given probability, taken for "
        "another one at a position that is still open. Expected values by enumeration of all that can be seen, no "
        "sample. Trained on 143 of 186 scenarios. `optimum` names the most probable goal under the exact posterior: "
        "no planner is better. The planners know of 4.5 %, whatever happens. The paper's detector errs in 4.5 % of "
        "the actions with 3 goals.\n\n" + markdown(["misdetected", "", *map(str, ACTIONS)], rows)
    )


def acting_section(cells: Cells) -> str:
    """Calibration, and wrong placements against coverage."""
    parts = [
        "## Calibration, and acting only where it is sure enough\n"
        "`NLL`: of the true goal [nat]; `ECE`: calibration error of the best goal, and of the best next placement. "
        "Acting at threshold .9 of the posterior of the next (type, position): in what share of states a placement "
        "reaches it (coverage), and how often it is the wrong type for its position, with 4.5 % misdetections. The "
        "last column is the largest coverage at which at most .3 % are wrong, at any threshold.\n"
        "The aim is at most .3 % wrong at 94 % coverage or more. The row `optimum` acts on the exact posterior, found "
        "by enumeration, and is the best trade-off that exists. A third of the clean one-action states fit two goals, "
        "so that after 1 to 5 actions 93.3 % is the most that anybody covers. From the reports alone no planner "
        "reaches the aim: a misdetected action leaves its own hole open in the graph. In the cell a camera sees which "
        "holes are filled, and `ReconcileGraph` takes back what is reported of an open one: the last two tables count "
        "that, without the type of part that the camera could read in a hole as well."
    ]
    for name, title in (
        ("uniform", "All scenarios alike, reports alone"),
        (f"runs_{DETECTION_ERROR}", "After 1 to 5 actions in random order, each number alike, reports alone"),
        ("uniform_seen", "All scenarios alike, filled holes seen"),
        ("runs_seen", "After 1 to 5 actions, filled holes seen"),
    ):
        columns = [("goal_nll", 3), ("goal_calibration_error", 3), ("next_calibration_error", 3), ("wrong_always", 4)]
        columns += [("coverage_at_act", 3), ("wrong_at_act", 4), ("best_coverage", 3)]
        rows = [
            [kind, *(shown(values_of(cells, score_of(column, name), kind=kind), digits) for column, digits in columns)]
            for kind in ALL
        ]
        head = ["", "NLL", "ECE goal", "ECE next", "wrong if always acting", "coverage at .9", "wrong at .9"]
        parts.append(f"{title}:\n\n" + markdown([*head, "best coverage at .3 %"], rows))
    return "\n\n".join(parts)


def unknown_section(cells: Cells) -> str:
    """Area under the ROC curve by number of actions."""
    rows = []
    for kind in KINDS:
        picks = [score_of(f"unknown_goal_auc_{k}", "unknown_goals") for k in ACTIONS]
        rows.append([kind, *(shown(values_of(cells, pick, kind=kind)) for pick in picks)])
    return (
        "## Goals that were never demonstrated\n"
        'Area under the ROC curve of "none of these" (`paper` has no such answer: doubt in its best goal), 1000 '
        "assemblies of known goals and 1000 of other arrangements of the same parts, after 1 to 5 actions, 4.5 % "
        "misdetections.\n\n" + markdown(["", *map(str, ACTIONS)], rows)
    )


def habit_section(cells: Cells) -> str:
    """What learning habits gains."""
    rows = []
    columns = [("goal_accuracy_1", 3), ("goal_accuracy", 3), ("goal_nll", 3), ("wrong_always", 4)]
    columns += [("coverage_at_act", 3), ("wrong_at_act", 4), ("best_coverage", 3)]
    for strength in STRENGTHS:
        for kind in ALL:
            wanted = {"kind": kind, "strength": strength}
            if values_of(cells, lambda _: 0.0, **wanted):
                found = [shown(values_of(cells, score_of(name), **wanted), digits) for name, digits in columns]
                rows.append([f"{strength:g}", kind, *found])
    head = ["strength", "", "goal after 1 action", "after 1 to 5", "NLL", "wrong if always acting", "coverage at .9"]
    return (
        "## Demonstrators with habits of order\n"
        "Four demonstrators prefer positions, types, and for each goal certain slots first; strength is the standard "
        f"deviation of their log-preferences. {DEMONSTRATIONS} demonstrations, then their own assemblies with 4.5 % "
        "misdetections, expected values by enumeration. `optimum` knows the habits exactly. Intervals are wide because "
        f"demonstrators differ between seeds ({SEEDS[0]} to {SEEDS[-1]}); planners share them.\n\n"
        + markdown([*head, "wrong at .9", "best coverage at .3 %"], rows)
        + "\n\n"
        + _gain(cells)
    )


def _gain(cells: Cells) -> str:
    """Paired differences to `bayes` on the same demonstrators."""
    rows = []
    for strength in STRENGTHS:
        row = [f"{strength:g}"]
        for name in ("goal_accuracy_1", "goal_accuracy", "wrong_always", "best_coverage"):
            ours = values_of(cells, score_of(name), kind="factored", strength=strength)
            base = values_of(cells, score_of(name), kind="bayes", strength=strength)
            row.append(shown([a - b for a, b in zip(ours, base, strict=True)], 4))
        rows.append(row)
    head = ["strength", "goal after 1 action", "after 1 to 5", "wrong if always acting", "best coverage at .3 %"]
    return "`factored` less `bayes`, paired by seed:\n\n" + markdown(head, rows)
