"""All texts that people at the bench read, as they stand in the code: ids of the catalogues."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from bracket_ground.files.words.message import SPEC
from tests import ROOT

FOLDERS = (
    "cell/bracket_cell/running",
    "cell/bracket_cell/viewing",
    "cell/bracket_cell/serving",
    "ground/bracket_ground/interfaces",
    "cell/bracket_cell/trees/guard.py",
    "cell/bracket_cell/trees/nodes",
    "cell/bracket_cell/skills",
)
SPOKEN = ("Answer", "Detection", "FingersRest", "Instruction", "Move", "Progress", "SetGripper", "Verdict", "_Ending")
SPOKEN_TOO = ("_also", "_mode", "_restarted", "_with", "ask", "done", "failed", "show")
OF_DOCTOR = ("cameras.py", "robotiq.py", "ur_dashboard.py", "ur_examined.py")  # what `cell doctor` says of devices
STATIC = ROOT / "cell" / "bracket_cell" / "viewing" / "page" / "static"
QUOTED = r'"((?:[^"\\]|\\.)*)"'
KEPT = {"feedback_message", "reason", "TODO", "DONE_BY", "FINISHED", "ACKNOWLEDGE"}
NOT_SHOWN = {  # ids, help and refusals that only programs see
    *("foreign origin", "unknown host", "goes on", "the table", "the bracket", "the tray", "in the tray", "near it"),
    *("too many pages are open already", "the order did not come to its end", "the order is too long", "after part"),
    *("finished, and the bracket is right", "finished, but the bracket is not right", "input, select", "work order"),
    *("what the child said when it ended", "why that is safe", "M0,0 L-14,-20 L-5,-20 L-5,-44 L5,-44 L5,-20 L14,-20 Z"),
    *("supervisor arm_off_path", "supervisor arm_stale", "supervisor bench_stale", "supervisor tick_late"),
    "table of faults",
    *("number and parts are numbers", "use strict"),
    "it asks for help, and the arm can take the part as it stands",
}


def spoken() -> dict[str, str]:
    """Where each text stands, by its id."""
    found: dict[str, str] = {}
    for folder in FOLDERS:
        path = ROOT / folder
        for file in (
            [path]
            if path.is_file()
            else sorted(set(path.rglob("*.py")) - {path / "drivers" / name for name in OF_DOCTOR})
        ):
            found |= {text: f"{file.relative_to(ROOT)}:{line}" for text, line in _of_python(file)}
    for file in (STATIC / name for name in ("page.js", "scene.js", "tree.js")):
        found |= {text: str(file.relative_to(ROOT)) for text in _of_script(file.read_text(encoding="utf-8"))}
    for file in sorted((ROOT / "trees").glob("*.xml")):
        asked = re.findall(r'(?:AskForHelp|AskOperator|ShowMessage) text="([^"{]+)"', file.read_text(encoding="utf-8"))
        found |= dict.fromkeys(asked, file.name)
    return {SPEC.sub(r"{\1}", text): place for text, place in found.items() if text not in NOT_SHOWN}


def _of_python(file: Path) -> Iterator[tuple[str, int]]:
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            if name == "Message" and node.args:
                yield from _texts(node.args[0], False)
            elif name in (*SPOKEN, *SPOKEN_TOO):
                for value in (*node.args, *(keyword.value for keyword in node.keywords)):
                    yield from _texts(value, True)
        elif isinstance(node, ast.Return | ast.Assign) and node.value is not None:
            targets = getattr(node, "targets", [])
            names = [getattr(target, "attr", getattr(target, "id", "")) for target in targets]
            if isinstance(node, ast.Return) or {
                "feedback_message",
                "reason",
                "reasons",
                "TODO",
                "DONE_BY",
                "FINISHED",
                "ACKNOWLEDGE",
            } & set(names):
                yield from _texts(node.value, True)


def _texts(node: ast.expr, words: bool) -> Iterator[tuple[str, int]]:
    """Constant texts of an expression; of those that may be names only what has several words."""
    for one in ast.walk(node):
        if isinstance(one, ast.Call) and getattr(one.func, "id", "") == "Message":
            continue
        if isinstance(one, ast.Constant) and isinstance(one.value, str):
            text = one.value
            if not words or re.fullmatch(r"[A-Za-z][^{}]*[a-z]+ [^{}]*[a-z.?]", text):
                yield text, one.lineno


def _of_script(text: str) -> Iterator[str]:
    """What is looked up there: arguments of t, and other quoted texts of several words."""
    yield from re.findall(rf"\bt\({QUOTED}", text)
    yield from (one for one in re.findall(QUOTED, text) if re.fullmatch(r"[A-Za-z][\w ',.-]* [\w ',.-]*\w", one))
