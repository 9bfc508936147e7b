"""Where our build of the paper's grasp planner departs from what is printed, and what that changes."""

from __future__ import annotations

from learned.experiments import Cells, markdown, score_of, values_of

INSTANCE, TYPE = "object_accuracy_1", "object_accuracy_by_type"
HEAD = ("the paper", "here", "effect, whole answers, 1 type")


def departures_section(cells: Cells) -> str:
    """One row for each departure; effects of this experiment's cells are worked out, others named by their rows."""
    rows = (
        (
            "f_i: features of a network on the crop of each object",
            "the pose, relative to the required part; or cosines of a drawn height image",
            f"with the drawn crops in addition {_change(cells, 'pose', 'crops')}",
        ),
        (
            "Eq. 4: e_ij = 1 / sum over j of 1/d_ij, alike for every j",
            "(1/d_ij) / sum over k of 1/d_ik, which weights neighbours",
            "Table 2: row `normalised` against row `as printed`",
        ),
        (
            "Eq. 6: graspability of every node; Eq. 7: score h' W f over embedding, label and graspability",
            "graspability of the required part alone; additive attention over embeddings",
            f"as printed {_change(cells, 'pose', 'printed')}",
        ),
        (
            "1, 2 or 3 required types: one graph with as many flags",
            "one question, and one flag, for each required part",
            "not measured; the columns of 2 and 3 types pool single questions",
        ),
        (
            'the text names types: "move b and/or c, or help"',
            "the text names parts, in a shortest order that works",
            f"types alone {_change(cells, 'pose', 'pose', TYPE)}",
        ),
        (
            "427 photographs, labelled by people",
            "drawn scenes, labelled by the gripper's outline, with one way to grasp here and two in Table 2",
            "Table 2: dense scenes, where two ways to grasp make orders longer to find",
        ),
    )
    return f"## Departures from the paper\n{markdown(HEAD, rows)}"


def _change(cells: Cells, first: str, second: str, score: str = INSTANCE) -> str:
    """From one row's instance accuracy to another row's score; a dash where one was not measured."""
    before, after = (values_of(cells, score_of(name), row=row) for row, name in ((first, INSTANCE), (second, score)))
    return f"{before[0]:.3f} to {after[0]:.3f}".replace("0.", ".") if before and after else "not measured"
