"""What a log tells of the work that it broke off in: the graph, the bracket's number, what hangs in the gripper."""

from __future__ import annotations

import io
import json
import socket
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.log.read.resume import _after, read_resume_state
from bracket_cell.runs.options import RunOptions
from bracket_cell.runs.run import run
from bracket_ground.errors import InputError
from bracket_ground.interfaces.planning import AssemblyState
from bracket_ground.interfaces.resume import ResumeState
from bracket_sim.process.messages import Drawn
from tests import ROOT

PRODUCT = load_product(load_configuration())
CASE = ROOT / "tests" / "cases" / "assembly-g0-seed5.mcap"
G0 = dict(PRODUCT.goal_placements("g0"))


def after(*notes: tuple[str, dict[str, Any]]) -> ResumeState:
    left = ResumeState()
    for topic, fields in notes:
        left = _after(left, topic, fields, PRODUCT)
    return left


def test_a_whole_assembly_is_known_from_its_log() -> None:
    left = read_resume_state(CASE, PRODUCT)
    assert dict(left.graph.placed) == G0
    assert left.held_part in PRODUCT.parts
    assert (left.bracket, left.ended) == (0, False)
    assert ResumeState.of(left.plain()) == left
    assert left.summary.startswith("o1 at p1, o1 at p2, ")
    assert left.summary.endswith(f"; {left.held_part} was picked last")


def test_where_a_shift_was_left_off_is_told_in_words() -> None:
    assert ResumeState().summary == "nothing is placed"
    assert ResumeState(AssemblyState({"p5": "o3"}), bracket=2).summary == "bracket 2; o3 at p5"
    assert ResumeState(AssemblyState({"p5": "o3"}), bracket=2, ended=True).summary == "bracket 2; nothing is placed"


def test_a_log_of_another_product_is_refused() -> None:
    with pytest.raises(InputError, match="this one is with 'another'"):
        read_resume_state(CASE, PRODUCT.model_copy(update={"name": "another"}))


def test_edges_that_were_taken_back_and_brackets_that_ended_are_followed() -> None:
    first = ("bracket", {"number": 1, "edge": "begin"})
    put = ("belief", {"edge": ["o1", "p1"], "source": "action"})
    assert after(first, put).state.placed == {"p1": "o1"}
    assert after(first, put, ("belief", {"edge": [None, "p1"], "source": "seen hole"})).state.placed == {}
    ended = ("bracket", {"number": 1, "edge": "end", "finished": True, "placed": G0, "goal": "g0"})
    assert (after(first, put, ended).ended, after(first, put, ended).state.placed) == (True, {})
    second = after(first, put, ended, ("bracket", {"number": 2, "edge": "begin"}), ("belief", {"told": "g1"}))
    assert (second.bracket, second.ended, second.state.told_goal, second.state.placed) == (2, False, "g1", {})


def test_what_was_taken_out_and_put_back_is_not_taken_out_any_more() -> None:
    gone = ("belief", {"edge": [None, "p1"], "source": "seen hole"}), ("belief", {"taken_out": {"p1": "o1"}})
    assert after(*gone).state.taken_out == {"p1": "o1"}
    back = after(*gone, ("belief", {"edge": ["o1", "p1"], "source": "action"})).state
    assert (back.placed, back.taken_out) == ({"p1": "o1"}, {})


def test_a_goal_that_was_learned_is_learned_again() -> None:
    ended = ("bracket", {"number": 1, "edge": "end", "finished": True, "placed": G0, "goal": "new1"})
    assert after(ended, ended).finished == (tuple(G0[position] for position in PRODUCT.positions),)


def test_what_is_held_is_read_from_the_memory_of_the_nodes() -> None:
    taken = ("memory", {"held_part": "o2"})
    assert after(taken, ("memory", {"held_lying": False})).held_part == "o2"
    assert after(("skill", {"reason": "grasping o1"})).held_part == "o1", "older logs have only the words of the skills"


def test_a_log_of_before_has_the_graph_among_the_other_fields() -> None:
    plain = {"placed": {"p1": "o1"}, "told_goal": "g0", "bracket": 2, "ended": False, "held_part": None, "finished": []}
    more = {"kept": {"p2": None}, "known_wrong": {}, "told_parts": {}, "taken_out": {}}
    left = ResumeState(AssemblyState({"p1": "o1"}, "g0", kept={"p2": None}), 2)
    assert ResumeState.of({**plain, **more}) == left
    assert ResumeState.of(json.loads(json.dumps(left.plain()))) == left


def test_a_resumed_bracket_keeps_what_was_known_of_it() -> None:
    begun = ("bracket", {"number": 2, "edge": "begin"})
    put = ("belief", {"edge": ["o1", "p1"], "source": "action"})
    left = after(begun, put, ("bracket", {"number": 2, "edge": "begin", "resumed": True}))
    assert (left.bracket, left.state.placed) == (2, {"p1": "o1"})


@pytest.mark.parametrize(("bound", "there"), [(False, False), (True, False), (True, True)])
def test_a_run_says_what_it_goes_on_with_and_in_which_world(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bound: bool, there: bool
) -> None:
    address, said = tmp_path / "world.sock", io.StringIO()
    options: list[RunOptions] = []
    monkeypatch.setattr("bracket_cell.runs.run.world_of", lambda _: address)
    monkeypatch.setattr("bracket_cell.runs.run._run", lambda _, asked, *__: options.append(asked))
    if there:
        monkeypatch.setattr("bracket_sim.process.opening.drawn_from", lambda _: Drawn(17, "g1"))
    with socket.socket(socket.AF_UNIX) as killed:
        if bound:
            killed.bind(str(address))
    assert address.is_socket() == bound
    run(RunOptions(resume=CASE, log=tmp_path / "l.mcap"), Console(file=said, width=1000))
    assert f"goes on with {CASE}: o1 at p1, " in said.getvalue()
    assert (f"the world at {address} is gone" in said.getvalue()) != there
    assert [(asked.world, asked.seed) for asked in options] == [(address, 17) if there else (None, RunOptions().seed)]
