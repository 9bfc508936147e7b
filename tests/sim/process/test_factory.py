"""What opens the devices may be a module of the user's, which may raise anything."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from cell.commands.main import main
from tests.cell.conftest import changed_configuration


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("raise RuntimeError('no bus')", "their_bus cannot be loaded: RuntimeError: no bus"),
        ("def", "their_bus cannot be loaded: SyntaxError"),
        ("import sys\nsys.exit(0)", "their_bus cannot be loaded: SystemExit: 0"),
        ("import nothing_at_all", "no such factory: No module named 'nothing_at_all'"),
        ("", "no such factory"),
        ("open_it = 3", "opens no devices"),
    ],
)
def test_a_factory_that_cannot_be_loaded_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], text: str, told: str
) -> None:
    name = "their_bus"
    (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, name, raising=False)
    configuration = changed_configuration(tmp_path / "config", "sim.cell:open_cell", f"{name}:open_it")
    log = tmp_path / "log.mcap"
    assert main(["run", "--config", str(configuration), "--log", str(log)]) == 2
    assert told in capsys.readouterr().err
    assert not log.exists()
