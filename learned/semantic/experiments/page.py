"""The page of the experiments on semantic planners."""

from __future__ import annotations

from learned.experiments import Experiment
from learned.semantic.experiments import belief_page, ratio_page
from learned.semantic.experiments.belief import belief_cells
from learned.semantic.experiments.habits import habit_cells
from learned.semantic.experiments.ratios import ratio_cells
from learned.semantic.experiments.settings import settings_cells
from learned.semantic.experiments.sizes import size_cells
from learned.semantic.experiments.stream_page import stream_section
from learned.semantic.experiments.streams import stream_cells

EXPERIMENTS = {
    "settings": Experiment(settings_cells, (ratio_page.settings_section,)),
    "ratios": Experiment(ratio_cells, (ratio_page.ratio_section,)),
    "belief": Experiment(
        belief_cells,
        (belief_page.noise_section, belief_page.acting_section, belief_page.unknown_section),
    ),
    "habits": Experiment(habit_cells, (belief_page.habit_section,)),
    "streams": Experiment(stream_cells, (stream_section,)),
    "sizes": Experiment(size_cells, (ratio_page.size_section,)),
}

HEAD = (
    "# Experiments on semantic planners\n"
    "Which planner to take, how to teach goals and how to certify a threshold is in [planners.md](../planners.md).\n\n"
    "The goal and what remains to be done, inferred from the parts that are seen in place. All data are generated "
    "(`learned/semantic/scenarios.py`, `demonstrators.py`). `factored` is the default: learned slots and habits with "
    "exact inference under noise; `paper` the graph network and LSTM; `and_or` an AND/OR graph of the states that "
    "were demonstrated; `bayes` exact inference for demonstrators without habits, which learns nothing. Numbers are "
    "means over seeds; `+-` is the half width of the 95 % confidence interval over seeds (Student's t), and is left "
    "out where it rounds to nothing. Finished cells are kept under `data/semantic` until their settings or the code "
    "behind them change."
)
