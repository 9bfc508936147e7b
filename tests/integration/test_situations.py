"""Every situation of the table can be opened, and a measured one ends well."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from bracket_cell.configuration import load_configuration, load_product, simulated
from bracket_cell.running.operator import OperatorChannel
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.watching.observer import Outcome
from bracket_ground.files.row_store import RowStore
from bracket_lab.evaluations import assembly as lab_assembly
from bracket_sim.cell import SimCell
from bracket_sim.scene.person import Person, Storage
from bracket_sim.scene.settings import SimSettings
from tests.integration.cell_rig import BENCH, PRODUCT
from tests.integration.situations import SITUATIONS, row, seen, uninterrupted


@pytest.mark.parametrize("name", SITUATIONS)
def test_what_a_situation_names_is_there(name: str) -> None:
    said = SITUATIONS[name]
    configuration = simulated(load_configuration(said.cell), None, said.person)
    assert load_tree(said.tree, node_registry(load_product(configuration, said.cell)))


def test_a_situation_is_said_in_a_single_way() -> None:
    assert len(set(SITUATIONS.values())) == len(SITUATIONS)
    assert len(SITUATIONS) == 26


def test_what_is_kept_is_not_run_again_and_the_worst_contact_is_told(tmp_path: Path) -> None:
    kept = RowStore(tmp_path / "kept.jsonl", ("situation", "seed"))
    for seed, end, contacts in ((1, "held", [[True, 31.0]]), (2, "right", [[False, 99.0], [True, 12.0]])):
        kept.add({"situation": "undoes", "seed": seed, "end": end, "contacts": contacts})
    assert row("undoes", [1, 2], kept) == "| undoes | 1 | 0 | 1 | 0 | 0 | 3 | 2 | 31 | 99 |"


def test_a_run_that_a_signal_ended_is_not_kept() -> None:
    ended = Outcome("interrupted", "SIGTERM", 1, 0, 2.2, 1.0)
    with pytest.raises(SystemExit, match="not kept"):
        uninterrupted(ended)
    assert uninterrupted(replace(ended, end="timeout")).end == "timeout"


@pytest.mark.parametrize("name", ["points_at_hole", "undoes"])
def test_where_the_person_works_a_shift_the_cell_knows_that_somebody_answers(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    present = []

    def run(*_: object, operator: OperatorChannel, **__: object) -> Outcome:
        present.append(operator.take(0.0).present)
        return Outcome("interrupted", "nothing was run", 0, 0, 0.0, 0.0)

    monkeypatch.setattr(lab_assembly, "run_controller", run)
    with pytest.raises(SystemExit):
        seen(SITUATIONS[name], 1)
    assert present == [SITUATIONS[name].shift]


def test_a_person_may_have_parts_of_some_types_alone() -> None:
    settings = SimSettings(person=Person(storage=Storage(types=1)))
    cell = SimCell(PRODUCT, BENCH, settings, "virtual", "types", 5, "g0", rendered=False)
    theirs = {body.part for body in cell.world.bodies if body.owner == "person" and body.name not in cell.stock.kept}
    cell.close()
    assert len(theirs) == 1


@pytest.mark.long
def test_an_order_that_the_person_contradicts_is_asked_about_where_nobody_is_known_to_be_at_the_panel() -> None:
    assert seen(SITUATIONS["order_changes"], 7)[0] == "right"


@pytest.mark.slow
def test_a_bracket_that_somebody_else_began_is_taken_over() -> None:
    assert seen(SITUATIONS["begun_by_others"], 993101) == ("right", [])


@pytest.mark.slow
def test_beside_who_never_screws_the_bracket_is_right_and_nobody_is_touched() -> None:
    assert seen(SITUATIONS["never_screws"], 993100) == ("right", [])
