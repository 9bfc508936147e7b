"""Detectors and planners of the user's own: by MODULE:CLASS and by entry point, with settings of their own."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_cell.configuration import load_configuration, load_product, located
from bracket_cell.kinds import DETECTORS, PLANNERS, KindSettings, _callable, _installed, files_of, kind_of
from bracket_cell.wiring.detectors import Detectors, check_detectors, latency_s, with_detectors_for
from bracket_cell.wiring.services import load_planners
from bracket_ground.errors import InputError, ModelError
from bracket_ground.files.files import shipped
from bracket_ground.interfaces.planning import AssemblyState

OWN = """
from pathlib import Path
from pydantic import BaseModel

class Reader:
    scores = {"latency_ms_p95": 2.0}

    class Settings(BaseModel):
        shade: float = 0.5
        table: Path | None = None

    def __init__(self, settings, product):
        self.settings, self.positions = settings, product.positions

    def read(self, frame, hand):
        return {}

class Tracker:
    scores = {"palm_p95_mm": 32.0, "pinch_p95_mm": 45.0}
    others = ()

    def track(self, frame):
        return None

class Weighty:
    def __init__(self, weights):
        self.weights = weights

    def read(self, frame, hand):
        return {}

class Mute:
    pass

class Broken:
    def __init__(self):
        raise ZeroDivisionError("by nothing")

class Demanding:
    def __init__(self, motor):
        pass

class Grasper:
    def plan(self, parts, required):
        raise ValueError("no idea")

class Wordy:
    def plan(self, state):
        return "anything"

number = 3
"""


@pytest.fixture
def home(tmp_path: Path) -> Iterator[Path]:
    (tmp_path / "own_kinds.py").write_text(OWN)
    for name in ("sim.yaml", "products.yaml", "faults.yaml"):
        (tmp_path / name).write_text(shipped("bracket_cell.config", name).read_text())
    before = sys.path[:]
    yield tmp_path
    sys.path[:] = before
    sys.modules.pop("own_kinds", None)


def configured(home: Path, perception: str = "", planners: str = "") -> Path:
    """A configuration with these lines in its sections."""
    text = shipped("bracket_cell.config", "cell.yaml").read_text()
    if perception:
        text = text.replace("  kind: learned ", f"  {perception}\n  kind: learned ")
    if planners:
        text = text.replace("\n  grasp:\n    kind: pairwise", f"\n  grasp:\n    {planners}\n   ")
    (home / "cell.yaml").write_text(text)
    return home / "cell.yaml"


def refused(path: Path) -> str:
    """Why detectors or planners of a configuration cannot be made."""
    try:
        configuration = load_configuration(path)
        product = load_product(configuration)
        with located(path, configuration):
            check_detectors(configuration.bench, product, configuration.perception)
            load_planners(configuration, product)
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("use", [*DETECTORS, *PLANNERS])
def test_every_kind_names_what_there_is(use: str) -> None:
    for kind in (*(DETECTORS | PLANNERS)[use], *_installed(use)):
        found = kind_of(use, KindSettings(kind=kind))
        assert callable(_callable(found.make))
        assert files_of(use, KindSettings(kind=kind)) or not found.card


def test_a_class_of_ones_own_is_made_with_what_it_asks_for(home: Path) -> None:
    (home / "table.csv").write_text("1")
    path = configured(home, 'holes: {kind: "own_kinds:Reader", shade: 0.25, table: table.csv}')
    configuration = load_configuration(path)
    product, perception = load_product(configuration), configuration.perception
    check_detectors(configuration.bench, product, perception)
    reader = Detectors(configuration.bench, product, perception).make("holes")
    assert (reader.settings.shade, reader.positions) == (0.25, product.positions)
    assert perception.files("holes") == {"holes.table": home / "table.csv"}
    assert latency_s(perception, "holes") == pytest.approx(0.012)


def test_the_errors_that_a_tracker_says_it_has_count_for_separation(home: Path) -> None:
    configuration = load_configuration(configured(home, 'hands: {kind: "own_kinds:Tracker"}'))
    seen, _ = with_detectors_for(configuration, load_product(configuration))
    assert seen.motion.separation.hand_error_m == pytest.approx(0.045)


def test_weights_are_what_a_class_asks_for(home: Path) -> None:
    (home / "mine.bin").write_bytes(b"1")
    configuration = load_configuration(configured(home, 'holes: {kind: "own_kinds:Weighty", weights: mine.bin}'))
    product = load_product(configuration)
    assert configuration.perception.files("holes") == {"holes": home / "mine.bin"}
    made = Detectors(configuration.bench, product, configuration.perception).make("holes")
    assert made.weights == home / "mine.bin"


@pytest.mark.parametrize(
    ("perception", "words"),
    [
        ('holes: {kind: "own_kinds:Nothing"}', "own_kinds has no class 'Nothing'"),
        ('holes: {kind: "own_kinds:number"}', "own_kinds has no class 'number'"),
        ('holes: {kind: "nowhere:Reader"}', "no module 'nowhere'; looked for in"),
        ('holes: {kind: "own_kinds:Mute"}', "own_kinds:Mute lacks read"),
        ('hands: {kind: "own_kinds:Reader"}', "own_kinds:Reader lacks track, others"),
        ('holes: {kind: "own_kinds:Broken"}', "own_kinds:Broken cannot be made: ZeroDivisionError: by nothing"),
        ('holes: {kind: "own_kinds:Demanding"}', "asks for motor; there is: "),
        ('holes: {kind: "own_kinds:Reader", shades: 1}', "unknown key 'shades'; did you mean 'shade'"),
        ('holes: {kind: "own_kinds:Reader", shade: dark}', "holes.shade: "),
        ('holes: {kind: "own_kinds:Reader", weights: x.onnx}', "unknown key 'weights'"),
        ('holes: {kind: "own_kinds:Weighty"}', "needs a file of weights"),
        ("holes: {kind: plates}", "no kind 'plates' of holes; legal: plate, classical, none, or MODULE:CLASS"),
        ("parts: {kind: rcnm}", "legal: centre, onnx, classical, rcnn, or MODULE:CLASS"),
        ("holes: {kind: plate, wieghts: x}", "unknown key 'wieghts'; did you mean 'weights'"),
    ],
)
def test_what_is_wrong_with_a_detector_is_told_with_its_line(home: Path, perception: str, words: str) -> None:
    told = refused(configured(home, perception))
    assert words in told
    assert "cell.yaml:44:" in told


def test_installed_kinds_are_entry_points(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    packaged = home / "acme-1.0.dist-info"
    packaged.mkdir()
    (packaged / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n")
    points = "[cell.detectors]\nquick = own_kinds:Reader\nparts.quick = own_kinds:Mute\n"
    (packaged / "entry_points.txt").write_text(f"{points}[cell.planners]\ngrasp.sure = own_kinds:Grasper\n")
    monkeypatch.syspath_prepend(home)
    configuration = load_configuration(configured(home, "holes: {kind: quick}", "kind: sure"))
    product = load_product(configuration)
    check_detectors(configuration.bench, product, configuration.perception)
    assert kind_of("grasp", configuration.planners.grasp).make.__name__ == "Grasper"  # type: ignore[union-attr]
    assert "quick lacks detect" in refused(configured(home, "parts: {kind: quick}"))
    assert "legal: plate, classical, none, quick, or MODULE" in refused(configured(home, "holes: {kind: slow}"))


def test_a_planner_that_raises_cannot_answer_and_others_do(home: Path) -> None:
    configuration = load_configuration(configured(home, planners='kind: "own_kinds:Grasper"'))
    planners = load_planners(configuration, load_product(configuration))
    with pytest.raises(ModelError, match="own_kinds:Grasper: ValueError: no idea"):
        planners.grasp.plan((), 0)
    assert files_of("grasp", configuration.planners.grasp) == {}


def test_an_answer_of_another_type_is_none(home: Path) -> None:
    path = configured(home)
    path.write_text(path.read_text().replace("kind: auto", 'kind: "own_kinds:Wordy"'))
    configuration = load_configuration(path)
    planner = load_planners(configuration, load_product(configuration)).semantic
    with pytest.raises(ModelError, match="own_kinds:Wordy: answered str, not AssemblyPlan"):
        planner.plan(AssemblyState({}))


@pytest.mark.long
def test_a_run_with_own_classes_is_logged_and_its_replay_loads_none_of_them(
    home: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = configured(home, 'holes: {kind: "own_kinds:Reader", shade: 0.1}', 'kind: "own_kinds:Grasper"')
    path.write_text(path.read_text().replace("max_duration_s: ", "max_duration_s: 1 # "))
    log = home / "run.mcap"
    assert main(["run", "--config", str(path), "--log", str(log)]) != 2
    sys.modules.pop("own_kinds")
    assert main(["replay", str(log)]) == 2
    told = capfd.readouterr().err
    assert "Traceback" not in told
    assert "recorded with classes of the user's own, holes own_kinds:Reader, grasp own_kinds:Grasper" in told
    assert "own_kinds" not in sys.modules
    assert main(["replay", str(log), "--config", str(path)]) in (0, 1)
