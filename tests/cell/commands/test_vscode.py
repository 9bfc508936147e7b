"""The extension for Visual Studio Code: what it declares it does, against the server that it starts."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest

from bracket_cell.packages import version
from tests import ROOT

EXTENSION = ROOT / "editor" / "vscode"
MANIFEST = json.loads((EXTENSION / "package.json").read_text())
TREE = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main"><MoveTo pose="parc"/></BehaviorTree>
</root>
"""

pytestmark = pytest.mark.skipif(
    shutil.which("node") is None, reason="node is not installed, so nothing ran the extension"
)


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    """The program, as an editor calls it."""
    program = tmp_path / "cell"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m bracket_cell "$@"\n')
    program.chmod(0o755)
    return program


def hosted(extension: Path, cell: Path, folder: Path) -> dict[str, Any]:
    """What the extension did in a stand-in for the editor, with a tree that has a mistake."""
    (folder / "config").mkdir(parents=True)
    for file in (ROOT / "config").glob("*.yaml"):
        shutil.copy(file, folder / "config")
    (folder / "trees").mkdir()
    tree = folder / "trees" / "mine.xml"
    tree.write_text(TREE)
    host = Path(__file__).with_name("vscode_host.js")
    words: list[str | Path] = ["node", host, extension, cell, folder, tree]
    done = subprocess.run(words, capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def assert_served(found: dict[str, Any], cell: Path) -> None:
    assert found["commands"] == [one["command"] for one in MANIFEST["contributes"]["commands"]]
    assert found["selector"] == [{"scheme": "file", "language": "xml", "pattern": "**/trees/**/*.xml"}]
    tree = found["terminals"][0][2]
    assert found["terminals"] == [
        [str(cell), "check", tree],
        [str(cell), "show", "--running"],
        [str(cell), "replay", tree],
    ]
    assert found["launched"] == {"type": "cell", "request": "launch", "name": "mine.xml", "program": tree}
    assert found["completed"]["args"] == ["--real-time"]
    assert found["completed"]["program"] == "${file}"
    assert found["debugger"]["supportsConfigurationDoneRequest"] is True
    assert found["marked"] == {"▶": [1], "✔": [2], "✘": [3]}
    assert found["unmarked"] == {"▶": [], "✔": [], "✘": []}
    assert "parc" in found["marks"][0]
    assert "write park" in found["actions"]
    wanted = {
        "completion",
        "hover",
        "definition",
        "references",
        "rename",
        "documentSymbol",
        "documentLink",
        "codeAction",
    }
    assert {f"{one}Provider" for one in wanted} <= set(found["capabilities"])
    assert found["errors"][0].count("parc") == 1, "a tree with a mistake has no page, and the editor says why"


@pytest.mark.long
def test_the_extension_serves_an_editor(cell: Path, tmp_path: Path) -> None:
    assert_served(hosted(EXTENSION, cell, tmp_path / "cell folder"), cell)


def test_commands_options_and_snippets_are_those_of_the_program(cell: Path) -> None:
    assert MANIFEST["version"] == version()
    code = (EXTENSION / "extension.js").read_text()
    for command in re.findall(r'"cell\.\w+": \(\w*\) => terminal\("cell (\w+)"', code):
        assert subprocess.run([cell, command, "--help"], capture_output=True, check=False).returncode == 0, command
    assert {one["type"] for one in MANIFEST["contributes"]["debuggers"]} == {"cell"}
    assert MANIFEST["contributes"]["breakpoints"] == [{"language": "xml"}]
    snippets = json.loads((EXTENSION / "snippets.json").read_text())
    assert all("\n".join(snippet["body"]).count("<") for snippet in snippets.values())


@pytest.mark.slow
def test_the_package_holds_all_that_it_needs(cell: Path, tmp_path: Path) -> None:
    made = subprocess.run(
        ["make", "vsix", f"VSIX={tmp_path / 'cell.vsix'}"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if "npm error code E" in made.stderr or shutil.which("npm") is None:
        pytest.skip("npm finds no packages here")
    assert made.returncode == 0, made.stderr
    with zipfile.ZipFile(tmp_path / "cell.vsix") as package:
        package.extractall(tmp_path / "unpacked")
    unpacked = tmp_path / "unpacked" / "extension"
    assert (unpacked / "node_modules" / "vscode-languageclient" / "node.js").is_file()
    assert_served(hosted(unpacked, cell, tmp_path / "folder"), cell)
