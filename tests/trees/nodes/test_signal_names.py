"""Trees name the digital signals of the configuration, and no others."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_cell.configuration import Configuration, load_configuration, load_product
from bracket_cell.skills.drivers.settings import SignalSettings
from bracket_cell.trees.node_library import node_registry
from btxml.files.check import check

SHIPPED = load_configuration()
PRODUCT = load_product(SHIPPED)
MODULE = SignalSettings(inputs={"ready": 3}, outputs={"start": 1, "lamp": 2})
WIRED = SHIPPED.model_copy(update={"devices": SHIPPED.devices.model_copy(update={"signals": MODULE})})


def problems_of(tmp_path: Path, nodes: str, configuration: Configuration | None) -> list[str]:
    file = tmp_path / "tree.xml"
    inner = '<BehaviorTree ID="Blink"><SetSignal signal="{what}"/></BehaviorTree>'
    root = '<root BTCPP_format="4" main_tree_to_execute="Main">'
    file.write_text(f'{root}\n<BehaviorTree ID="Main"><Sequence>{nodes}</Sequence></BehaviorTree>{inner}</root>')
    return [str(problem) for problem in check([file], node_registry(PRODUCT, (), configuration))]


@pytest.mark.parametrize(
    ("nodes", "told"),
    [
        (
            '<WaitForSignal signal="raedy"/>',
            r":2:58: the bench has no signal 'raedy'; one of ready, start, lamp",
        ),
        ('<SignalIs signal="raedy"/>', r"the bench has no signal 'raedy'; one of ready, start, lamp"),
        ('<SetSignal signal="lmap"/>', r"the bench has no output signal 'lmap'; one of start, lamp"),
        ('<SetSignal signal="ready"/>', r"the bench has no output signal 'ready'; one of start, lamp"),
        ('<SubTree ID="Blink" what="raedy"/>', r"no output signal 'raedy'; port 'signal' of SetSignal at .* takes one"),
        (
            '<Script code="s := \'ready\'"/><SignalIs signal="{s}"/><SetSignal signal="{s}"/>',
            r"no output signal 'ready'; port 'signal' of SetSignal at .* takes one of start, lamp",
        ),
    ],
)
def test_a_signal_that_the_bench_does_not_have_is_a_mistake(tmp_path: Path, nodes: str, told: str) -> None:
    (problem,) = problems_of(tmp_path, nodes, WIRED)
    assert re.search(told, problem), problem
    assert problems_of(tmp_path, nodes, None) == []  # without a configuration any name passes


def test_a_bench_without_a_module_has_no_signals(tmp_path: Path) -> None:
    (problem,) = problems_of(tmp_path, '<SetSignal signal="start"/>', SHIPPED)
    assert problem.endswith("the bench has no output signal 'start'; the configuration names none")


def test_one_entry_serves_all_nodes_of_signals(tmp_path: Path) -> None:
    nodes = '<Script code="s := \'lamp\'"/><SetSignal signal="{s}"/><WaitForSignal signal="{s}"/>'
    assert problems_of(tmp_path, nodes + '<SubTree ID="Blink" what="start"/>', WIRED) == []


def test_check_reads_the_signals_of_the_configuration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, settings = tmp_path / "tree.xml", tmp_path / "cell.yaml"
    file.write_text('<root BTCPP_format="4"><BehaviorTree ID="M"><SignalIs signal="raedy"/></BehaviorTree></root>')
    module = "{kind: can, inputs: {ready: 3}}"
    settings.write_text(Path("config/cell.yaml").read_text().replace("devices:", f"devices:\n  signals: {module}"))
    for name in ("products.yaml", "sim.yaml"):
        (tmp_path / name).write_text(Path("config", name).read_text())
    assert main(["check", str(file), "--config", str(settings)]) == 2
    assert "tree.xml:1:63: the bench has no signal 'raedy'; one of ready" in capsys.readouterr().err
    assert main(["check", str(file)]) == 0
    assert "names of parts, positions, goals and signals are checked with --config" in capsys.readouterr().err
