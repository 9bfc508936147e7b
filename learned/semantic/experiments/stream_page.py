"""Section on goals that nobody listed."""

from __future__ import annotations

from learned.experiments import Cells, markdown, score_of, shown, shown_share, values_of
from learned.semantic.confusions import PATTERNS
from learned.semantic.experiments.streams import BRACKETS, DOUBT, ERROR, IN_USE, NEVER, SEEDS, SINGLE

KINDS = ("factored", "bayes")
RULES = ("fixed list", "open list", "open list, one question")


def stream_section(cells: Cells) -> str:
    """First meetings with unknown goals, and streams of brackets."""
    first = []
    for kind in KINDS:
        for pattern in PATTERNS:
            for doubt in (NEVER, DOUBT):
                key = {"kind": kind, "pattern": pattern, "doubt": doubt}
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
                first.append([kind, pattern, f"{doubt:g}", *(shown_share(cells, name, **key) for name in names), share])
    streams = []
    for kind in KINDS:
        for in_use in IN_USE:
            for rule in RULES:
                key = {"kind": kind, "in_use": in_use, "rule": rule}
                names = ("wrong_acts", "wrong_acts_second_half", "coverage", "coverage_second_half", "asked")
                found = [shown(values_of(cells, score_of(name), **key)) for name in names]
                streams.append([kind, str(in_use), rule, *found])
    return (
        "## Goals that nobody listed: an open list, and a question\n"
        f"{100 * ERROR:g} % of the actions are misdetected, in three patterns: as any other action, as the same type "
        "at a neighbouring hole, as an alike type at the same hole; planners know which. A camera sees which holes are "
        "filled. After each of 1 to 5 actions the robot would act where a placement has .9 and `none of these` less "
        "than .5. `doubt`: from which probability of `none of these` on it asks instead of its first act which goal it "
        f"is; it is told truly, once an assembly. `wrong`: assemblies of {SINGLE} with a wrong act, of goals never "
        "shown. `twice`: acts after that goal was finished twice, as a share of those that a listed goal would allow."
        "\n\n"
        + markdown(
            [
                "",
                "confusions",
                "doubt",
                "wrong, unknown",
                "asked",
                "acts, known",
                "wrong acts",
                "asked",
                "twice",
            ],
            first,
        )
        + f"\n\nStreams of {BRACKETS} brackets, alike types confused; of the goals in use three are listed. Every "
        "finished bracket is learned from, but by the fixed list. Shares of acts that are wrong, of states in which "
        "the robot acts, and of brackets with a question; in all and in the second half; means over "
        f"{len(SEEDS)} seeds.\n\n"
        + markdown(["", "in use", "", "wrong acts", "second half", "acts", "second half", "asked"], streams)
    )
