"""The page of the experiments on semantic planners."""

from __future__ import annotations

from bracket_cell.learned.semantic.confusions import PATTERNS
from bracket_cell.learned.semantic.settings import DETECTION_ERROR
from bracket_lab.experiments import semantic_ratio_page
from bracket_lab.experiments.experiments import Cells, Experiment, markdown, score_of, shown, shown_share, values_of
from bracket_lab.experiments.semantic_cells import (
    ERRORS,
    HABIT_DEMONSTRATIONS,
    HABIT_SEEDS,
    HABIT_STRENGTHS,
    OPTIMUM,
    belief_cells,
    habit_cells,
    ratio_cells,
    settings_cells,
    size_cells,
)
from bracket_lab.experiments.semantic_models import KINDS
from bracket_lab.experiments.semantic_streams import BRACKETS, ERROR, IN_USE, SEEDS, SINGLE, stream_cells

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
    for strength in HABIT_STRENGTHS:
        for kind in ALL:
            wanted = {"kind": kind, "strength": strength}
            if values_of(cells, lambda _: 0.0, **wanted):
                found = [shown(values_of(cells, score_of(name), **wanted), digits) for name, digits in columns]
                rows.append([f"{strength:g}", kind, *found])
    head = ["strength", "", "goal after 1 action", "after 1 to 5", "NLL", "wrong if always acting", "coverage at .9"]
    return (
        "## Demonstrators with habits of order\n"
        "Four demonstrators prefer positions, types, and for each goal certain slots first; strength is the standard "
        f"deviation of their log-preferences. {HABIT_DEMONSTRATIONS} demonstrations, then their own assemblies with "
        "4.5 % misdetections, expected values by enumeration. `optimum` knows the habits exactly. Intervals are wide "
        f"because demonstrators differ between seeds ({HABIT_SEEDS[0]} to {HABIT_SEEDS[-1]}); planners share "
        "them.\n\n" + markdown([*head, "wrong at .9", "best coverage at .3 %"], rows) + "\n\n" + _gain(cells)
    )


def _gain(cells: Cells) -> str:
    """Paired differences to `bayes` on the same demonstrators."""
    rows = []
    for strength in HABIT_STRENGTHS:
        row = [f"{strength:g}"]
        for name in ("goal_accuracy_1", "goal_accuracy", "wrong_always", "best_coverage"):
            ours = values_of(cells, score_of(name), kind="factored", strength=strength)
            base = values_of(cells, score_of(name), kind="bayes", strength=strength)
            row.append(shown([a - b for a, b in zip(ours, base, strict=True)], 4))
        rows.append(row)
    head = ["strength", "goal after 1 action", "after 1 to 5", "wrong if always acting", "best coverage at .3 %"]
    return "`factored` less `bayes`, paired by seed:\n\n" + markdown(head, rows)


STREAM_KINDS = ("factored", "bayes")
RULES = ("fixed list", "open list", "open list, one question")


def stream_section(cells: Cells) -> str:
    """First meetings with unknown goals, and streams of brackets."""
    return (
        "## Goals that nobody listed: an open list, and a question\n"
        f"{100 * ERROR:g} % of the actions are misdetected, in three patterns: as any other action, as the same type "
        "at a neighbouring hole, as an alike type at the same hole; planners know which. A camera sees which holes are "
        "filled. After each of 1 to 5 actions the robot acts, asks or waits by the guard's costs. `answers`: whether "
        "somebody is there, who says once, and truly, which goal it is. `wrong`: of goals never shown, assemblies of "
        f"{SINGLE} with a wrong act. `twice`: acts after that goal was finished twice, as a share of those that a "
        "listed goal would allow."
        "\n\n"
        + markdown(
            [
                "",
                "confusions",
                "answers",
                "wrong, unknown",
                "asked",
                "acts, known",
                "wrong acts",
                "asked",
                "twice",
            ],
            _first_meetings(cells),
        )
        + f"\n\nStreams of {BRACKETS} brackets, alike types confused; of the goals in use three are listed. Every "
        "finished bracket is learned from, but by the fixed list. Shares of acts that are wrong, of states in which "
        "the robot acts, and of brackets with a question; in all and in the second half; means over "
        f"{len(SEEDS)} seeds.\n\n"
        + markdown(["", "in use", "", "wrong acts", "second half", "acts", "second half", "asked"], _streams(cells))
    )


def _first_meetings(cells: Cells) -> list[list[str]]:
    rows = []
    for kind in STREAM_KINDS:
        for pattern in PATTERNS:
            for answers in (False, True):
                key = {"kind": kind, "pattern": pattern, "answers": answers}
                names = (
                    "wrong_assemblies_unknown",
                    "asked_unknown",
                    "coverage_known",
                    "wrong_acts_known",
                    "asked_known",
                )
                twice, listed = (
                    values_of(cells, score_of(f"coverage_{name}"), **key) for name in ("seen_twice", "as_listed")
                )
                share = shown([a / b for a, b in zip(twice, listed, strict=True)])
                rows.append(
                    [
                        kind,
                        pattern,
                        "yes" if answers else "no",
                        *(shown_share(cells, name, **key) for name in names),
                        share,
                    ]
                )
    return rows


def _streams(cells: Cells) -> list[list[str]]:
    rows = []
    for kind in STREAM_KINDS:
        for in_use in IN_USE:
            for rule in RULES:
                key = {"kind": kind, "in_use": in_use, "rule": rule}
                names = ("wrong_acts", "wrong_acts_second_half", "coverage", "coverage_second_half", "asked")
                found = [shown(values_of(cells, score_of(name), **key)) for name in names]
                rows.append([kind, str(in_use), rule, *found])
    return rows


EXPERIMENTS = {
    "settings": Experiment(settings_cells, (semantic_ratio_page.settings_section,)),
    "ratios": Experiment(ratio_cells, (semantic_ratio_page.ratio_section,)),
    "belief": Experiment(
        belief_cells,
        (noise_section, acting_section, unknown_section),
    ),
    "habits": Experiment(habit_cells, (habit_section,)),
    "streams": Experiment(stream_cells, (stream_section,)),
    "sizes": Experiment(size_cells, (semantic_ratio_page.size_section,)),
}

HEAD = (
    "# Experiments on semantic planners\n"
    "Which planner to take, how to teach goals and how to certify a threshold is in [planners.md](../planners.md).\n\n"
    "The goal and what remains to be done, inferred from the parts that are seen in place. All data are generated "
    "(`lab/bracket_lab/learned/semantic/scenarios.py`, "
    "`lab/bracket_lab/experiments/semantic_demonstrators.py`). `factored` is the default: learned slots and habits "
    "with "
    "exact inference under noise; `paper` the graph network and LSTM; `and_or` an AND/OR graph of the states that "
    "were demonstrated; `htn` a hierarchical task network by hand; `bayes` exact inference for demonstrators without "
    "habits; these two learn nothing. Numbers are means over seeds; `+-` is the half width of the 95 % "
    "confidence interval over seeds (Student's t), and is left out where it rounds to nothing. Finished "
    "cells are kept under `data/semantic` until their settings or the code behind them change."
)
