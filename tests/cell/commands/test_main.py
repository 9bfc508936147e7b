"""The command line: exit statuses, clear messages, nothing moved on bad input."""

from __future__ import annotations

import errno
import io
import json
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import cv2
import pytest

from bracket_cell.commands.main import main
from bracket_cell.commands.options import CONFIGURATION
from bracket_cell.commands.run import TREE
from bracket_cell.commands.terminal import BESIDE
from btxml.views.picture import draws_text
from tests import ROOT
from tests.processes import finished


def complaint(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """Standard error of a command that must end with status 2 and without a traceback."""
    status = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    assert status == 2
    assert captured.out == ""
    assert "Traceback" not in captured.err
    return captured.err


def test_a_broken_tree_is_named_by_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "broken.xml"
    path.write_text('<root BTCPP_format="4">\n  <BehaviorTree ID="A">\n    <Sequence>\n  </BehaviorTree>\n</root>\n')
    for command in (["check", path], ["run", path], ["show", path]):
        assert f"{path}:4:" in complaint(capsys, *command)


def test_a_working_folder_that_is_gone_is_told(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    program = "import os, bracket_cell.__main__ as cell; os.rmdir(os.getcwd()); cell.main()"
    ended = subprocess.run([sys.executable, "-c", program, "--version"], cwd=gone, capture_output=True, text=True)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr == "cell: the working folder is gone; change to one that is there\n"


class Full(io.StringIO):
    """A file on a full disk; it takes what fits into its buffer."""

    def __init__(self, fits: int) -> None:
        super().__init__()
        self._fits = fits

    def write(self, text: str) -> int:
        written = super().write(text)
        if self.tell() > self._fits:
            raise OSError(errno.ENOSPC, "No space left on device")
        return written

    def flush(self) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("fits", [0, 1_000_000])
@pytest.mark.parametrize(
    "words", [["--version"], ["docs"], ["docs", "shift"], ["nodes"], ["show", TREE], ["safety", "show", "--json"]]
)
def test_an_output_that_a_full_disk_does_not_take_is_told_in_a_line(
    words: list[str], fits: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdout", Full(fits))
    assert main([str(word) for word in words]) == 2
    assert capsys.readouterr().err == "cell: the output cannot be written: No space left on device\n"


@pytest.mark.parametrize("words", [["log", "info"], ["goals", "--file"], ["show", "trees/ahead.xml", "--html"]])
def test_a_name_that_no_file_system_takes_is_told(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*words, "x" * 300]) == 2
    assert "file name too long: file systems take names of 255 bytes" in capsys.readouterr().err


def test_a_word_that_is_no_choice_is_told_without_those_of_a_library(capsys: pytest.CaptureFixture[str]) -> None:
    assert "'--format': 'foo' is not one of 'text'" in complaint(capsys, "nodes", "--format", "foo")


def test_an_unknown_node_is_named_by_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "unknown.xml"
    path.write_text('<root BTCPP_format="4">\n <BehaviorTree ID="A">\n  <MakeTea/>\n </BehaviorTree>\n</root>')
    for command in (["check", path], ["run", path]):
        message = complaint(capsys, *command)
        assert f"{path}:3:" in message
        assert "MakeTea" in message


def test_a_product_that_disagrees_is_named_by_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    product = CONFIGURATION.with_name("products.yaml").read_text().replace("quantity: 3", "quantity: 2")
    (tmp_path / "products.yaml").write_text(product)
    (tmp_path / "sim.yaml").write_text("{}")
    (tmp_path / "cell.yaml").write_text(CONFIGURATION.read_text())
    message = complaint(capsys, "run", "--config", tmp_path / "cell.yaml")
    line = next(i for i, text in enumerate(product.splitlines(), 1) if text.strip().startswith("g0:"))
    assert f"{tmp_path / 'products.yaml'}:{line}:" in message
    assert "goal g0 needs 3 x o1" in message


def test_a_log_that_cannot_be_written_moves_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("in the way")
    message = complaint(capsys, "run", "--log", tmp_path / "file" / "log.mcap")
    assert f"{tmp_path / 'file' / 'log.mcap'}: the log cannot be written" in message


def test_an_unknown_goal_leaves_no_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    message = complaint(capsys, "run", "--goal", "g9", "--log", tmp_path / "log.mcap")
    assert "unknown goal 'g9'; legal: g0, g1, g2, random" in message
    assert list(tmp_path.iterdir()) == []


def test_weights_that_are_no_model_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("products.yaml", "sim.yaml"):
        (tmp_path / name).write_text(CONFIGURATION.with_name(name).read_text())
    (tmp_path / "bad.onnx").write_bytes(b"no model")
    text = CONFIGURATION.read_text().replace("  semantic:\n", "  semantic:\n    weights: bad.onnx\n")
    (tmp_path / "cell.yaml").write_text(text)
    message = complaint(capsys, "run", "--config", tmp_path / "cell.yaml", "--log", tmp_path / "log.mcap")
    assert f"{tmp_path / 'bad.onnx'}: not an ONNX file, or damaged" in message
    assert not (tmp_path / "log.mcap").exists()


def test_a_driver_that_is_not_there_is_named_by_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("products.yaml", "sim.yaml"):
        (tmp_path / name).write_text(CONFIGURATION.with_name(name).read_text())
    text = CONFIGURATION.read_text().replace("panel: {kind: simulated}", "panel: {kind: bracket_sim.cell:Sesame}")
    (tmp_path / "cell.yaml").write_text(text)
    line = next(i for i, text in enumerate(text.splitlines(), 1) if "Sesame" in text)
    message = complaint(capsys, "run", "--config", tmp_path / "cell.yaml", "--log", tmp_path / "log.mcap")
    assert f"{tmp_path / 'cell.yaml'}:{line}:" in message
    assert "Sesame" in message


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "--nonsense"], "--nonsense"),
        (["run", "--page=soon"], "--page"),
        (["run", "--seed", "-1"], "0"),
        (["frobnicate"], "frobnicate"),
        (["check"], "type: cell check [OPTIONS] FILE..."),
        (["log", "info"], "type: cell log info [OPTIONS] LOG..."),
        (["check", "no/such/file.xml"], "no/such/file.xml: cannot be read"),
        (["lab", "eval", "grasp", "--kind", "magic"], "magic"),
        (["run", "--open", "live=99999"], "--open live=99999: '99999' is no port; legal: 0 to 65534"),
        (["run", "--open", "window"], "there is no door 'window'; legal: monitor, breakpoints, debugger, live"),
    ],
)
def test_other_bad_input(arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert words in complaint(capsys, *arguments)


@pytest.mark.torch
@pytest.mark.parametrize("planner", ["semantic", "grasp"])
def test_a_planner_that_cannot_be_trained_is_bad_input(planner: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert "magic" in complaint(capsys, "lab", "train", planner, "--kind", "magic")


def test_the_shipped_trees_have_no_mistakes(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", *map(str, sorted(TREE.parent.glob("*.xml")))]) == 0
    assert "nothing wrong" in capsys.readouterr().err


def test_nodes_are_listed_for_people_programs_and_groot(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["nodes"]) == 0
    assert "DetectAction" in capsys.readouterr().out
    assert main(["nodes", "--format", "json"]) == 0
    names = [node["name"] for node in json.loads(capsys.readouterr().out)]
    assert {"DetectAction", "InferGoal", "PlacePart", "Sequence"} <= set(names)
    assert not {"Node", "CellNode", "SkillNode"} & set(names)
    assert main(["nodes", "--format", "groot"]) == 0
    assert "<TreeNodesModel>" in capsys.readouterr().out


def test_show_prints_the_tree(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", str(TREE)]) == 0
    assert "DetectAction" in capsys.readouterr().out


def test_a_missing_font_is_told_instead_of_drawing_empty_boxes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("btxml.views.picture._rendered", lambda _: b"the same with and without text")
    assert "apt-get install -y fonts-dejavu-core" in complaint(capsys, "show", TREE, "--png", tmp_path / "tree.png")
    assert not (tmp_path / "tree.png").exists()
    monkeypatch.setattr("bracket_cell.commands.doctor.damaged_packages", dict)
    monkeypatch.setattr("bracket_cell.commands.doctor.TRIAL_S", 0.2)
    main(["doctor", "--json"])
    findings = json.loads(capsys.readouterr().out.splitlines()[-1])["findings"]
    assert [finding["what"] for finding in findings if "fonts-dejavu-core" in finding["remedy"]]


@pytest.mark.long
@pytest.mark.skipif(not draws_text(), reason="no font is installed")
def test_trees_are_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    svg, png = tmp_path / "tree.svg", tmp_path / "tree.png"
    assert main(["show", str(TREE), "--svg", str(svg), "--png", str(png)]) == 0
    assert capsys.readouterr().out == ""
    assert ">InferGoal<" in svg.read_text()
    image = cv2.imread(str(png))
    assert image is not None
    assert min(image.shape[:2]) > 500
    assert (image < 128).any()
    assert "cannot be written" in complaint(capsys, "show", TREE, "--png", tmp_path)


def test_check_tells_editors_in_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "tree.xml"
    path.write_text('<root BTCPP_format="4">\n <BehaviorTree ID="A">\n  <Sequense/>\n </BehaviorTree>\n</root>')
    assert main(["check", "--json", str(path)]) == 2
    (problem,) = json.loads(capsys.readouterr().out)["problems"]
    assert (problem["file"], problem["line"], problem["column"]) == (str(path), 3, 3)
    assert "Sequense" in problem["what"]
    assert "Sequence" in problem["legal"]
    assert main(["check", "--json", str(TREE)]) == 0
    assert json.loads(capsys.readouterr().out) == {"problems": []}


def test_the_palette_for_groot_names_ports(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["nodes", "--format", "groot"]) == 0
    model = ElementTree.fromstring(capsys.readouterr().out).find("TreeNodesModel/Action[@ID='PickPart']")
    assert model is not None
    assert [port.get("name") for port in model.iter("input_port")] == ["parts", "index", "lifts"]


def test_check_does_not_load_kinematics() -> None:
    script = (
        f"import sys; from bracket_cell.commands.main import main; main(['check', {str(TREE)!r}]); "
        "sys.exit(' '.join({'pinocchio', 'coal', 'mujoco', 'onnxruntime', 'cv2'} & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.stderr.startswith("1 file: nothing wrong")


def test_a_run_never_imports_torch() -> None:
    script = (
        "import sys, bracket_cell.runs.run, bracket_cell.commands.main, bracket_cell.commands.doctor; "
        "import bracket_sim.cell; "
        "sys.exit(' '.join(name for name in ('torch', 'triton', 'torchvision') if name in sys.modules) or 0)"
    )
    result = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (result.returncode, result.stderr) == (0, "")


def test_ctrl_c_before_a_command_has_begun_is_told_without_a_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(_: list[str]) -> None:
        raise KeyboardInterrupt

    def loading(_: list[str]) -> None:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            raise ImportError("initialization failed") from error  # as pybind11's modules do

    for begins in (loading, interrupted):
        monkeypatch.setattr("bracket_cell.commands.main.application", begins)
        assert main(["nodes"]) == 1
        assert capsys.readouterr().err == "cell: interrupted\n"
    monkeypatch.setenv(BESIDE, "1")  # the command that runs this one says it
    assert main(["nodes"]) == 1
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("module", ["typer", "bracket_cell.commands.tree_files"])
def test_ctrl_c_while_modules_are_imported_is_told_without_a_traceback(module: str) -> None:
    script = f"""
import os, signal, sys
class Presses:
    def find_spec(self, name, *_):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Presses())
signal.signal(signal.SIGINT, signal.default_int_handler)  # what runs in the background ignores it
from bracket_cell.__main__ import main
sys.argv = ["cell", "nodes"]
main()
"""
    told = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (told.returncode, told.stdout, told.stderr) == (1, "", "cell: interrupted\n")


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert re.fullmatch(r"cell \d+\.\d+\.\d+ \(commit [0-9a-f]{8}(, changed)?\)\n", capsys.readouterr().out)


def test_a_shell_completes_commands() -> None:
    asked = {"_CELL_COMPLETE": "complete_bash", "COMP_WORDS": "cell re", "COMP_CWORD": "1"}
    told = finished([sys.executable, "-m", "bracket_cell"], ROOT, asked)
    assert sorted(told.stdout.split()) == ["record", "replay", "report"]
