"""Table 4 and Fig. 18 on a folder of stacks: a detector, features kept on the disk, planners trained on them."""

from __future__ import annotations

import hashlib
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Literal

import numpy as np

from bracket_ground.interfaces.stacks import StackedScene
from bracket_lab.evaluations.figures import paper
from bracket_lab.experiments.experiments import Cell, Values
from bracket_lab.experiments.stacks.checks import LEARNED, RULES, StackData, StackTraining
from bracket_lab.experiments.stacks.detector import Regions, load_detector, save_detector, train_detector
from bracket_lab.experiments.stacks.planners import Always, StackPlanner, Topmost, train_planner
from bracket_lab.experiments.stacks.scores import OBJECTS, Seen, of_classes, restricted, score
from bracket_lab.experiments.stacks.views import Labelled, StackView, kept_views, labelled
from bracket_lab.learned.training.training_loop import Checkpoint

Boxes = Literal["true", "detected"]
DETECTOR = "detector.pt"
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
        fields = {
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
                    key = {"planner": kind, "boxes": boxes, "classes": count, "of": list(counts), **fields}
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
    both = [each for sample in training for each in (sample.truth, turned[sample.truth.scene.name])]
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
        for sample in some:
            by_size[key][len(sample.truth.view.names)].append(sample)
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
    text = f"{data_hash(data)} {study.settings.share:g} {schedule.model_dump_json()} {study.seed}"
    folder = study.folder / hashlib.sha256(text.encode()).hexdigest()[:12]
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


def printed_ia() -> dict[str, str]:
    """The paper's own IA by kind of planner."""
    return {kind: paper().tables["Table 4"].rows[name]["IA"] for kind, name in PRINTED.items()}
