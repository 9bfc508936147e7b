"""What an assistant is offered, tried by the protocol's own client."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

from bracket_cell.commands.main import main
from tests import ROOT

mcp = pytest.importorskip("mcp", reason="the extra assistant is not installed")
from bracket_cell.serving.assistant import assistant_server  # noqa: E402 - without the extra it is of no use

pytestmark = pytest.mark.filterwarnings("ignore")  # the library's own


def asked(tool: str, **values: Any) -> tuple[bool, str]:
    """Whether a tool failed, and what it said."""

    async def ask() -> tuple[bool, str]:
        async with mcp.Client(assistant_server()) as client:
            answer = await client.call_tool(tool, values)
            return bool(answer.is_error), "".join(part.text for part in answer.content)

    return asyncio.run(ask())


def test_every_tool_says_what_it_is_for() -> None:
    async def listed() -> list[Any]:
        async with mcp.Client(assistant_server()) as client:
            return list((await client.list_tools()).tools)

    tools = asyncio.run(listed())
    assert {tool.name for tool in tools} == {"nodes", "check", "simulate", "why", "logs", "compare_logs", "guide"}
    assert all(tool.description for tool in tools)


def test_a_tree_is_checked_and_nodes_and_guides_are_read(tmp_path: Path) -> None:
    tree = tmp_path / "wrong.xml"
    tree.write_text(
        '<root BTCPP_format="4" main_tree_to_execute="A"><BehaviorTree ID="A"><Nonsense/></BehaviorTree></root>'
    )
    failed, told = asked("check", tree=str(tree))
    assert not failed
    assert told.startswith("status 2")
    assert "Nonsense" in json.dumps(json.loads(told.partition("\n")[2]))
    assert "MoveTo" in asked("nodes")[1]
    assert "shift" in asked("guide")[1]
    assert asked("check", tree="--help")[1].startswith("status 2"), "a name is never an option"


def test_a_real_cell_is_not_run() -> None:
    failed, told = asked(
        "simulate", tree=str(ROOT / "trees/ahead.xml"), seed=1, config=str(ROOT / "config/twin_cell.yaml")
    )
    assert not failed
    assert told.startswith("status 2")
    assert "real devices" in told


def test_a_new_folder_says_how_an_assistant_works_there(tmp_path: Path) -> None:
    assert main(["init", str(tmp_path / "mine")]) == 0
    told = (tmp_path / "mine" / "AGENTS.md").read_text()
    assert "cell check" in told
