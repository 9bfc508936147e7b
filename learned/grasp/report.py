"""Tables and plots of the experiments, as Markdown with PNG files beside it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import fmean

from matplotlib.figure import Figure

from learned.grasp.contenders import CONTENDERS, SEEDS
from learned.grasp.evaluate import REQUIRED_TYPES, SCENE_SIZES
from learned.grasp.experiments import CURVE, NOISES, PAPER_SCENES, TEST_SEED, Cell, Experiment
from learned.grasp.tally import half_width

Scores = Mapping[Cell, Mapping[str, float]]
_OBJECTS = tuple(f"object_accuracy_{count}" for count in REQUIRED_TYPES)


def write_report(out: Path, experiments: Sequence[Experiment], scores: Scores, facts: Mapping[str, str]) -> None:
    """Write `out` and the plots beside it.

    Args:
        scores: of all cells of these experiments.
        facts: command, date, machine and so on, for the head.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    sections = [_head(facts), *(_SECTIONS[name](scores, out) for name in experiments)]
    out.write_text("\n\n".join(sections) + "\n", encoding="utf-8")


def _head(facts: Mapping[str, str]) -> str:
    rows = "\n".join(f"| {name} | {value} |" for name, value in facts.items())
    return (
        "# Experiments on grasp planners\n"
        "An answer is right if the whole of it is: the part can be grasped; or a sequence of moves that works, none "
        "shorter; or help where no sequence works. Scenes are drawn densely: two parts in five cannot be grasped at "
        "once. What is right is decided by the gripper's true outline touching a neighbour or not "
        "(`learned/grasp/physics.py`), compared with simulated grasps by `python -m tests.benchmarks.grasp_labels`. "
        f"One set of test scenes, seed {TEST_SEED}, by which nothing was "
        "chosen. `+-` is the half width of the 95 % interval (Wilson) of one run; where several seeds were "
        "trained, from 1 on, the mean and the lowest and highest.\n\n"
        f"| | |\n|---|---|\n{rows}"
    )


def _table2(scores: Scores, out: Path) -> str:  # noqa: ARG001
    rows = []
    for name, contender in CONTENDERS.items():
        dense = [_mean(scores, Cell(name), key) for key in _OBJECTS]
        fifty = _mean(scores, Cell(name, what="fifty"), _OBJECTS[0])
        tray = _mean(scores, Cell(name, tray=True), _OBJECTS[0])
        paper = " / ".join(_number(value) for value in contender.paper) or "-"
        rows.append((contender.title, *dense, fifty, tray, paper))
    head = ("planner", "1 type", "2 types", "3 types", "50 scenes, 1 type", "loose tray, 1 type", "paper, 1 / 2 / 3")
    return (
        "## Table 2: whole answers, by number of required types\n"
        f"{PAPER_SCENES} training scenes; 1000 test scenes, and the first 50 of them. The loose tray is drawn like "
        'the simulator\'s; there 99 of 100 parts can be grasped at once, so that always answering "grasp" scores '
        f"about .99. The paper's figures stem from its own 50 images. "
        "The rule keeps the skills' safety margins and so takes many parts for blocked that the gripper just passes; "
        "without them it is nearly exact at the detector's noise. GVMRN_RF is rebuilt on what our detector gives: a "
        "graph over pairs of parts with the relation filter. Crops' embeddings are 16 cosine coefficients of a drawn "
        "height image around each part; it shows the truth, which our detector does not give. They help the paper's "
        "planner; `default` is so near the reference, which knows the noise, that they could add little there.\n\n"
        f"{_markdown(head, rows)}"
    )


def _table3(scores: Scores, out: Path) -> str:  # noqa: ARG001
    rows = []
    for name in dict.fromkeys(cell.contender for cell in scores if cell.what.startswith("iterative")):
        for key, title in (("iterative_success", "success"), ("steps", "grasps"), ("needless_moves", "needless moves")):
            values = [_mean(scores, Cell(name, what=f"iterative {size}"), key) for size in SCENE_SIZES]
            figures = CONTENDERS[name].iterative if key == "iterative_success" else ()
            rows.append((CONTENDERS[name].title, title, *values, " / ".join(map(_number, figures)) or "-"))
    head = ("planner", "", *(f"{size} parts" for size in SCENE_SIZES), "paper, 3 / 4 / 5 / 6")
    return (
        "## Table 3: iterative solving, in geometry\n"
        "250 scenes of each size; the first required part at random; after every grasp all is seen anew. Success: the "
        "required part is grasped without touching another, or help is asked for where nothing else would do. The "
        f"executed series is `python -m tests.benchmarks.robot_alone clutter`.\n\n{_markdown(head, rows)}"
    )


def _noise(scores: Scores, out: Path) -> str:
    rows = []
    plotted: dict[str, list[float]] = {}
    for name in ("average", "default", "untold", "rule", "rule0", "paper"):
        told, contender = name != "untold", "default" if name == "untold" else name
        cells = [Cell(contender, noise=noise, told=told or noise == "detector") for noise in NOISES]
        title = "default, not told the noise" if not told else CONTENDERS[contender].title
        known = [cell for cell in cells if cell in scores]
        rows.append((title, *(_mean(scores, cell, _OBJECTS[0]) if cell in scores else "as detector" for cell in cells)))
        plotted[title] = [fmean(_values(scores, cell, _OBJECTS[0])) for cell in known]
    picture = out.with_name(f"{out.stem}_noise.png")
    _plot_noise(plotted, picture)
    return (
        "## Noise\n"
        "Object accuracy for one required type; standard deviations of position (x and y each) and heading, and of "
        "heights and sizes. The detector's own: .4 mm, .25 deg, heights and sizes from the product. `default` is told "
        "the level; told nothing, it believes in the detector's own. `rule` trusts the detected sizes; `default` has "
        "the product's beside them, which is why noise of heights hardly touches it; a rule that read the product's "
        "sizes would keep its score there as well. "
        "The reference averages over scenes that the detections allow, without knowing how parts are strewn; what is "
        "learned knows, and passes it under much noise.\n\n"
        f"{_markdown(('planner', *NOISES), rows)}\n\n![Accuracy under noise]({picture.name})"
    )


def _curve(scores: Scores, out: Path) -> str:
    rows = []
    plotted: dict[str, list[float]] = {}
    for name in ("default", "paper"):
        cells = [Cell(name, count) for count in CURVE]
        rows.append((CONTENDERS[name].title, *(_mean(scores, cell, _OBJECTS[0]) for cell in cells)))
        plotted[CONTENDERS[name].title] = [fmean(_values(scores, cell, _OBJECTS[0])) for cell in cells]
    picture = out.with_name(f"{out.stem}_curve.png")
    _plot_curve(plotted, picture)
    return (
        "## Learning curve\n"
        "Object accuracy for one required type, by training scenes; one seed from 1000 scenes on.\n\n"
        f"{_markdown(('planner', *map(str, CURVE)), rows)}\n\n![Learning curve]({picture.name})"
    )


_SECTIONS: dict[Experiment, Callable[[Scores, Path], str]] = {
    "table2": _table2,
    "table3": _table3,
    "noise": _noise,
    "curve": _curve,
}


def _values(scores: Scores, cell: Cell, key: str) -> list[float]:
    """The score in every seed that was run."""
    cells = [
        Cell(cell.contender, cell.train_scenes, seed, cell.what, cell.noise, cell.told, cell.tray) for seed in SEEDS
    ]
    return [scores[found][key] for found in cells if found in scores]


def _mean(scores: Scores, cell: Cell, key: str) -> str:
    values = _values(scores, cell, key)
    if not values:
        return "-"
    text = _number(fmean(values))
    if (width := scores[cell].get(f"{key}_ci95")) is not None:
        text += f" +- {_number(width)}"
    if len(values) > 1:
        text += f" ({_number(min(values))} - {_number(max(values))})"
    return text


def _number(value: float) -> str:
    return f"{value:.3f}".removeprefix("0") if value < 1 else f"{value:.2f}"


def _markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _plot_noise(plotted: Mapping[str, Sequence[float]], path: Path) -> None:
    figure = Figure(figsize=(9, 4.6), layout="constrained")
    axes = figure.subplots()
    width = 0.8 / len(plotted)
    for number, (title, values) in enumerate(plotted.items()):
        places = [place + (number - len(plotted) / 2 + 0.5) * width for place in range(len(values))]
        axes.bar(places, values, width, yerr=[half_width(v, 1000) for v in values], error_kw={"lw": 0.8}, label=title)
    axes.set_xticks(range(len(NOISES)), [name.replace("heights and sizes", "heights\nand sizes") for name in NOISES])
    axes.set_ylabel("object accuracy, 1 required type")
    axes.set_ylim(0.4, 1.0)
    axes.grid(alpha=0.3, axis="y")
    figure.legend(fontsize="small", loc="outside lower center", ncols=2)
    figure.savefig(path, dpi=110)


def _plot_curve(plotted: Mapping[str, Sequence[float]], path: Path) -> None:
    figure = Figure(figsize=(6.5, 4), layout="constrained")
    axes = figure.subplots()
    for title, values in plotted.items():
        axes.errorbar(CURVE, values, yerr=[half_width(v, 1000) for v in values], marker="o", capsize=3, label=title)
    axes.set_xscale("log")
    axes.set_xlabel("training scenes")
    axes.set_ylabel("object accuracy, 1 required type")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")
    figure.savefig(path, dpi=110)
