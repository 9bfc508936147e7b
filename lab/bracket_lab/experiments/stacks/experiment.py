"""Table 4 and Fig. 18 on a folder of stacks: a detector, features kept on the disk, planners trained on them."""

from __future__ import annotations

import hashlib
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from bracket_ground.interfaces.stacks import StackedScene
from bracket_lab.evaluations.figures import paper
from bracket_lab.experiments.experiments import Cell, Cells, Values, markdown, shown_share, values_of
from bracket_lab.experiments.stacks.checks import LEARNED, RULES, StackData, StackTraining
from bracket_lab.experiments.stacks.detector import Regions, load_detector, save_detector, train_detector
from bracket_lab.experiments.stacks.planners import Always, StackPlanner, Topmost, train_planner
from bracket_lab.experiments.stacks.scores import OBJECTS, Seen, of_classes, restricted, score
from bracket_lab.experiments.stacks.views import Labelled, StackView, kept_views, labelled
from bracket_lab.learned.training.training_loop import Checkpoint

Boxes = Literal["true", "detected"]
DETECTOR, FIGURE = "detector.pt", "fig18.svg"
BOXES: tuple[Boxes, ...] = ("true", "detected")
TITLES = {
    "default": "default: WL-GNN, decoder that points",
    "paper": "paper: WL-GNN + LSTM_Att",
    "vmrn": "VMRN",
    "gvmrn_rf": "GVMRN-RF",
    "topmost": "topmost by height",
    "always": "always take",
}
PRINTED = {"vmrn": "VMRN", "gvmrn_rf": "GVMRN_RF", "paper": "WL-GNN + LSTM_Att"}  # rows of the paper's Table 4


@dataclass(frozen=True)
class Study:
    """Planners on one folder.

    Attributes:
        folder: keeps detectors and the features of these data.
        seed: of trainings and of the objects that are wanted.
        detector_of: the data that the detector learns from, where it is not these.
    """

    data: StackData
    folder: Path
    settings: StackTraining
    seed: int
    detector_of: StackData | None = None

    def cells(self, counts: Sequence[int], kinds: Sequence[str] = (*LEARNED, *RULES)) -> list[Cell]:
        """Every planner on true and on detected boxes; for several numbers of classes (Fig. 18) on true ones alone."""
        told = {
            "data": data_hash(self.data),
            "detector_of": data_hash(self.detector_data),
            "settings": self.settings.model_dump(mode="json"),
            "seed": self.seed,
        }
        cells = []
        for count in counts:
            for kind in kinds:
                for boxes in BOXES if len(counts) == 1 else BOXES[:1]:
                    if kind == "topmost" and (boxes == "detected" or not self._heights_known):
                        continue  # heights are of true boxes, in data that tell them
                    key = {"planner": kind, "boxes": boxes, "classes": count, "of": list(counts), **told}
                    cells.append(Cell(key, partial(_measure, self, kind, boxes, count, tuple(counts))))
        return cells

    @property
    def detector_data(self) -> StackData:
        """What the detector learns from."""
        return self.data if self.detector_of is None else self.detector_of

    @property
    def _heights_known(self) -> bool:
        return all(item.top_m is not None for scene in self.data.test for item in scene.objects)

    def __hash__(self) -> int:
        return id(self)


def data_hash(data: StackData) -> str:
    """Of labels and splits."""
    return hashlib.sha256(repr((data.trainval, data.test)).encode()).hexdigest()[:16]


def _measure(study: Study, kind: str, boxes: Boxes, count: int, counts: tuple[int, ...]) -> Values:
    test, training = _examples(study, boxes, counts)[count]
    if not test:
        return {}
    planner = _planner(study, kind, count, counts)
    return {**score(planner, test, study.seed), "pictures": len(test), "learned_from": len(training)}


@cache
def _planner(study: Study, kind: str, count: int, counts: tuple[int, ...]) -> StackPlanner:
    if kind in RULES:
        return Topmost() if kind == "topmost" else Always()
    training = _examples(study, "true", counts)[count][1]
    turned = _turned(study)
    both = [each for one in training for each in (one.truth, turned[one.truth.scene.name])]
    settings = study.settings.model_copy(update={"classes": study.data.classes[:count]}).fit_to(len(training))
    return train_planner(kind, both, study.seed, settings, quiet=False)  # type: ignore[arg-type]


@cache
def _examples(study: Study, boxes: Boxes, counts: tuple[int, ...]) -> dict[int, tuple[list[Seen], list[Seen]]]:
    """Pictures for tests and for training by number of classes: as many of each, with as many objects."""
    test = _pictures(study, study.data.test, "test", boxes)
    training = _pictures(study, study.data.trainval, "trainval", "true")
    if len(counts) == 1:
        chosen = study.data.classes[: counts[0]]
        return {counts[0]: (restricted(test, chosen), restricted(training, chosen))}
    tested, learned = (alike({count: of_classes(some, study.data.classes[:count]) for count in counts}, study.seed)
                       for some in (test, training))  # fmt: skip
    return {count: (tested[count], learned[count]) for count in counts}


def alike(pictures: Mapping[int, Sequence[Seen]], seed: int) -> dict[int, list[Seen]]:
    """So many pictures of each set, drawn at random, that all sets have as many with two, three, four, five objects."""
    rng = np.random.default_rng([seed, 24])
    by_size: dict[int, defaultdict[int, list[Seen]]] = {key: defaultdict(list) for key in pictures}
    for key, some in pictures.items():
        for one in some:
            by_size[key][len(one.truth.view.names)].append(one)
    least = Counter({size: min(len(by_size[key][size]) for key in pictures) for size in (1, *OBJECTS)})
    return {
        key: [some[place] for size, some in sorted(sizes.items()) for place in _some(len(some), least[size], rng)]
        for key, sizes in by_size.items()
    }


def _some(count: int, wanted: int, rng: np.random.Generator) -> list[int]:
    """So many places of a list, in order."""
    return sorted(rng.permutation(count)[:wanted].tolist())


@cache
def _pictures(study: Study, scenes: tuple[StackedScene, ...], name: str, boxes: Boxes) -> list[Seen]:
    truths = _labelled(study, scenes, f"{name}_true", turn=False)
    if boxes == "true":
        return [Seen(labelled_frame, labelled_frame.view) for labelled_frame in truths]
    files, regions = [study.data.images[scene.name] for scene in scenes], _regions(study)
    views = kept_views(_file(study, f"{name}_detected.npz"), scenes, files, regions, seen=True, turn=False)
    return [Seen(truth, view) for truth, view in zip(truths, views, strict=True)]


@cache
def _turned(study: Study) -> dict[str, Labelled]:
    """The training pictures turned over, by name."""
    turned = _labelled(study, study.data.trainval, "trainval_turned", turn=True)
    return {labelled_frame.scene.name: labelled_frame for labelled_frame in turned}


def _labelled(study: Study, scenes: tuple[StackedScene, ...], name: str, *, turn: bool) -> list[Labelled]:
    files = [study.data.images[stacked_scene.name] for stacked_scene in scenes]
    views: list[StackView] = kept_views(
        _file(study, f"{name}.npz"), scenes, files, _regions(study), seen=False, turn=turn
    )
    return [labelled(scene, view) for scene, view in zip(scenes, views, strict=True)]


def _file(study: Study, name: str) -> Path:
    """Where the detector is kept, or what it tells of these data."""
    data = study.detector_data
    schedule = study.settings.fit_to(len(data.trainval)).detector
    told = f"{data_hash(data)} {study.settings.share:g} {schedule.model_dump_json()} {study.seed}"
    folder = study.folder / hashlib.sha256(told.encode()).hexdigest()[:12]
    return folder / name if name == DETECTOR or data is study.data else folder / data_hash(study.data) / name


@cache
def _regions(study: Study) -> Regions:
    """The trained detector, of this folder where it is there."""
    path, data = _file(study, DETECTOR), study.detector_data
    if not path.exists():
        images = [data.images[scene.name] for scene in data.trainval]
        settings = study.settings.fit_to(len(images))
        checkpoint = Checkpoint(path.with_suffix(".unfinished"), str(path))
        network = train_detector(data.trainval, images, study.seed, settings, checkpoint=checkpoint, quiet=False)
        save_detector(network, path)
        checkpoint.path.unlink(missing_ok=True)
    return Regions(load_detector(path, study.settings), study.settings.classes)


TITLE = (
    "# Figures: stacks\n"
    "Everyday objects as `cell lab data stacks` draws them: [stacks.md](../stacks.md) says what rows are. In brackets "
    "is the 95 % interval (Wilson)."
)
HEAD = ("planner", "boxes", "OR", "OP", "IA", "paper's IA", *(f"{count} objects" for count in OBJECTS), "paper")


def printed_ia() -> dict[str, str]:
    """The paper's own IA by kind of planner."""
    return {kind: paper().tables["Table 4"].rows[name]["IA"] for kind, name in PRINTED.items()}


def table4(cells: Cells) -> str:
    """Table 4: all planners on all classes that were asked for."""
    most = max((key["classes"] for key, _ in cells), default=0)
    rows = []
    for boxes in BOXES:
        for kind in TITLES:
            wanted: dict[str, Any] = {"planner": kind, "boxes": boxes, "classes": most}
            if not values_of(cells, lambda values: float(bool(values)), **wanted):
                continue
            found = [_share(cells, name, wanted) for name in ("OR", "OP", "IA", "answer")]
            sizes = [_share(cells, f"answer_{count}", wanted) for count in OBJECTS]
            rows.append((TITLES[kind], boxes, *found, *sizes, printed_ia().get(kind, "-")))
    return (
        "## Table 4: stacks\n"
        "OR, OP, IA as VMRN counts: pairs of objects, and pictures with all pairs right. The paper's IA: for one "
        "object of each picture, graspability and, where something lies on it, the text right; by number of objects. "
        f"The last column is the paper's own, on VMRD's photographs.\n\n{markdown(HEAD, rows)}"
    )


def figure18(cells: Cells, drawn: str = "") -> str:
    """Fig. 18: graph and decoder by number of classes.

    Args:
        drawn: where the picture is, as the page names it.
    """
    counts = sorted({key["classes"] for key, _ in cells})
    rows = []
    for kind in LEARNED:
        for part, words in (("graph", "graspability of nodes"), ("decoder", "text")):
            found = [_share(cells, part, {"planner": kind, "boxes": "true", "classes": count}) for count in counts]
            rows.append((TITLES[kind], words, *found))
    head = ("planner", "right", *(f"{count} classes" for count in counts))
    return (
        "## Fig. 18: by number of classes\n"
        "True boxes. As many pictures for each number of classes, with as many objects. Text: of the objects that the "
        "graph rightly calls not graspable."
        + (f" ![graspability and text by number of classes]({drawn})" if drawn else "")
        + f"\n\n{markdown(head, rows)}"
    )


def _share(cells: Cells, name: str, wanted: Mapping[str, Any]) -> str:
    """A share as text, with its interval; a dash where nothing was counted."""
    found = values_of(cells, lambda values: float(values.get(name, np.nan)), **wanted)
    return "-" if not found or np.isnan(found[0]) else shown_share(cells, name, **wanted)


def draw_figure18(cells: Cells, file: Path) -> None:
    """Fig. 18 as a picture."""
    import matplotlib.pyplot as plt

    counts = sorted({key["classes"] for key, _ in cells})
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.5), sharey=True)
    for axis, part in zip(axes, ("graph", "decoder"), strict=True):
        for kind in LEARNED:
            shares = [
                values_of(cells, lambda v: float(v.get(part, np.nan)), planner=kind, boxes="true", classes=count)  # noqa: B023
                for count in counts
            ]
            axis.plot(counts, [some[0] if some else np.nan for some in shares], marker="o", label=TITLES[kind])
        axis.set_title({"graph": "graspability of nodes", "decoder": "text"}[part])
        axis.set_xlabel("classes")
        axis.set_xticks(counts)
    axes[0].set_ylabel("right")
    axes[1].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(file)
    plt.close(figure)
