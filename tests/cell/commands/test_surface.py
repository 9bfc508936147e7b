"""What the command line has: its commands in four panels, few options, and a word for each name of before."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from bracket_cell.commands import main as commands
from bracket_cell.commands import terminal
from bracket_cell.commands.main import COMMANDS, application, main
from bracket_cell.commands.options import USUAL, doors_of, seeds_of, user_files, with_usual
from bracket_ground.errors import InputError
from bracket_lab import commands as lab
from tests import ROOT

LAB_LINE = "`cell lab --help` lists the commands for research."
PANELS = {
    "Start": ["init", "doctor", "docs", "run", "serve", "setup", "safety"],
    "Program": ["new", "check", "nodes", "schema", "lsp", "show"],
    "Test": ["twin", "replay", "report", "log"],
    "Train": ["record", "label", "train", "goals", "compare"],
}
RUN = {
    *("--config", "--goal", "--seed", "--look", "--real-time", "--log", "--set", "--with", "--watch", "--shift"),
    *("--resume", "--page", "--work-orders", "--open", "--json", "--share"),
}


@cache
def whole() -> Any:
    """The whole command line, for which every command is imported."""
    return get_command(application())


def command(*path: str) -> Any:
    """One of its commands."""
    found = whole()
    for name in path:
        found = found.commands[name]
    return found


def options(*path: str) -> set[str]:
    """Long names of a command's options."""
    asked = [param for param in command(*path).params if param.param_type_name == "option" and not param.hidden]
    return {name for one in asked for name in one.opts if name.startswith("--")} - {"--help"}


def test_its_commands_stand_in_four_panels(capsys: pytest.CaptureFixture[str]) -> None:
    assert {panel: [name for name, one in COMMANDS.items() if one.panel == panel] for panel in PANELS} == PANELS
    hidden = {name for name, one in command().commands.items() if one.hidden}
    assert hidden == {"dap", "lab", "_data", "_train"}  # editors start the first
    assert main(["--help"]) == 0
    told = capsys.readouterr().out
    assert [line.strip() for line in told.splitlines() if re.search(r"\blab\b", line)] == [LAB_LINE]
    assert all(panel in told for panel in PANELS)


def test_the_list_says_of_a_command_what_its_help_begins_with() -> None:
    tables = {(): COMMANDS, ("lab",): lab.COMMANDS, ("lab", "eval"): lab.EVALUATIONS}
    for path, table in tables.items():
        for name, one in table.items():
            if not name.startswith("_") and name != "lab":
                told = " ".join((command(*path, name).help or "").split())
                assert told.startswith(one.help.rstrip(".")), name


def test_a_run_has_few_options_and_the_lab_five_more() -> None:
    assert options("run") == RUN
    assert options("lab", "run") - RUN == {
        "--person",
        "--inject",
        "--world",
        "--overwrite",
        "--unsafe-table",
    }


def test_the_product_has_few_commands_and_options() -> None:
    """Outside of the laboratory; what is hidden is for programs."""
    commands = [(path, each) for path, each in leaves(whole(), ()) if path[0] not in ("record", "label")]  # the lab's
    found = [(path, param) for path, each in commands for param in each.params if param.param_type_name == "option"]
    found = [(path, one) for path, one in found if not one.hidden and one.name != "help"]
    assert len(commands) <= 38, [" ".join(path) for path, _ in commands]
    assert len(found) <= 165
    assert len(options("run")) <= 16


def test_an_option_of_several_commands_has_one_text() -> None:
    texts: dict[str, set[str]] = {}
    for _, each in leaves(whole(), ()):
        for param in each.params:
            if param.param_type_name == "option":
                texts.setdefault(max(param.opts, key=len), set()).add(param.help)
    assert {name: told for name, told in texts.items() if len(told) > 1} == {}


def leaves(found: Any, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """The commands of the product that do something, by path; `train` is of the laboratory."""
    below = getattr(found, "commands", {})
    for name, one in below.items():
        if not one.hidden and name != "train":
            yield from leaves(one, (*path, name))
    if not below or found.invoke_without_command:
        yield path, found


def test_evaluations_share_their_options() -> None:
    evaluations = command("lab", "eval").commands
    names = set.union(*(options("lab", "eval", name) for name in evaluations))
    assert len(evaluations) == 15
    assert len(names) <= 55


def test_a_port_may_be_left_out() -> None:
    assert with_usual(["run", "--page", "--shift", "2"]) == ["run", f"--page={USUAL['--page']}", "--shift", "2"]
    assert with_usual(["run", "--page", "80", "--real-time"]) == ["run", "--page", "80", "--real-time=1"]
    assert with_usual(["run", "--page=7", "--real-time", "2.5"]) == ["run", "--page=7", "--real-time", "2.5"]
    assert with_usual(["run", "--page", "vm:80a", "x.xml"]) == ["run", "--page", "vm:80a", "x.xml"]  # it was a tree
    assert with_usual(["run", "--page", "a:b.xml"]) == ["run", f"--page={USUAL['--page']}", "a:b.xml"]
    assert with_usual(["show", "--running"]) == ["show", f"--running={USUAL['--running']}"]


def test_doors_that_are_opened() -> None:
    assert doors_of(["live", "breakpoints=1700"]) == {
        "live_port": 8765,
        "monitor_port": 1700,
        "monitor_hooks": True,
    }
    assert doors_of(["monitor"]) == {"monitor_port": 1667}


def test_own_nodes_and_trees_are_told_apart(tmp_path: Path) -> None:
    for name in ("nodes/count.py", "trees/a.xml", "both/b.xml", "both/c.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
    names = [str(tmp_path / name) for name in ("nodes", "trees", "both", "trees/a.xml")]
    nodes, trees = user_files([*names, "some.package"])
    assert nodes == (names[0], names[2], "some.package")
    assert trees == tuple(map(Path, names[1:]))


@pytest.mark.parametrize("text", ["", "5:5", "7:2", "-1", "a:b", "1:"])
def test_seeds_that_are_none_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="FIRST:END"):
        seeds_of(text)


def test_without_the_lab_the_product_says_where_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(commands, "offers", lambda _: False)
    monkeypatch.setattr(terminal, "entry_points", lambda **_: ())
    assert main(["lab", "eval", "hands"]) == 2
    assert "this command is not installed; install it: make train-deps" in capsys.readouterr().err
    assert main(["--help"]) == 0
    assert re.search(r"\blab\b", capsys.readouterr().out) is None


def test_a_product_command_imports_no_other_and_no_lab() -> None:
    script = (
        "import sys; from bracket_cell.commands.main import main; main(['check', '--no-config', 'trees/ahead.xml']); "
        "others = ('bracket_cell.commands.run', 'bracket_cell.configuration'); "
        "print([name for name in sys.modules if 'bracket_lab' in name or name in others])"
    )
    told = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    assert told.stdout == "[]\n"


def test_one_node_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["nodes", "MoveTo"]) == 0
    told = capsys.readouterr().out
    assert "MoveTo  [Action]" in told
    assert "Sequence" not in told
    assert main(["nodes", "gripper"]) == 0
    assert "ActivateGripper" in capsys.readouterr().out
    assert main(["nodes", "MoveTwo"]) == 2
    assert "MoveTo" in capsys.readouterr().err


def test_a_table_shows_counts_in_words(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.console().print(terminal.table("run", {"places": {"bracket": 2, "rest": 1}, "reaches": 3}))
    told = "".join(capsys.readouterr())
    assert "bracket 2, rest 1" in told
    assert "{" not in told
