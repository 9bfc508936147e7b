"""`cell lsp`, asked by a client of the protocol as an editor asks it."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from lsprotocol import types
from pygls.lsp.client import LanguageClient

from tests import ROOT

LIMIT_S = 60.0  # for an answer, on a machine that does much else
TREE = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <include path="more.xml"/>
  <BehaviorTree ID="Main">
    <Sequence>
      <SubTree ID="Fetch" part="{part}"/>
      <Greet who="äöü" whom="{part}"/>
      <MoveTo pose="park"/>
    </Sequence>
  </BehaviorTree>
</root>
"""
MORE = """<root BTCPP_format="4">
  <BehaviorTree ID="Fetch">
    <Script code="part := 'o1'"/>
  </BehaviorTree>
</root>
"""
NODE = '''from btxml import InputPort, Node, Status
from bracket_cell.trees.vocabulary import Hole, Part


class Greet(Node):
    """Say hello."""

    who = InputPort(str, "who is greeted")
    whom = InputPort(Part, "a part", optional=True)
    where = InputPort(list[Hole], "some holes", optional=True)

    def update(self) -> Status:
        return Status.SUCCESS
'''


Talk = Callable[[Callable[["Editor"], Awaitable[None]]], None]


class Editor:
    """An editor with one tree file open.

    Attributes:
        marks: the newest diagnostics by file name.
    """

    def __init__(self, client: LanguageClient, folder: Path) -> None:
        self._client, self._folder = client, folder
        self.uri = (folder / "tree.xml").as_uri()
        self.marks: dict[str, list[types.Diagnostic]] = {}
        self._told = asyncio.Event()
        self._version = 0

        @client.feature(types.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)  # type: ignore[untyped-decorator]  # pygls leaves it so
        def marked(parameters: types.PublishDiagnosticsParams) -> None:
            self.marks[parameters.uri.rpartition("/")[2]] = list(parameters.diagnostics)
            if parameters.uri == self.uri:
                self._told.set()

    async def open(self) -> None:
        await self._client.initialize_async(types.InitializeParams(types.ClientCapabilities(), None, None))
        self._client.initialized(types.InitializedParams())
        item = types.TextDocumentItem(self.uri, "xml", 0, TREE)
        self._client.text_document_did_open(types.DidOpenTextDocumentParams(item))
        await self.told()

    async def told(self) -> None:
        """Wait until the marks of what was typed last have come."""
        await asyncio.wait_for(self._told.wait(), LIMIT_S)
        self._told.clear()

    async def type(self, text: str) -> None:
        """Make this the whole text."""
        self._version += 1
        document = types.VersionedTextDocumentIdentifier(self._version, self.uri)
        change = types.TextDocumentContentChangeWholeDocument(text)
        self._client.text_document_did_change(types.DidChangeTextDocumentParams(document, [change]))
        await self.told()

    async def offers(self, before: str) -> dict[str, str]:
        """What is offered where `before` is being written after MoveTo: what is inserted, by label."""
        text = TREE.replace('<MoveTo pose="park"/>', f'<MoveTo pose="park"/>\n{before}')
        await self.type(text)
        line = text[: text.index(before, text.index("park"))].count("\n")
        where = types.CompletionParams(types.TextDocumentIdentifier(self.uri), types.Position(line, len(before)))
        found = await asyncio.wait_for(self._client.text_document_completion_async(where), LIMIT_S)
        assert isinstance(found, list)
        return {one.label: one.text_edit.new_text for one in found if one.text_edit is not None}

    async def ask(self, way: str, word: str, extra: int = 1) -> Any:
        """Hover or definition at a word of the file."""
        before = TREE[: TREE.index(word) + extra]
        position = types.Position(before.count("\n"), len(before) - before.rfind("\n") - 1)
        kind = types.HoverParams if way == "hover" else types.DefinitionParams
        call: Callable[[Any], Awaitable[Any]] = getattr(self._client, f"text_document_{way}_async")
        return await asyncio.wait_for(call(kind(types.TextDocumentIdentifier(self.uri), position)), LIMIT_S)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "nodes").mkdir()
    for name, text in {"tree.xml": TREE, "more.xml": MORE, "nodes/greet.py": NODE}.items():
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.fixture
def talk(folder: Path) -> Talk:
    """Runs a conversation with a server of its own."""

    def run(conversation: Callable[[Editor], Awaitable[None]]) -> None:
        async def whole() -> None:
            client = LanguageClient("test", "1")
            arguments = ("--config", str(ROOT / "config" / "cell.yaml"), "--with", str(folder / "nodes"))
            await client.start_io(sys.executable, "-m", "bracket_cell", "lsp", *arguments)
            editor = Editor(client, folder)
            try:
                await editor.open()
                await conversation(editor)
            finally:
                await asyncio.wait_for(client.shutdown_async(None), LIMIT_S)
                client.exit(None)
                await client.stop()  # type: ignore[no-untyped-call]

        asyncio.run(whole())

    return run


def test_an_editor_is_served(folder: Path, talk: Talk) -> None:
    async def conversation(editor: Editor) -> None:
        assert editor.marks == {"tree.xml": []}
        await marks_while_typing(editor)
        await completion(editor)
        await words(editor)
        await places(editor, folder)
        (folder / "nodes" / "greet.py").write_text(NODE.replace("who =", "name_of ="))
        await editor.type(TREE)
        assert [one.message.partition(";")[0] for one in editor.marks["tree.xml"]] == [
            "Greet needs port 'name_of'",
            "Greet has no port 'who'",
        ]

    talk(conversation)


async def marks_while_typing(editor: Editor) -> None:
    """The word that is wrong is marked, in the units of the protocol; a mark goes when its mistake goes."""
    await editor.type(TREE.replace("MoveTo", "MoveTu"))
    (mark,) = editor.marks["tree.xml"]
    assert (mark.range.start, mark.range.end) == (types.Position(6, 6), types.Position(6, 13))
    assert "did you mean 'MoveTo'?" in mark.message
    assert mark.severity is types.DiagnosticSeverity.Error
    await editor.type(TREE.replace('"{part}"/>\n      <Move', '"o77"/>\n      <Move'))
    (mark,) = editor.marks["tree.xml"]
    assert mark.message.startswith("the product has no part type 'o77'")
    assert mark.range.start == types.Position(5, 29)
    await editor.type(TREE.replace("</Sequence>", ""))
    assert "must come first" in editor.marks["tree.xml"][0].message
    await editor.type(TREE)
    assert editor.marks == {"tree.xml": []}


async def completion(editor: Editor) -> None:
    """Nodes, ports, entries, parts, holes, trees, from what is written so far."""
    nodes = await editor.offers("<Gre")
    assert nodes["Greet"] == 'Greet who="$1"/>'
    assert nodes["Fallback"] == "Fallback>$0</Fallback>"
    assert (await editor.offers("<Greet w"))["whom"] == 'whom="$1"'
    assert "who" not in await editor.offers("<Greet who='x' w")
    assert {"o1", "o2", "{part}"} <= set(await editor.offers('<Greet whom="'))
    assert (await editor.offers('<Greet who="{pa'))["part"] == "part}"
    assert {"p1", "p2"} <= set(await editor.offers('<Greet where="p1;'))
    assert {"Main", "Fetch"} == set(await editor.offers('<SubTree ID="'))
    assert {"part", "SUCCESS"} <= set(await editor.offers('<Script code="pa'))
    assert {"park", "look"} <= set(await editor.offers('<MoveTo pose="'))


async def words(editor: Editor) -> None:
    assert "Greet  [Action]\n    Say hello." in (await editor.ask("hover", "<Greet")).contents.value
    assert "who is greeted" in (await editor.ask("hover", 'who="')).contents.value
    assert "Fetch  [SubTree]" in (await editor.ask("hover", 'Fetch"')).contents.value
    assert await editor.ask("hover", "äöü") is not None


async def places(editor: Editor, folder: Path) -> None:
    for word, file, line in (("<SubTree", "more.xml", 1), ("<Greet", "nodes/greet.py", 4), ("<include", "more.xml", 0)):
        found = await editor.ask("definition", word)
        assert (found.uri, found.range.start.line) == ((folder / file).as_uri(), line)
