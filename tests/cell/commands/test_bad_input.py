"""Bad input to `cell run`: status 2, one message with file and line, nothing opened, nothing lost."""

from __future__ import annotations

import contextlib
import math
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bracket_cell.commands.main import main
from bracket_cell.commands.options import CONFIGURATION
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.errors import InputError

PRODUCT = CONFIGURATION.with_name("products.yaml")
NAN, INF = math.nan, math.inf
FAST_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
FAST_DUMPER: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)

# (path in config/cell.yaml, value): what fault injection found to crash, to print a traceback or to be accepted
CELL: list[tuple[str, Any]] = [
    ("bench.overhead.focal_px", INF),
    ("bench.overhead.width_px", 1_000_000_000),
    ("bench.overhead.width_px", True),
    ("bench.overhead.rate_hz", INF),
    ("bench.overhead.rate_hz", 1e12),
    ("bench.overhead.mount.quaternion_wxyz", [0, 0, 0, 0]),
    ("bench.overhead.mount.quaternion_wxyz", [NAN, 0, 0, 1]),
    ("bench.overhead.mount.quaternion_wxyz", [1, 1, 0, 0]),
    ("bench.overhead.triggered", True),
    ("bench.bracket.position_m", [NAN, 0, 0]),
    ("bench.bracket.position_m", [INF, 0, 0]),
    ("bench.tray.size_m", [-0.3, 0.4]),
    ("bench.tray.size_m", [NAN, 0.4]),
    ("bench.tray.size_m", [0.01, 0.01]),
    ("bench.tray.wall_m", -1),
    ("bench.bins_m.o1", [NAN, 0, 0]),
    ("bench.hand_rest_m", [0, 0, INF]),
    ("bench.arm_park_rad", [NAN, 0, 0, 0, 0, 0]),
    ("bench.arm_park_rad", [100, 0, 0, 0, 0, 0]),
    ("bench.arm_look_rad", [50, 0, 0, 0, 0, 0]),
    ("bench.arm_look_rad", [0, 0, 0]),
    ("controller.tick_hz", 1e-9),
    ("controller.tick_hz", True),
    ("controller.max_duration_s", INF),
    ("controller.stop_timeout_s", 1e300),
    ("robot", "ur11"),
    ("robot", {"name": "mine"}),
    ("motion.line_speed_m_s", INF),
    ("motion.line_speed_m_s", 1000),
    ("motion.grasp_depth_m", INF),
    ("guard.wrong_act_s", 1e-300),
    ("devices.gripper.heartbeat_period_s", INF),
    ("devices.gripper.database", "missing.dbc"),
    ("devices.gripper.database", "products.yaml"),
    ("devices.gripper.interface", "nonsense"),
    ("devices.gripper.interface", ""),
    ("devices.gripper.interface", "slcan"),
    ("devices.gripper.interface", "pcan"),
    ("perception.classical.skin_rgb", [NAN, 0, 0]),
    ("devices.arm.kind", "json:loads"),
    ("devices.arm.kind", "json:JSONDecoder"),
    ("devices.panel.kind", "bracket_sim.scene.jobs:RANDOM_GOAL"),
    ("devices.overhead.kind", "recorded"),
    ("settings_of(devices.simulation)", {"shift": True}),
    ("settings_of(devices.simulation)", "missing.yaml"),
    ("log.rotate_mb", 1e-9),
    ("log.folder", 7),
    ("product", "no_such.yaml"),
    ("planners.semantic.kind", "magic"),
    ("planners.semantic.weights", "."),
    ("planners.grasp.kind", "magic"),
    ("planners.grasp.weights", "missing.onnx"),
]
SIMULATION: list[tuple[str, Any]] = [
    ("physics.step_s", 1),
    ("clutter.nearest_gap_m", 0.5),
    ("clutter.nearest_gap_m", 0.05),
    ("person.screw.duration_s", [6, 4]),
    ("person.pause_s", [NAN, 1]),
]
PRODUCTS: list[tuple[str, Any]] = [
    ("parts.o1.size_m", [-0.045, 0.028, 0.02]),
    ("parts.o1.size_m", [NAN, 0.028, 0.02]),
    ("parts.o1.colour_rgb", [2, 0, 0]),
    ("parts.o1.colour_rgb", [NAN, 0, 0]),
    ("parts.o1.mass_kg", 1e6),
    ("parts", {}),
    ("goals", {}),
    ("goals", {"none of these": ["o1", "o1", "o1", "o2", "o2", "o3"]}),
    ("bracket.holes_m.p1", [NAN, 0]),
    ("bracket.holes_m.p1", [50, 0]),
    ("bracket.holes_m.p2", [0, 0.2]),
    ("bracket.holes_m", {}),
]


def set_at(data: dict[str, Any], path: str, value: Any) -> None:
    """Set a value of nested mappings by its dotted path."""
    *way, last = path.split(".")
    for step in way:
        data = data.setdefault(step, {})
    data[last] = value


Change = tuple[str, Any] | None


def write_cell(folder: Path, cell: Change = None, product: Change = None, simulation: Change = None) -> Path:
    """The shipped configuration, product and simulation in a folder, with one value changed."""
    texts = {
        "cell.yaml": (CONFIGURATION, cell),
        "products.yaml": (PRODUCT, product),
        "sim.yaml": (CONFIGURATION.with_name("sim.yaml"), simulation),
    }
    for name, (source, change) in texts.items():
        text = source.read_text(encoding="utf-8")
        if change is not None:
            data = yaml.load(text, FAST_LOADER)
            set_at(data, *change)
            text = yaml.dump(data, Dumper=FAST_DUMPER, sort_keys=False)
        (folder / name).write_text(text)
    return folder / "cell.yaml"


def refused(config: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """The message of a run that is refused before it opens a log."""
    log = config.parent / "log.mcap"
    status = main(["run", "--config", str(config), "--log", str(log)])
    captured = capsys.readouterr()
    assert status == 2, captured.err
    assert captured.out == ""
    assert "Traceback" not in captured.err
    assert not log.exists()
    return captured.err


@pytest.mark.long
@pytest.mark.parametrize(("path", "value"), CELL, ids=[f"{path}={value}" for path, value in CELL])
def test_a_bad_value_of_the_cell(path: str, value: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = write_cell(tmp_path, cell=(path, value))
    assert f"{config}:" in refused(config, capsys).replace("no_such.yaml: cannot", f"{config}: cannot")


@pytest.mark.parametrize(("path", "value"), PRODUCTS, ids=[f"{path}={value}" for path, value in PRODUCTS])
def test_a_bad_value_of_the_product(path: str, value: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = write_cell(tmp_path, product=(path, value))
    assert f"{tmp_path / 'products.yaml'}:" in refused(config, capsys)


@pytest.mark.parametrize(("path", "value"), SIMULATION, ids=[f"{path}={value}" for path, value in SIMULATION])
def test_a_bad_value_of_the_simulation(
    path: str, value: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = write_cell(tmp_path, simulation=(path, value))
    assert f"{tmp_path / 'sim.yaml'}:" in refused(config, capsys)


@pytest.mark.parametrize(
    "text", ["a: \0", "bench: {tray: \x1b[0m}", "controller: {tick_hz: 1:30}", "- 1\n- 2", "a: &a [*a]"]
)
def test_text_that_is_no_configuration(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "cell.yaml"
    config.write_text(text)
    assert f"{config}:1" in refused(config, capsys)


def leaves(data: object, path: str = "") -> Iterator[str]:
    """Dotted paths of all values of nested mappings."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from leaves(value, f"{path}.{key}".lstrip("."))
    else:
        yield path


WRONG: tuple[Any, ...] = (NAN, -INF, {"a": 1}, "\x00", [[]])  # no value of the configuration may be one of these
ALL_LEAVES = [
    *leaves({key: value for key, value in yaml.safe_load(CONFIGURATION.read_text()).items() if key != "product"}),
    *leaves(MotionSettings().model_dump(mode="json"), "motion"),
]


def test_wrong_values_of_any_kind_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every value of the configuration in turn, with a number or shape that it cannot have."""
    rng = random.Random(0)
    inputs = [(path, value) for path in ALL_LEAVES for value in WRONG]
    assert len(inputs) > 300
    let_in = []
    for path, value in rng.sample(inputs, 50):
        config = write_cell(tmp_path, cell=(path, value))
        try:
            assert f"{config}:" in refused(config, capsys), (path, value)
        except AssertionError:
            let_in.append((path, value))
            (tmp_path / "log.mcap").unlink(missing_ok=True)
    assert not let_in


NUMBERS = [NAN, INF, -INF, 1e300, -1e300, 10**400]
ODD = st.one_of(
    st.sampled_from(NUMBERS), st.text(max_size=5), st.booleans(), st.none(), st.lists(st.integers(), max_size=3)
)


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(path=st.sampled_from(sorted(leaves(yaml.safe_load(CONFIGURATION.read_text())["bench"], "bench"))), value=ODD)
def test_no_value_of_the_bench_ends_in_a_traceback(path: str, value: Any, tmp_path: Path) -> None:
    from bracket_cell.configuration import load_configuration

    config = write_cell(tmp_path, cell=(path, value))
    with contextlib.suppress(InputError):
        bench = load_configuration(config).bench
        assert all(math.isfinite(number) for number in [*bench.arm_park_rad, *bench.bracket.position_m])


@pytest.mark.parametrize("taken", ["log.mcap", "log.0003.mcap", "log.png"])
def test_a_log_that_is_there_stays(taken: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / taken).write_bytes(b"my only log")
    for goal in ("g9", "g0"):
        assert main(["run", "--log", str(tmp_path / "log.mcap"), "--goal", goal]) == 2
        assert f"{tmp_path / taken}: exists already" in capsys.readouterr().err
    assert (tmp_path / taken).read_bytes() == b"my only log"


def test_an_address_of_the_page_is_told_by_where_it_was_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = write_cell(tmp_path, cell=("devices.panel", {"kind": "page", "at": "a..b:80"}))
    assert main(["run", "--config", str(config), "--log", str(tmp_path / "log.mcap")]) == 2
    assert f"{config}: devices.panel.at a..b:80: name the host" in capsys.readouterr().err


def test_a_typing_mistake_in_the_goal_leaves_an_old_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "log.mcap").write_bytes(b"my only log")
    assert main(["lab", "run", "--log", str(tmp_path / "log.mcap"), "--overwrite", "--goal", "g9"]) == 2
    assert "unknown goal 'g9'" in capsys.readouterr().err
    assert (tmp_path / "log.mcap").read_bytes() == b"my only log"


@pytest.mark.parametrize("words", [["run", "--log"], ["report"], ["log", "info"]])
@pytest.mark.parametrize("folder", [".", "/"])
def test_a_log_is_no_folder(words: list[str], folder: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*words, folder]) == 2
    assert capsys.readouterr().err.startswith(f"cell: {folder}: ")


def test_a_log_is_no_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--log", str(tmp_path / "x.png")]) == 2
    assert "the name of a log ends in .mcap" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def weaker_cell(folder: Path, **more: object) -> Path:
    """A configuration whose table does nothing about an emergency stop."""
    table = CONFIGURATION.with_name("faults.yaml").read_text()
    (folder / "mine.yaml").write_text(
        table.replace(
            "arm_emergency_stop, action: hold, clear: person", "arm_emergency_stop, action: run, clear: itself"
        )
    )
    values = yaml.safe_load(CONFIGURATION.read_text())
    values |= {"product": str(PRODUCT.resolve()), "faults": "mine.yaml", **more}
    values["devices"]["simulation"] = str(CONFIGURATION.with_name("sim.yaml").resolve())
    path = folder / "cell.yaml"
    path.write_text(yaml.safe_dump(values))
    return path


def test_a_table_that_does_less_than_the_shipped_one_is_refused_unless_that_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["run", "--log", str(tmp_path / "a.mcap"), "--config"]
    assert main([*asked, str(weaker_cell(tmp_path))]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert "arm_emergency_stop: action run is milder than hold" in told
    assert "--unsafe-table" in told
    separation = {"motion": {"separation": {"hand_speed_m_s": 0.01}}, "faults": None}
    assert main([*asked, str(weaker_cell(tmp_path, **separation))]) == 2
    assert "hand_speed_m_s 0.01 is less than 1.6" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "a.mcap").exists()
