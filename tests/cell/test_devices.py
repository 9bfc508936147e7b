"""The seam to real devices: drivers of one's own are found, get their own settings alone, and work in any role."""

from __future__ import annotations

import json
import re
import sys
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
import scipy.optimize  # noqa: F401 - `home` forgets what a test imports, and neither this
import yaml
from rich.console import Console

from bracket_cell.commands.main import main
from bracket_cell.configuration import Configuration, load_configuration, load_product
from bracket_cell.runs.options import RunOptions
from bracket_cell.runs.run import run
from bracket_cell.runs.signing import sign
from bracket_cell.skills.drivers.can_gripper import CanGripper
from bracket_cell.wiring.devices import attached, find_drivers
from bracket_cell.wiring.safety import safety_from
from bracket_ground.errors import DeviceFault, InputError
from bracket_ground.interfaces.clock import ManualClock, WallClock
from bracket_ground.interfaces.command import GripperCommand
from bracket_ground.interfaces.devices import NoGripper
from bracket_sim import simulator  # noqa: F401 - nor this can be imported twice
from tests import ROOT
from tests.cell.conftest import changed_configuration
from tests.processes import finished

GUIDE = (ROOT / "docs" / "drivers.md").read_text()
REAL = """
import sys
from pathlib import Path

from pydantic import BaseModel, Field


class Settings(BaseModel):
    host: str
    gain: float = Field(default=1.0, gt=0)
    certificate: Path | None = None


class Device:
    Settings = Settings

    def __init__(self, settings, clock, bench, product, robot):
        self.settings, self.clock, self.robot = settings, clock, robot
        self.closed = False

    def nothing(self, *_):
        raise SystemExit(3)

    state = follow = stop = pace = acknowledge = samples = nothing
    activate = command = hold = trigger = latest = show = alarm = read = write = nothing

    def close(self):
        self.closed = True


class Modest(Device):
    def __init__(self):
        pass


class Greedy(Device):
    def __init__(self, settings, port):
        pass


class InFront(Device):
    def __init__(self, settings, simulated=None):
        self.behind = simulated


class Half:
    Settings = Settings

    def state(self):
        pass


class Broken(Device):
    def __init__(self, settings):
        raise OSError("no route to host")


class Odd(Device):
    Settings = dict


number = 3
"""
ROLES = ("arm", "gripper", "overhead", "wrist", "panel")


def configured(folder: Path, **devices: Any) -> Path:
    """A folder of a user: config/cell.yaml with these devices, and lab.py beside config."""
    path = changed_configuration(folder / "config", "", "")
    (folder / "lab.py").write_text(REAL)
    data = yaml.safe_load(path.read_text())
    data["devices"] = devices
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    return path


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder; what is imported from it is forgotten."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", sys.path[:])
    monkeypatch.delitem(sys.modules, "lab", raising=False)
    monkeypatch.setattr(sys, "modules", sys.modules.copy())
    return tmp_path


def all_real(name: str = "Device", **more: object) -> dict[str, Any]:
    return {role: {"kind": f"lab:{name}", "host": "192.0.2.10", **more} for role in ROLES}


def refused(path: Path) -> str:
    with pytest.raises(InputError) as error:
        find_drivers(load_configuration(path))
    return str(error.value)


def test_drivers_in_the_working_folder_get_their_own_settings_and_what_they_ask_for(home: Path) -> None:
    path = configured(home, **all_real(certificate="keys/cell.pem"))
    configuration = load_configuration(path)
    product = load_product(configuration, path)
    assert configuration.devices.simulated == ()
    with attached(configuration, product) as devices:
        arm: Any = devices.arm
        assert (arm.settings.host, arm.settings.gain) == ("192.0.2.10", 1.0)
        assert arm.settings.certificate == path.parent.resolve() / "keys" / "cell.pem"
        assert arm.clock is devices.clock
        assert isinstance(devices.clock, WallClock)
        assert arm.robot == configuration.robot
        assert devices.report() == {}
    assert all(getattr(devices, role).closed for role in ROLES)


@pytest.mark.usefixtures("home")
def test_a_driver_beside_the_configuration_is_found(tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("elsewhere")
    path = configured(folder, **all_real())
    (folder / "lab.py").rename(path.parent / "lab.py")
    assert set(find_drivers(load_configuration(path))) == set(ROLES)


@pytest.mark.long
def test_the_simulator_is_not_loaded_for_real_devices(home: Path) -> None:
    path = configured(home, **all_real())
    sign(path, safety_from(path), "tests")
    code = (
        "import sys; from pathlib import Path; from rich.console import Console;"
        "from bracket_cell.runs import run as runs;"
        "from bracket_cell.runs.options import RunOptions;"
        "run = lambda: runs.run(RunOptions(configuration=Path('config/cell.yaml')), Console(quiet=True));"
        "\ntry: run()\nexcept SystemExit: pass\nprint('mujoco' in sys.modules, 'lab' in sys.modules)"
    )
    done = finished([sys.executable, "-c", code], home, {"PYTHONPATH": str(ROOT)})
    assert done.stdout.splitlines()[-1:] == ["False True"], done.stderr


@pytest.mark.parametrize(
    ("device", "words"),
    [
        ({"kind": "lab:Device"}, "key 'host' is missing"),
        ({"kind": "lab:Device", "host": "a", "gain": -1}, "arm.gain: Input should be greater than 0"),
        ({"kind": "lab:Device", "hots": "a"}, "unknown key 'hots'; did you mean 'host'? legal here: kind, host, gain"),
        ({"kind": "lab:Nobody"}, "lab has no class 'Nobody'"),
        ({"kind": "lab:number"}, "lab has no class 'number'"),
        ({"kind": "lap:Device"}, "no module 'lap'; looked for in"),
        ({"kind": "lab:Half", "host": "a"}, "lab:Half lacks follow, stop, pace, acknowledge, samples, close"),
        ({"kind": "lab:Greedy", "host": "a"}, "the driver asks for port; there is: settings, clock, bench"),
        ({"kind": "lab:Odd"}, "lab:Odd.Settings is not a pydantic model"),
        ({"kind": "can"}, "no kind 'can' of arm; legal: simulated, ur, ros2, recorded, or MODULE:CLASS"),
        ({"kind": "recorded"}, "key 'log' is missing"),
    ],
)
def test_what_is_wrong_with_a_driver_is_told(home: Path, device: dict[str, Any], words: str) -> None:
    assert words in refused(configured(home, **{**all_real(), "arm": device}))


def test_a_driver_without_settings_takes_none(home: Path) -> None:
    modest = {"kind": "lab:Modest", "host": "a"}
    assert find_drivers(load_configuration(configured(home, **{**all_real(), "panel": modest})))["panel"].asks == ()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("raise RuntimeError('no bus')", "lab cannot be loaded: RuntimeError: no bus"),
        ("def", "lab cannot be loaded: SyntaxError"),
        ("import sys\nsys.exit(0)", "lab cannot be loaded: SystemExit: 0"),
        ("import nothing_at_all", "no module 'nothing_at_all'"),
        ("", "lab has no class 'Device'"),
    ],
)
def test_a_module_that_cannot_be_loaded_is_told_with_its_line(
    home: Path, text: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = configured(home, **all_real())
    (home / "lab.py").write_text(text)
    assert main(["run", "--config", str(path), "--log", "log.mcap"]) == 2
    told = capsys.readouterr().err
    line = next(n for n, one in enumerate(path.read_text().splitlines(), 1) if "lab:Device" in one)
    assert f"{path}:{line}:" in told
    assert words in told
    assert not Path("log.mcap").exists()


def test_a_device_that_cannot_be_opened_is_a_fault_and_the_others_are_closed(home: Path) -> None:
    path = configured(home, **{**all_real(), "panel": {"kind": "lab:Broken", "host": "a"}})
    configuration = load_configuration(path)
    with (
        pytest.raises(DeviceFault, match="panel: cannot be opened: OSError: no route to host"),
        attached(configuration, load_product(configuration, path)),
    ):
        pass


def test_a_real_arm_with_simulated_cameras_is_refused_by_name(home: Path) -> None:
    own = {"kind": "lab:Device", "host": "a"}
    told = refused(configured(home, arm=own))
    assert "devices.arm.kind: arm cannot work with the simulated gripper, overhead, wrist, panel" in told
    assert set(find_drivers(load_configuration(configured(home, gripper=own, panel=own)))) == {"gripper", "panel"}
    in_front = {"kind": "lab:InFront", "host": "a"}
    assert "arm" in find_drivers(load_configuration(configured(home, arm=in_front)))


def test_a_driver_in_front_of_the_simulator_gets_its_device_and_nothing_else(home: Path) -> None:
    from tests.cell.fakes import Rig

    path = configured(home, arm={"kind": "lab:InFront", "host": "a"}, panel={"kind": "none"})
    configuration = load_configuration(path)
    simulated = Rig().devices
    with attached(configuration, load_product(configuration, path), simulated) as devices:
        arm: Any = devices.arm
        assert arm.behind is simulated.arm
        assert devices.gripper is simulated.gripper
        assert devices.panel is not simulated.panel
        assert isinstance(devices.clock, ManualClock)


def test_names_of_installed_drivers_are_entry_points(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from importlib.metadata import EntryPoint, EntryPoints

    point = EntryPoint("acme", "lab:Device", "cell.devices")
    monkeypatch.setattr("bracket_cell.plugins.entry_points", lambda **by: EntryPoints([point]).select(**by))
    path = configured(home, **{**all_real(), "arm": {"kind": "acme", "host": "a"}})
    assert find_drivers(load_configuration(path))["arm"].make.__name__ == "Device"
    told = refused(configured(home, arm={"kind": "acne"}))
    assert "legal: simulated, ur, ros2, recorded, acme, or MODULE:CLASS" in told


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "guard:",
            "gripper_can: {channel: can0}\nguard:",
            "key 'gripper_can' has moved; the gripper is one of the dev",
        ),
        ("guard:", "signals: {inputs: {a: 1}}\nguard:", "key 'signals' has moved; signals are one of the devices now"),
        (
            "  panel:",
            "  factory: lab:open_cell\n  panel:",
            "key 'factory' has moved; each device has its own driver now",
        ),
        ("simulation: sim.yaml #", "simulation: {shift: true} #", "the simulator's settings are a file of their own"),
        ("guard:", "motion: {tcp_from_tool0_m: 0.2}\nguard:", "key 'tcp_from_tool0_m' has moved; the gripper's file"),
        (
            "guard:",
            "motion: {contact_lag_m: 0.003}\nguard:",
            "key 'contact_lag_m' is no longer set by files",
        ),
        ("guard:", "motion: {separation: {hand_height_m: 0.4}}\nguard:", "'hand_height_m' is no longer set by files"),
        ("  kind: learned", "  classical: {still_m: 0.01}\n  kind: learned", "it is 0.006 in every cell"),
        ("log:", "log:\n  buffer_mb: 8", "key 'buffer_mb' is no longer set by files"),
        (
            "  overhead: {kind: simulated}",
            "  overhead: {kind: simulated, fps: 3}",
            "unknown key 'fps'; legal here: kind",
        ),
        (
            "heartbeat_period_s",
            "heartbeat_period",
            "unknown key 'heartbeat_period'; did you mean 'heartbeat_period_s'?",
        ),
    ],
)
def test_the_form_of_before_is_refused_with_the_new_one(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = changed_configuration(tmp_path, old, new)
    with pytest.raises(InputError) as error:
        load_configuration(path)
    assert words in str(error.value)
    assert re.match(rf"{re.escape(str(path))}:\d+:\d+: ", str(error.value))


def test_a_mistake_in_the_simulators_file_is_told_with_its_line(tmp_path: Path) -> None:
    path = changed_configuration(tmp_path, "", "")
    (tmp_path / "sim.yaml").write_text("hardware: ur10_usb\nphysic: {}\n")
    with pytest.raises(InputError, match=r"sim\.yaml:2:1: unknown key 'physic'"):
        load_configuration(path)


SIMULATED = {role: {"kind": "simulated"} for role in ROLES} | {"simulation": "sim.yaml"}


@pytest.mark.parametrize(
    ("gripper", "kind", "words"),
    [
        ("none", "can", "can moves fingers, and none has none; legal: none"),
        ("magnet", "can", "can moves fingers, and magnet has none; legal: simulated, or MODULE:CLASS"),
        ("2f85", "none", "none moves nothing, and 2f85 holds parts; write gripper: none"),
    ],
)
def test_a_gripper_and_its_driver_fit_each_other(tmp_path: Path, gripper: str, kind: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        load_configuration(with_gripper(tmp_path, gripper, kind))


def test_a_cell_without_a_gripper_has_a_device_that_holds_nothing_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = with_gripper(tmp_path, "none", "none")
    assert find_drivers(load_configuration(path))["gripper"].make is NoGripper
    gripper = NoGripper(ManualClock())
    gripper.command(GripperCommand(0.01))
    assert (gripper.state().opening_m, gripper.state().holding) == (0.01, False)
    main(["check", str(ROOT / "trees" / "assemble.xml"), "--config", str(path)])
    assert "the arm has no gripper: the cell watches, and the person places every part" in capsys.readouterr().err


def with_gripper(folder: Path, gripper: str, kind: str) -> Path:
    """A simulated cell with another gripper, and a device of some kind."""
    path = configured(folder, **{**SIMULATED, "gripper": {"kind": kind}})
    path.write_text(path.read_text().replace("robot: ur10", f"robot: ur10\ngripper: {gripper}"))
    return path


def test_the_shipped_cell_has_a_gripper_on_can_in_front_of_the_simulator() -> None:
    configuration: Configuration = load_configuration()
    drivers = find_drivers(configuration)
    assert [(driver.role, driver.make) for driver in drivers.values()] == [("gripper", CanGripper)]
    assert configuration.devices.virtual_channels == ("gripper",)


def from_the_guide(folder: Path) -> Path:
    """A new folder with what docs/drivers.md prints, typed as printed, and nothing else."""
    (made,) = re.findall(r"```yaml\n(devices:.*?)```", GUIDE, re.DOTALL)
    (driver,) = re.findall(r"```python\n(.*?)```", GUIDE, re.DOTALL)
    assert main(["init", str(folder)]) == 0
    (folder / "acme.py").write_text(driver)
    path = folder / "config" / "cell.yaml"
    text = path.read_text()
    begin, end = text.index("devices:"), text.index("log:\n")
    path.write_text(text[:begin] + made + "\n" + text[end:])
    return path


def run_in(folder: Path, *arguments: str) -> dict[str, Any]:
    done = finished(
        [sys.executable, "-m", "bracket_cell", "run", *arguments, "--json"], folder, {"PYTHONPATH": str(ROOT)}
    )
    assert done.stdout, done.stderr
    line: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return line


@pytest.mark.long
def test_an_arm_and_a_gripper_of_a_made_up_maker_move(tmp_path: Path) -> None:
    from_the_guide(tmp_path / "mine")
    tree = '<Sequence><ActivateGripper/><MoveTo pose="look"/></Sequence>'
    text = f'<root BTCPP_format="4"><BehaviorTree ID="M">{tree}</BehaviorTree></root>'
    (tmp_path / "mine" / "short.xml").write_text(text)
    line = run_in(tmp_path / "mine", "short.xml", "--seed", "3", "--log", "run.mcap")
    assert line["end"] == "finished", line


@pytest.mark.slow
def test_an_arm_and_a_gripper_of_a_made_up_maker_assemble_a_bracket(tmp_path: Path) -> None:
    from_the_guide(tmp_path / "mine")
    line = run_in(tmp_path / "mine", "--goal", "g0", "--seed", "3", "--log", "run.mcap")
    assert (line["end"], line["correct"]) == ("finished", True), line
    assert line["robot_placements"] > 0


def test_a_panel_of_the_kind_page_is_the_operator_s_page(tmp_path: Path) -> None:
    path = changed_configuration(tmp_path, "panel: {kind: simulated}", 'panel: {kind: page, at: "0"}')
    tree = tmp_path / "short.xml"
    tree.write_text('<root BTCPP_format="4"><BehaviorTree ID="M"><Sleep msec="200"/></BehaviorTree></root>')
    told = StringIO()
    options = RunOptions(tree, path, log=tmp_path / "log.mcap", pixels=False)
    assert run(options, Console(file=told, soft_wrap=True)).end == "finished"
    assert "the operator's page: http://127.0.0.1:" in told.getvalue()
