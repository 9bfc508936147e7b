"""Kinds of detectors and planners: the shipped ones by a table, those of others by entry point or MODULE:CLASS."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import FunctionType
from typing import Any

from pydantic import BaseModel, model_validator

from bracket_cell.plugins import Chosen, Location, asked, attribute, found_by, lacking, offered_by_packages, settings_of
from bracket_ground.errors import CellError, ModelError, SettingError
from bracket_ground.files.files import shipped
from bracket_ground.files.model import Disagreement
from bracket_ground.files.yaml_file import suggestion
from bracket_ground.interfaces.perception import ActionDetector, HandTracker, HoleReader, PartDetector
from bracket_ground.interfaces.planning import AssemblyPlan, GraspPlan, GraspPlanner, SemanticPlanner, weights_file

WEIGHTS = shipped("bracket_cell.learned", "weights")
Files = dict[str, Path]  # of weights, by their names in logs, as hands and hands.finder; the main file first


@dataclass(frozen=True)
class Kind:
    """How detectors or planners of one kind are made.

    Attributes:
        make: its class, or a function, or MODULE:NAME of such: given what its parameters name, of what `made` offers.
        files: function, or its MODULE:NAME, from the configured file of weights, or None, and the folder of weights to
            all files that answers depend on.
        card: its main file has a model card.
        scores: where there is no card, what it would say: latency_ms_p95 of an answer, and of a hand tracker
            palm_p95_mm and pinch_p95_mm.
        crops: the same of the network with features of crops that a grasp planner needs, from its own file of weights.
    """

    make: Callable[..., Any] | str
    files: Callable[[Path | None, Path], Files] | str | None = None
    card: bool = False
    scores: Mapping[str, float] = field(default_factory=dict)
    crops: Callable[[Path], Path] | None = None


Table = dict[str, dict[str, Kind | Callable[..., Any]]]  # by use and kind
DETECTORS: Table = {
    "hands": {
        "slim": Kind(
            "bracket_cell.learned.hands.model:slim_tracker", "bracket_cell.learned.hands.model:slim_files", card=True
        ),
        "classical": lambda classical: classical.hands(),
        "both": Kind(
            "bracket_cell.learned.hands.joint:joint_tracker",
            "bracket_cell.learned.hands.mediapipe.tracker:mediapipe_files",
        ),
        "mediapipe": Kind(
            "bracket_cell.learned.hands.mediapipe.tracker:mediapipe_tracker",
            "bracket_cell.learned.hands.mediapipe.tracker:mediapipe_files",
        ),
    },
    "actions": {
        "slim": Kind("bracket_cell.learned.actions.model:load_actions", card=True),
        "classical": lambda classical: classical.actions(),
    },
    "holes": {
        "plate": Kind("bracket_cell.learned.holes.model:PlateHoleReader.load", card=True),
        "classical": lambda classical: classical.holes(),
        "none": Kind("bracket_cell.learned.bench_watcher:NoHoleReader", scores={"latency_ms_p95": 0.0}),
    },
    "parts": {
        "centre": Kind(
            "bracket_cell.learned.parts.model:CentrePartDetector.load",
            "bracket_cell.learned.parts.model:centre_files",
            card=True,
        ),
        "onnx": Kind(
            "bracket_cell.learned.parts.yolo:YoloPartDetector.load", "bracket_cell.learned.parts.yolo:onnx_files"
        ),
        "classical": lambda classical: classical.parts(),
    },
}
TRAINED_DEFAULTS = {task: next(iter(kinds)) for task, kinds in DETECTORS.items()}  # the first of each task
PLANNERS: Table = {
    "semantic": {
        "auto": Kind("bracket_cell.learned.semantic.model:load_semantic_planner", card=True),
        "factored": Kind("bracket_cell.learned.semantic.model:load_semantic_planner", card=True),
        "bayes": Kind("bracket_cell.learned.semantic.model:BayesPlanner"),
    },
    "grasp": {
        "pairwise": Kind("bracket_cell.learned.grasp.model:PairwisePlanner.load", card=True),
        "rule": Kind("bracket_cell.learned.grasp.model:RulePlanner"),
    },
}
PROTOCOLS: Mapping[str, type] = {
    "hands": HandTracker, "actions": ActionDetector, "holes": HoleReader, "parts": PartDetector,
    "semantic": SemanticPlanner, "grasp": GraspPlanner,
}  # fmt: skip
ANSWERS: Mapping[str, type] = {"semantic": AssemblyPlan, "grasp": GraspPlan}


class KindSettings(Chosen):
    """An implementation, with its own settings next to these.

    Attributes:
        kind: which implementation answers: of the project, a name of the entry points `cell.detectors` or
            `cell.planners`, or MODULE:CLASS.
        weights: file of weights, relative to this file; the shipped one of this kind by default.
    """

    weights: Path | None = None

    @model_validator(mode="after")
    def _shipped_kinds_have_no_other_keys(self) -> KindSettings:
        if any(self.kind in kinds for kinds in (DETECTORS | PLANNERS).values()):
            fields = type(self).model_fields
            wrong = [((name,), f"unknown key {name!r}; {suggestion(name, tuple(fields))}") for name in self.settings]
            if wrong:
                raise Disagreement(wrong)
        return self


def section_of(use: str) -> Location:
    """Where the configuration has a use: hands, actions, holes, parts, semantic or grasp."""
    return ("perception" if use in DETECTORS else "planners", use)


def kind_of(use: str, chosen: KindSettings) -> Kind:
    """The kind that is chosen for a use.

    Raises:
        SettingError: there is none, or it cannot be loaded.
    """
    shipped_kinds, wanted = (DETECTORS | PLANNERS)[use], (type, FunctionType, Kind)
    found = shipped_kinds.get(chosen.kind)
    if found is None:
        found = found_by(chosen.kind, _installed(use), section_of(use), chosen.folder, shipped_kinds, wanted)
    return found if isinstance(found, Kind) else Kind(found, scores=getattr(found, "scores", {}))


def _installed(use: str) -> dict[str, str]:
    """MODULE:NAME by kind: an entry point's name is USE.KIND, or the kind alone where it serves any use."""
    group = "cell.detectors" if use in DETECTORS else "cell.planners"
    offered = offered_by_packages(group)
    others = PROTOCOLS.keys() - {use}
    return {name.removeprefix(f"{use}."): value for name, value in offered.items() if name.split(".")[0] not in others}


def files_of(use: str, chosen: KindSettings, folder: Path = WEIGHTS) -> Files:
    """All files that the answers depend on, by their names in logs.

    Args:
        folder: of weights.

    Raises:
        SettingError: as `kind_of`, or its settings are wrong.
    """
    kind = kind_of(use, chosen)
    if kind.files is not None:
        files: Files = _callable(kind.files)(chosen.weights, folder)
        return files
    if kind.card:
        return {use: chosen.weights or folder / weights_file(use, chosen.kind)}
    named = {} if chosen.weights is None else {use: chosen.weights}
    own = {f"{use}.{name}": path for name, path in _settings(use, kind, chosen) if isinstance(path, Path)}
    return {name: path for name, path in (named | own).items() if path.is_file()}


def made(use: str, chosen: KindSettings, folder: Path = WEIGHTS, **offered: object) -> Any:
    """The detector or planner itself.

    Args:
        folder: of weights.
        offered: what its class may ask for beside settings, kind, files, and weights, which is the first of these.

    Raises:
        SettingError: there is no such kind, its settings are wrong, or its class raised something.
        CellError: as its class raised it.
    """
    kind, place = kind_of(use, chosen), (*section_of(use), "kind")
    make, files, settings = _callable(kind.make), files_of(use, chosen, folder), _settings(use, kind, chosen)
    weights = next(iter(files.values()), chosen.weights)
    offered = {**offered, "settings": settings, "kind": chosen.kind, "files": files, "weights": weights}
    names = asked(make, offered, section_of(use), "class")
    if "weights" in names and weights is None:
        raise SettingError((place, f"{chosen.kind} needs a file of weights: add `weights: FILE` next to kind"))
    try:
        answer = make(**{name: offered[name] for name in names})
    except CellError:
        raise
    except (Exception, SystemExit) as error:  # a user's class may raise anything, or end the program
        raise SettingError((place, f"{chosen.kind} cannot be made: {type(error).__name__}: {error}")) from error
    if missing := lacking(answer, PROTOCOLS[use]):
        raise SettingError((place, f"{chosen.kind} lacks {', '.join(missing)}; see `cell docs drivers`"))
    return _Guarded(chosen.kind, answer, ANSWERS[use]) if use in ANSWERS and not isinstance(kind.make, str) else answer


class _Guarded:
    """A planner of the user's own: where it raises, or answers something else than a plan, it cannot answer."""

    def __init__(self, kind: str, planner: Any, wanted: type) -> None:
        self._kind, self._planner, self._wanted = kind, planner, wanted

    def plan(self, *question: Any) -> Any:
        try:
            answer = self._planner.plan(*question)
        except CellError:
            raise
        except Exception as error:
            raise ModelError(f"{self._kind}: {type(error).__name__}: {error}") from error
        if not isinstance(answer, self._wanted):
            raise ModelError(f"{self._kind}: answered {type(answer).__name__}, not {self._wanted.__name__}")
        return answer


def _callable(named: Callable[..., Any] | str) -> Callable[..., Any]:
    return attribute(named) if isinstance(named, str) else named


def _settings(use: str, kind: Kind, chosen: KindSettings) -> BaseModel:
    """Of the class's own model; weights are one of them where the class does not ask for them."""
    make, given = _callable(kind.make), chosen.settings
    if chosen.weights is not None and not {"weights", "files"} & inspect.signature(make).parameters.keys():
        given["weights"] = chosen.weights
    return settings_of(make, chosen.kind, given, section_of(use), chosen.folder)
