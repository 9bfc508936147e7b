"""Table 2 on scenes like the paper's: what its planner reaches, and what it has learned of its training scenes."""

from __future__ import annotations

from learned.experiments import Cells, markdown, number, shown_share
from learned.grasp.evaluate import REQUIRED_TYPES
from learned.grasp.experiments.baselines import BASELINES, USUAL_SCENES
from learned.grasp.experiments.cells import ON_PAPER_SCENES, TEST_SCENES
from learned.grasp.settings import PAPER_SCENES

HEAD = (
    "planner",
    "1 type",
    "2 types",
    "3 types",
    "1 type, by part",
    "verdict",
    "train, verdict",
    "train, whole",
    "paper, 1 / 2 / 3",
)


def paper_section(cells: Cells) -> str:
    """The table."""
    rows = []
    for name in ON_PAPER_SCENES:
        tested = [*(f"by_type_{count}" for count in REQUIRED_TYPES), "object_accuracy_1", "graspability_accuracy"]
        found = [shown_share(cells, score, planner=name, clutter="paper", what="objects") for score in tested]
        learned = [
            shown_share(cells, score, planner=name, clutter="paper", what="train")
            for score in ("graspability_accuracy", "by_type_1")
        ]
        rows.append((BASELINES[name].title, *found, *learned, " / ".join(map(number, BASELINES[name].paper)) or "-"))
    fewest, most = PAPER_SCENES.parts
    return (
        "## Table 2: scenes like the paper's\n"
        f"{USUAL_SCENES} training and {TEST_SCENES} test scenes of {fewest} to {most} parts, at most 3, 2 and 1 of a "
        "type, one way to grasp (across the width), a fifth of the parts asked for not graspable at once; one seed. "
        "Whole answers, right by type as the paper's words name types; `by part`: the very parts, in an order that "
        "works. 2 and 3 types: one graph with so many flags. f_i: a small network tells, from a crop of 14 cm of "
        "the rendered wrist image around each part, where parts stand; it is trained before on the same images, as the "
        "paper's detector is. A second one, trained with the rest, makes features of that. `train`: on its own "
        f"training scenes (the paper's Train_Acc is 1).\n\n{markdown(HEAD, rows)}"
    )
