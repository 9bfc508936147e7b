"""The paper's planner on scenes like the paper's: what it reaches, and what it has learned of its training scenes."""

from __future__ import annotations

from functools import partial

from cell.interfaces.perception import PartDetection
from cell.interfaces.planning import GraspPlan, GraspPlanner
from cell.interfaces.product import Product
from learned.experiments import Cell, Cells, Values, markdown, shown_share
from learned.grasp.evaluate import REQUIRED_TYPES, evaluate_scenes
from learned.grasp.experiments.baselines import trained_planner
from learned.grasp.experiments.cells import PAPER_SCENES as PAPER_COUNT
from learned.grasp.experiments.cells import TEST_SCENES, TEST_SEED
from learned.grasp.graph import Attention
from learned.grasp.planner import PaperPlanner
from learned.grasp.scenes import Scene, draw_scenes
from learned.grasp.settings import PAPER_SCENES, SceneSettings
from learned.grasp.training_settings import PaperSettings

EPOCHS = 110  # until nearly all of its training scenes are right
PAPER_FIGURES = ".910 / .891 / .882"
ROWS = {
    "always": 'always "grasp"',
    "help": 'always "help"',
    "pose": "WL-GNN + LSTM_Att, poses",
    "printed": "WL-GNN + LSTM_Att, poses, Eq. 7 as printed",
    "crops": "WL-GNN + LSTM_Att, with f_i from crops",
}


class Constant:
    """Gives one answer to everything."""

    def __init__(self, plan: GraspPlan) -> None:
        self._plan = plan

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:  # noqa: ARG002
        """The answer."""
        return self._plan


CONSTANT = {"always": GraspPlan(1.0, (), False, "grasp"), "help": GraspPlan(0.0, (), True, "help")}


def paper_cells(product: Product) -> list[Cell]:
    """Every row, one seed."""
    return [
        Cell({"experiment": "paper", "row": row, "seed": 1, "epochs": EPOCHS}, partial(_measure, product, row))
        for row in ROWS
    ]


def _measure(product: Product, row: str) -> Values:
    data = PAPER_SCENES.model_copy(update={"crops": row == "crops"})
    test = list(draw_scenes(product, TEST_SEED, TEST_SCENES, "test", data))
    if row in CONSTANT:
        return dict(evaluate_scenes(Constant(CONSTANT[row]), test, TEST_SEED))
    attention: Attention = "printed" if row == "printed" else "additive"
    settings = PaperSettings(
        scenes=PAPER_COUNT, observations=1, epochs=EPOCHS, parts=data.parts, data=data, attention=attention
    )
    planner = trained_planner(settings, product, 1)
    learned = list(draw_scenes(product, 1, PAPER_COUNT, "train", data, settings.parts))
    scores = _scores(planner, test)
    return scores | {f"train_{name}": value for name, value in _scores(planner, learned).items()}


def _scores(planner: GraspPlanner, scenes: list[Scene]) -> Values:
    if isinstance(planner, PaperPlanner):
        planner.prepare([scene.parts for scene in scenes])
    return dict(evaluate_scenes(planner, scenes, TEST_SEED))


def paper_section(cells: Cells) -> str:
    """The table."""
    names = [f"object_accuracy_{count}" for count in REQUIRED_TYPES]
    names += [
        "object_accuracy_by_type",
        "graspability_accuracy",
        "train_graspability_accuracy",
        "train_object_accuracy_1",
    ]
    rows = []
    for row, title in ROWS.items():
        known = [values for key, values in cells if key["row"] == row]
        found = [shown_share(cells, name, row=row) if known and name in known[0] else "-" for name in names]
        rows.append([title, *found, PAPER_FIGURES if row == "crops" else "-"])
    data = SceneSettings()
    return (
        "## Scenes like the paper's\n"
        f"{PAPER_COUNT} training scenes of {data.parts[0]} to {data.parts[1]} parts, at most 3, 2 and 1 of a type, one "
        "way to grasp (across the width), a fifth of the parts asked for not graspable at once; "
        f"{TEST_SCENES} test scenes, one seed, {EPOCHS} epochs. `by type`: an answer that moves the right number of "
        "every type is right, as the paper's words name types; the columns before ask for the very parts. `f_i`: 64 "
        "cosine coefficients of a drawn height image around each part, 5 mm a cell, in the place of the paper's "
        "network on the image. `train`: verdict and whole answer on its own training scenes (the paper's Train_Acc is "
        "1).\n\n"
        + markdown(
            [
                "planner",
                "1 type",
                "2 types",
                "3 types",
                "by type",
                "verdict",
                "train, verdict",
                "train, whole",
                "paper",
            ],
            rows,
        )
    )
