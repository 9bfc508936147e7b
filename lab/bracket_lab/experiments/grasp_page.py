"""The page of the experiments on grasp planners."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from bracket_cell.learned.grasp.crops import TrayCamera
from bracket_lab.experiments.experiments import (
    Cells,
    Experiment,
    markdown,
    number,
    score_of,
    shown,
    shown_share,
    values_of,
)
from bracket_lab.experiments.grasp_cells import (
    CURVE,
    ITERATIVE_SCENES,
    NOISES,
    ON_DENSE_SCENES,
    TEST_SCENES,
    TEST_SEED,
    USUAL,
    curve_cells,
    noise_cells,
    paper_cells,
    paper_section,
    table2_cells,
    table3_cells,
)
from bracket_lab.experiments.paper.grasp import BASELINES, USUAL_SCENES
from bracket_lab.learned.grasp.evaluate import REQUIRED_TYPES, SCENE_SIZES

TYPE, PART = "by_type_1", "object_accuracy_1"
DEPARTURES_HEAD = ("the paper", "here", "effect, whole answers, 1 type")


def departures_section(cells: Cells) -> str:
    """One row for each departure; effects are of this experiment's cells."""
    rows = (
        (
            "f_i: RoI features of ResNet-101 in Faster R-CNN",
            "a network that tells where parts stand in a crop around the detection, trained before on the same images, "
            "and three convolutions on what it tells, trained with the planner",
            f"without f_i {_change(cells, 'paper', 'poses')}",
        ),
        (
            "v_i = {f_i, l_i, g_i}",
            "and the pose in the tray, scenes turned and mirrored at random in training",
            "not measured",
        ),
        (
            "Eq. 4: e_ij = 1 / sum over j of 1/d_ij, alike for every j",
            "(1/d_ij) / sum over k of 1/d_ik, which weights neighbours",
            f"as printed {_change(cells, 'paper', 'printed')}",
        ),
        ("Eq. 7: score h' W f", "as printed", f"with an additive score {_change(cells, 'paper', 'additive')}"),
        (
            "text by types; no rule says which part of a type is meant",
            "text by types; the part meant is the nearest of its type to what must be freed",
            f"the very parts, in an order that works {_change(cells, 'paper', 'paper', PART)}",
        ),
        (
            "427 photographs, labelled by people",
            "rendered images of drawn scenes, labelled by the gripper's outline",
            "not measured",
        ),
    )
    return f"## Departures from the paper\n{markdown(DEPARTURES_HEAD, rows)}"


def _change(cells: Cells, first: str, second: str, score: str = TYPE) -> str:
    """From one row's accuracy by type to another row's score; in words where one was not measured."""
    before, after = (
        values_of(cells, score_of(name), planner=row, what="objects", clutter="paper")
        for row, name in ((first, TYPE), (second, score))
    )
    return f"{before[0]:.3f} to {after[0]:.3f}".replace("0.", ".") if before and after else "not measured"


_OBJECTS = tuple(f"object_accuracy_{count}" for count in REQUIRED_TYPES)
HEAD = (
    "# Experiments on grasp planners\n"
    "Which planner to take, and how to train one, is in [planners.md](../planners.md).\n\n"
    "An answer is right if the whole of it is: the part can be grasped; or a sequence of moves that works, none "
    "shorter; or help where no sequence works. What is right is decided by the gripper's true outline touching a "
    "neighbour or not (`learned/grasp/candidates.py`), compared with simulated grasps by "
    "`python -m tests.benchmarks.grasp_labels`. One set of test scenes, of one seed; nothing was chosen by it. "
    "In brackets is the 95 % interval (Wilson); where several seeds were trained, from 1 on, the mean stands before "
    "the ends of all their intervals."
)


def table2_section(cells: Cells) -> str:
    """Whole answers by number of required types, on dense scenes."""
    rows = []
    for name in ON_DENSE_SCENES:
        dense = [_share(cells, key, planner=name) for key in _OBJECTS]
        few = _share(cells, _OBJECTS[0], planner=name, what="few")
        loose = _share(cells, _OBJECTS[0], planner=name, clutter="loose")
        rows.append((BASELINES[name].title, *dense, few, loose))
    head = ("planner", "1 type", "2 types", "3 types", "50 scenes, 1 type", "loose tray, 1 type")
    return (
        "## Table 2: dense scenes\n"
        f"{USUAL_SCENES} training scenes; {TEST_SCENES} test scenes, and the first 50 of them; two parts in five "
        "cannot be grasped at once, by width or length; answers name the very parts. The loose tray is drawn like the "
        "simulator's. The rule keeps the skills' safety margins and so takes many parts for blocked that the gripper "
        "just passes; without them it is nearly exact at the detector's noise.\n\n"
        f"{markdown(head, rows)}"
    )


def table3_section(cells: Cells) -> str:
    """Iterative solving by number of parts."""
    rows = []
    for clutter, name in dict.fromkeys((key["clutter"], key["planner"]) for key, _ in cells):
        sizes = [f"iterative {size}" for size in SCENE_SIZES]
        key = {"planner": name, "clutter": clutter}
        title, figures = BASELINES[name].title, " / ".join(map(number, BASELINES[name].iterative)) or "-"
        success = [_share(cells, "iterative_success", what=what, **key) for what in sizes]
        rows.append((title, clutter, "success", *success, figures))
        for score, words, digits in (("steps", "grasps", 2), ("needless_moves", "needless moves", 3)):
            values = [shown(values_of(cells, score_of(score), what=what, **key), digits) for what in sizes]
            rows.append((title, clutter, words, *values, "-"))
    head = ("planner", "scenes", "", *(f"{size} parts" for size in SCENE_SIZES), "paper, 3 / 4 / 5 / 6")
    return (
        "## Table 3: iterative solving, in geometry\n"
        f"{ITERATIVE_SCENES} scenes of each size; the first required part at random; after every grasp all is seen "
        "anew. Success: the required part is grasped without touching another, or help is asked for where nothing else "
        f"would do. The executed series is `python -m tests.benchmarks.robot_alone clutter`.\n\n{markdown(head, rows)}"
    )


def noise_section(cells: Cells) -> str:
    """Answers under noise."""
    rows = [
        (title, *(_share(cells, _OBJECTS[0], noise=noise, **wanted) for noise in NOISES))
        for title, wanted in _NOISE_ROWS.items()
    ]
    return (
        "## Noise\n"
        "Object accuracy for one required type; standard deviations of position (x and y each) and heading, and of "
        "heights and sizes. The detector's own: .4 mm, .25 deg, heights and sizes from the product. `default` is told "
        "the level; told nothing, it believes in the detector's own. `rule` trusts the detected sizes; `default` has "
        "the product's beside them, which is why noise of heights hardly touches it; a rule that read the product's "
        "sizes would keep its score there as well. "
        "The reference averages over scenes that the detections allow, without knowing how parts are strewn; what is "
        "learned knows, and passes it under much noise. A dash: as at the detector's noise.\n\n"
        f"{markdown(('planner', *NOISES), rows)}"
    )


def curve_section(cells: Cells) -> str:
    """Score by number of training scenes."""
    rows = [
        (BASELINES[name].title, *(_share(cells, _OBJECTS[0], planner=name, scenes=count) for count in CURVE))
        for name in ("default", "paper")
    ]
    return (
        "## Learning curve\n"
        "Object accuracy for one required type, by training scenes; one seed from 1000 scenes on.\n\n"
        f"{markdown(('planner', *map(str, CURVE)), rows)}"
    )


def experiments(camera: TrayCamera, test_seed: int = TEST_SEED) -> dict[str, Experiment]:
    """By name; the camera takes the images of scenes, and the test scenes are those of a seed."""
    asked: dict[str, Any] = {"camera": camera, "test_seed": test_seed}
    tables = {
        "paper": Experiment(partial(paper_cells, **asked), (paper_section, departures_section)),
        "table2": Experiment(partial(table2_cells, **asked), (table2_section,)),
        "table3": Experiment(partial(table3_cells, **asked), (table3_section,)),
    }
    noise = Experiment(partial(noise_cells, **asked), (noise_section,))
    curve = Experiment(partial(curve_cells, **asked), (curve_section,))
    return tables | {"noise": noise, "curve": curve}


_NOISE_ROWS: Mapping[str, Mapping[str, object]] = {
    BASELINES["average"].title: {"planner": "average"},
    BASELINES["default"].title: {"planner": "default"},
    "default, not told the noise": {"planner": "default", "told": False},
    **{BASELINES[name].title: {"planner": name} for name in ("rule", "rule0")},
}


def _share(cells: Cells, score: str, **wanted: object) -> str:
    return shown_share(cells, score, **{**USUAL, **wanted})
