"""What the operating system says reaches a screen in its words, without error numbers and a library's brackets."""

from __future__ import annotations

import ast
import socket
import termios
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from bracket_cell.commands.main import main
from bracket_ground.errors import words_of
from tests import ROOT
from tests.ceilings import DISTRIBUTIONS

SYSTEM = {"OSError", "IOError", "ConnectionError", "TimeoutError", "FileNotFoundError", "PermissionError"}


def raw(tree: ast.AST) -> Iterator[int]:
    """Lines that put a caught error of the system into a text as it is."""
    for handler in ast.walk(tree):
        if isinstance(handler, ast.ExceptHandler) and handler.name and handler.type is not None:
            caught = {name.id for name in ast.walk(handler.type) if isinstance(name, ast.Name)}
            for value in ast.walk(handler) if caught & SYSTEM else ():
                if isinstance(value, ast.FormattedValue) and ast.unparse(value.value) == handler.name:
                    yield value.lineno


def test_no_message_quotes_an_error_of_the_system_as_it_is() -> None:
    files = [file for folder, top in DISTRIBUTIONS.items() for file in sorted((ROOT / folder / top).rglob("*.py"))]
    found = [f"{file.relative_to(ROOT)}:{line}" for file in files for line in raw(ast.parse(file.read_text()))]
    assert found == []


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (FileNotFoundError(2, "No such file or directory", "/dev/ttyUSB0"), "No such file or directory"),
        (ConnectionRefusedError(111, "Connection refused"), "Connection refused"),
        (socket.gaierror(-2, "Name or service not known"), "Name or service not known"),
        (TimeoutError("timed out"), "timed out"),
        (OSError("it hung up"), "it hung up"),
        (ValueError("no number"), "no number"),
        (OSError(), "OSError"),
        (termios.error(5, "Input/output error"), "Input/output error"),
        (OSError("could not open port /dev/x: [Errno 2] No such file"), "could not open port /dev/x: No such file"),
        (
            OSError(28, "Error writing bytes to file. Detail: [errno 28] No space left on device"),
            "No space left on device",
        ),
        (
            OSError(98, "Address already in use (while attempting to bind on address ('::1', 1))"),
            "Address already in use",
        ),
        (OSError(2, "could not open port /dev/x: [Errno 2] No such file"), "could not open port /dev/x: No such file"),
    ],
)
def test_the_words_of_an_error(error: Exception, words: str) -> None:
    assert words_of(error) == words


def test_a_library_that_wraps_an_error_of_the_system_has_its_words() -> None:
    wrapped = can.CanOperationError("Failed to transmit: [Errno 100] Network is down", 100)
    wrapped.__cause__ = OSError(100, "Network is down")
    assert words_of(wrapped) == "Network is down"


def test_no_twin_is_told_plainly(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["twin", "fault", "--socket", str(tmp_path / "twin.sock")]) == 2
    told = capsys.readouterr().err
    assert "no twin answers there: No such file or directory; start one by `cell twin`" in told
    assert "Errno" not in told
