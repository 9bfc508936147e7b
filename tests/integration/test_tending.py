"""The examples with places and with a mesh, whole: what the truth says when their trees have ended."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from bracket_cell.runs.options import RunOptions
from bracket_cell.runs.run import run
from tests import ROOT

EXAMPLES = ROOT / "config" / "examples"


def summary(tree: Path, example: str, folder: Path, seed: int) -> dict[str, Any]:
    """What `cell run --json` tells of a run beside a careful person, without pixels."""
    options = RunOptions(
        tree=tree,
        configuration=EXAMPLES / example / "cell.yaml",
        seed=seed,
        person="careful",
        pixels=False,
        images=False,
        one_process=True,
        log=folder / "run.mcap",
    )
    return dict(run(options, Console(quiet=True)).summary)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tree", "full"),
    [("tend.xml", {"pallet": ["o1", "o2", "o2", "o1"]}), ("sort.xml", {"reds": ["o1", "o1"], "blues": ["o2", "o2"]})],
)
def test_a_bench_with_places_is_tended(tree: str, full: dict[str, list[str]], tmp_path: Path) -> None:
    told = summary(EXAMPLES / "tending" / tree, "tending", tmp_path, 3)
    assert told["end"] == "finished"
    assert told["places"] | full == told["places"]
    assert told["places"]["fixture"] == ["empty"] * 4
    assert told["contacts"] == 0


@pytest.mark.slow
def test_a_product_with_a_part_from_a_mesh_is_assembled(tmp_path: Path) -> None:
    assert summary(ROOT / "trees" / "ahead.xml", "mesh", tmp_path, 8101)["correct"] is True
