"""What a decision hangs on is named at the beginning of a log."""

from __future__ import annotations

import hashlib
from pathlib import Path

from bracket_cell.configuration import DEFAULT_CONFIGURATION, load_configuration, load_faults, load_product
from bracket_cell.learned.inference.onnx_model import digest_of
from bracket_cell.runs.heading import heading
from bracket_cell.runs.options import Files, RunOptions
from bracket_cell.wiring.services import load_planners

NODE = '''
from btxml.engine.status import Status
from bracket_cell.trees.nodes.services import CellNode


class Shrug(CellNode):
    """Do nothing."""

    def update(self) -> Status:
        return Status.SUCCESS
'''
TREE = '<root BTCPP_format="4"><BehaviorTree ID="A"><Sequence><Shrug/><AlwaysSuccess/></Sequence></BehaviorTree></root>'


def said(options: RunOptions, kind: str = "classical") -> dict[str, str]:
    read = load_configuration(DEFAULT_CONFIGURATION)
    configuration = read.model_copy(update={"perception": read.perception.model_copy(update={"kind": kind})})
    product = load_product(configuration)
    files = Files(
        configuration,
        product,
        options.load(product, configuration),
        load_planners(configuration, product),
        load_faults(configuration),
    )
    return dict(heading(options, files).metadata)


def test_nodes_of_ones_own_are_named_by_their_hash(tmp_path: Path) -> None:
    (tmp_path / "shrug.py").write_text(NODE)
    (tmp_path / "a.xml").write_text(TREE)
    told = said(RunOptions(tmp_path / "a.xml", nodes=(str(tmp_path / "shrug.py"),)))
    assert told["code.shrug.py.sha256"] == hashlib.sha256(NODE.encode()).hexdigest()
    assert not any(name.startswith("code.") for name in said(RunOptions()))


def test_every_network_of_the_detectors_is_named() -> None:
    told = said(RunOptions(), "learned")
    networks = {"hands", "hands.finder", "actions", "holes", "parts", "parts.pose"}
    assert {f"weights.{name}.sha256" for name in networks} <= set(told)
    for name in networks:
        file = Path(told[f"weights.{name}.file"])
        assert told[f"weights.{name}.sha256"] == digest_of(file.read_bytes())
