"""The page of the experiments: Markdown tables and plots beside it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from cell.interfaces.errors import InputError
from cell.interfaces.product import Product
from learned.semantic.experiments import belief_page, plots, ratio_page
from learned.semantic.experiments.belief import belief_cells
from learned.semantic.experiments.habits import habit_cells
from learned.semantic.experiments.ratios import ratio_cells
from learned.semantic.experiments.settings import settings_cells
from learned.semantic.experiments.sizes import size_cells
from learned.semantic.experiments.store import Cell, Store
from learned.semantic.experiments.tables import Cells


@dataclass(frozen=True)
class Experiment:
    """What is measured, what is written of it, and its plot by the end of a file name."""

    cells: Callable[[Product], list[Cell]]
    sections: tuple[Callable[[Cells], str], ...]
    plots: Mapping[str, Callable[[Cells, Path], None]]


EXPERIMENTS = {
    "settings": Experiment(settings_cells, (ratio_page.settings_section,), {}),
    "ratios": Experiment(ratio_cells, (ratio_page.ratio_section,), {"ratios": plots.plot_ratios}),
    "belief": Experiment(
        belief_cells,
        (belief_page.noise_section, belief_page.acting_section, belief_page.unknown_section),
        {"coverage": plots.plot_coverage},
    ),
    "habits": Experiment(habit_cells, (belief_page.habit_section,), {"habits": plots.plot_habits}),
    "sizes": Experiment(size_cells, (ratio_page.size_section,), {}),
}


def write_report(names: list[str], product: Product, store: Store, out: Path, facts: Mapping[str, str]) -> None:
    """Measure what is not in the store, and write the page and its plots.

    Args:
        names: of EXPERIMENTS.
        facts: command, date, machine and the like, for the head of the page.

    Raises:
        InputError: the page cannot be written.
    """
    sections = [_head(facts)]
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        for name in names:
            experiment = EXPERIMENTS[name]
            cells = store.run(name, experiment.cells(product))
            sections += [write(cells) for write in experiment.sections]
            for end, plot in experiment.plots.items():
                picture = out.with_name(f"{out.stem}_{end}.png")
                plot(cells, picture)
                sections.append(f"![{name}]({picture.name})")
        out.write_text("\n\n".join(sections) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{out}: cannot write the report: {error.strerror}") from error


def _head(facts: Mapping[str, str]) -> str:
    rows = "\n".join(f"| {name} | {value} |" for name, value in facts.items())
    return (
        "# Experiments on semantic planners\n"
        "The goal and what remains to be done, inferred from the parts that are seen in place. All data are generated "
        "(`learned/semantic/scenarios.py`, `people.py`). `factored` is the default: learned slots and habits with "
        "exact inference under noise; `paper` the graph network and LSTM; `and_or` an AND/OR graph of the states that "
        "were demonstrated; `bayes` exact inference for people without habits, which learns nothing. Numbers are means "
        "over seeds; `+-` is the half width of the 95 % confidence interval over seeds (Student's t), and is left out "
        "where it rounds to nothing. Finished cells are kept under `data/semantic` and not measured again: remove the "
        f"file there after a change of the code.\n\n| | |\n|---|---|\n{rows}"
    )
