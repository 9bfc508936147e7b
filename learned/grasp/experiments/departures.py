"""Where our build of the paper's grasp planner departs from what is printed, and what that changes."""

from __future__ import annotations

from learned.experiments import Cells, markdown, score_of, values_of

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
