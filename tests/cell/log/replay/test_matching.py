"""Nodes of a changed tree stand for those of the tree before, though several have one name."""

from __future__ import annotations

from pathlib import Path

import pytest

from bracket_cell.log.replay.matching import partners
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry

BODY = """<root BTCPP_format="4"><BehaviorTree ID="T"><Sequence>
  <Sleep msec="10"/><Sequence><Sleep msec="20"/><Sleep msec="30"/></Sequence><Sleep msec="40"/>
</Sequence></BehaviorTree></root>"""
BEFORE = ["Sequence::1", "Sleep::2", "Sequence::3", "Sleep::4", "Sleep::5", "Sleep::6"]


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        ("", "", BEFORE),
        ('msec="20"', 'msec="25"', BEFORE),
        ('<Sleep msec="20"/>', "", [one for one in BEFORE if one != "Sleep::4"]),
        ('<Sleep msec="10"/>', "", [one for one in BEFORE if one != "Sleep::2"]),
        ('<Sleep msec="30"/>', '<Sleep msec="15"/><Sleep msec="30"/>', [*BEFORE[:4], "Sleep::5 (new)", *BEFORE[4:]]),
        (
            '<Sleep msec="40"/>',
            '<Inverter><Sleep msec="40"/></Inverter>',
            [*BEFORE[:5], "Inverter::6 (new)", BEFORE[5]],
        ),
    ],
)
def test_each_node_stands_for_the_one_at_its_place(old: str, new: str, found: list[str], tmp_path: Path) -> None:
    trees = []
    for name, text in (("was.xml", BODY), ("now.xml", BODY.replace(old, new) if old else BODY)):
        (tmp_path / name).write_text(text)
        trees.append(load_tree(tmp_path / name, node_registry()))
    assert list(partners(*trees).values()) == found
