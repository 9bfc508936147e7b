"""trees/algorithm1.xml names at each node the printed line of the paper that it does; so do the nodes' own words."""

from __future__ import annotations

import re

import pytest

from bracket_cell.trees.node_library import node_registry
from bracket_ground.files.files import shipped
from bracket_lab.evaluations.figures import paper

TREE = shipped("bracket_cell.trees", "algorithm1.xml").read_text()
PRINTED = paper().algorithm_1


@pytest.mark.parametrize("node", PRINTED)
def test_the_number_at_a_node_is_the_printed_line(node: str) -> None:
    lines = [line for line in TREE.splitlines() if f"<{node}" in line]
    above = TREE[: TREE.index(f"<{node}")].rsplit("<!--", 1)[1]  # where the node's own line has none
    said = lines[0].rsplit("<!--", 1)[1] if "<!--" in lines[0] else above
    numbers = [int(number) for number in re.findall(r"\d+", said.split("-->")[0].split(":")[0].split("(")[0])]
    assert (numbers[0], numbers[-1]) == (PRINTED[node][0], PRINTED[node][-1])


@pytest.mark.parametrize("node", sorted(set(PRINTED) - {"RetryUntilSuccessful"}))
def test_the_words_of_a_node_name_the_same_line(node: str) -> None:
    found = re.search(r"Alg\. 1 lines? (\d+)", node_registry().classes[node].__doc__ or "")
    assert found is not None
    assert int(found[1]) == PRINTED[node][0]
