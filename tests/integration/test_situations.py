"""Every situation of the table can be opened, and a measured one ends well."""

from __future__ import annotations

import pytest

from bracket_cell.configuration import load_configuration, load_product, simulated
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from tests.integration.situations import CANNOT, ELSEWHERE, SITUATIONS, seen


@pytest.mark.parametrize("name", SITUATIONS)
def test_what_a_situation_names_is_there(name: str) -> None:
    said = SITUATIONS[name]
    configuration = simulated(load_configuration(said.cell), None, said.person)
    assert load_tree(said.tree, node_registry(load_product(configuration, said.cell)))


def test_a_situation_is_said_in_a_single_way() -> None:
    said = [*SITUATIONS.values()]
    assert len({(one.person, one.tree, one.inject, one.cell) for one in said}) == len(said)
    assert not set(SITUATIONS) & set(ELSEWHERE) | set(ELSEWHERE) & set(CANNOT) | set(SITUATIONS) & set(CANNOT)


@pytest.mark.slow
def test_a_bracket_that_somebody_else_began_is_taken_over() -> None:
    assert seen(SITUATIONS["begun_by_others"], 993101) == ("right", [])


@pytest.mark.slow
def test_beside_who_never_screws_the_bracket_is_right_and_nobody_is_touched() -> None:
    assert seen(SITUATIONS["never_screws"], 993100) == ("right", [])
