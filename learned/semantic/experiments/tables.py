"""Numbers of cells as text: means over seeds with 95 % confidence intervals, in Markdown tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from statistics import fmean, stdev

from learned.semantic.experiments.store import Key, Values

Cells = Sequence[tuple[Key, Values]]
STUDENT_T = {2: 12.706, 3: 4.303, 4: 3.182, 5: 2.776, 10: 2.262}  # two-sided 95 %, by number of seeds


def values_of(cells: Cells, pick: Callable[[Values], float], **wanted: object) -> list[float]:
    """One number of every cell whose key has these entries."""
    return [pick(values) for key, values in cells if all(key.get(name) == value for name, value in wanted.items())]


def score_of(name: str, part: str = "") -> Callable[[Values], float]:
    """Picks a score by name, of a part of the values where one is named."""

    def pick(values: Values) -> float:
        return float(values[part][name] if part else values[name])

    return pick


def mean_and_half_width(numbers: Sequence[float]) -> tuple[float, float]:
    """Mean over seeds and half the width of its 95 % confidence interval (Student), zero for one seed."""
    if len(numbers) < 2:
        return fmean(numbers), 0.0
    return fmean(numbers), STUDENT_T[len(numbers)] * stdev(numbers) / len(numbers) ** 0.5


def shown(numbers: Sequence[float], digits: int = 3) -> str:
    """Mean and half width as text; a dash where nothing was measured."""
    if not numbers:
        return "-"
    mean, half = mean_and_half_width(numbers)
    text = f"{mean:.{digits}f}".replace("0.", ".", 1) if 0 < mean < 1 else f"{mean:.{digits}f}"
    if round(half, digits) == 0.0:
        return text
    return f"{text} +- {half:.{digits}f}".replace("+- 0.", "+- .")


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
