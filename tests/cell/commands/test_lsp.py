"""`cell lsp`, asked by a client of the protocol as an editor asks it."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import psutil
import pytest
from lsprotocol import types
from pygls.lsp.client import LanguageClient

from tests import ROOT

LIMIT_S = 60.0  # for an answer, on a machine that does much else
BURST_S = 0.5  # processor time that ten keystrokes may cost
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
DEEP = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <include path="more.xml"/>
  <BehaviorTree ID="Main">
    <Sequence name="all">
      <Script code="tries := 3; part := 'o1'"/>
      <SubTree ID="Own" what="{tries}" part="{=}"/>
      <SubTree ID="Own" _autoremap="true" what="2"/>
      <Greet who="{tries}" whom="{part}"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Own">
    <Sequence>
      <ScriptCondition code="what &gt; 1 &amp;&amp; @tries &gt; what"/>
      <Greet who="x" whom="{part}" _skipIf="what == 2"/>
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
        """Make this the whole text, and wait for what is wrong with it."""
        self.press(text)
        await self.told()

    def spent_s(self) -> float:
        """Processor time of the server."""
        assert self._client._server is not None
        times = psutil.Process(self._client._server.pid).cpu_times()
        return float(times.user + times.system)

    def press(self, text: str) -> None:
        """Make this the whole text."""
        self._version += 1
        document = types.VersionedTextDocumentIdentifier(self._version, self.uri)
        change = types.TextDocumentContentChangeWholeDocument(text)
        self._client.text_document_did_change(types.DidChangeTextDocumentParams(document, [change]))

    async def offers(self, before: str) -> dict[str, str]:
        """What is offered where `before` is being written after MoveTo: what is inserted, by label."""
        text = TREE.replace('<MoveTo pose="park"/>', f'<MoveTo pose="park"/>\n{before}')
        await self.type(text)
        line = text[: text.index(before, text.index("park"))].count("\n")
        where = types.CompletionParams(types.TextDocumentIdentifier(self.uri), types.Position(line, len(before)))
        found = await asyncio.wait_for(self._client.text_document_completion_async(where), LIMIT_S)
        assert isinstance(found, list)
        return {one.label: one.text_edit.new_text for one in found if one.text_edit is not None}

    async def offered(self, text: str, mark: str) -> set[str]:
        """What is offered behind a mark of a text."""
        await self.type(text)
        found = await self.call("completion", types.CompletionParams(self.document, at(text, mark, len(mark))))
        return {one.label for one in found}

    async def call(self, way: str, parameters: Any) -> Any:
        """Any question about the file."""
        call: Callable[[Any], Awaitable[Any]] = getattr(self._client, f"text_document_{way}_async")
        return await asyncio.wait_for(call(parameters), LIMIT_S)

    @property
    def document(self) -> types.TextDocumentIdentifier:
        return types.TextDocumentIdentifier(self.uri)

    async def ask(self, way: str, word: str, extra: int = 1) -> Any:
        """Hover or definition at a word of the file."""
        position = at(TREE, word, extra)
        kind = types.HoverParams if way == "hover" else types.DefinitionParams
        call: Callable[[Any], Awaitable[Any]] = getattr(self._client, f"text_document_{way}_async")
        return await asyncio.wait_for(call(kind(types.TextDocumentIdentifier(self.uri), position)), LIMIT_S)


def at(text: str, word: str, extra: int = 1) -> types.Position:
    """A position behind some characters of a word."""
    before = text[: text.index(word) + extra]
    return types.Position(before.count("\n"), len(before) - before.rfind("\n") - 1)


def changed(text: str, edits: list[types.TextEdit]) -> str:
    """A text after edits that do not meet."""
    for edit in sorted(
        edits, key=lambda text_edit: (text_edit.range.start.line, text_edit.range.start.character), reverse=True
    ):
        lines = text.split("\n")
        start, end = edit.range.start, edit.range.end
        head = [*lines[: start.line], lines[start.line][: start.character]]
        tail = [lines[end.line][end.character :], *lines[end.line + 1 :]]
        text = "\n".join(head) + edit.new_text + "\n".join(tail)
    return text


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


@pytest.mark.long
def test_an_editor_is_served(folder: Path, talk: Talk) -> None:
    async def conversation(editor: Editor) -> None:
        assert editor.marks == {"tree.xml": []}
        await marks_while_typing(editor)
        await completion(editor)
        await words(editor)
        await places(editor, folder)
        (folder / "nodes" / "greet.py").write_text(NODE.replace("who =", "name_of ="))
        await editor.type(TREE)
        assert [mark.message.partition(";")[0] for mark in editor.marks["tree.xml"]] == [
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


@pytest.mark.long
def test_trees_and_entries_are_found_and_renamed_wherever_they_are_named(folder: Path, talk: Talk) -> None:
    caller = (
        '<root BTCPP_format="4"><include path="tree.xml"/><BehaviorTree ID="Top"><SubTree ID="Own" part="o1" what="1"/>'
    )
    (folder / "caller.xml").write_text(f"{caller}</BehaviorTree></root>")

    async def conversation(editor: Editor) -> None:
        await editor.type(DEEP)
        assert editor.marks["tree.xml"] == []
        tree = types.ReferenceParams(types.ReferenceContext(True), editor.document, at(DEEP, 'ID="Own"', 5))
        places = [(one.uri.rpartition("/")[2], one.range.start.line) for one in await editor.call("references", tree)]
        assert sorted(places) == [("caller.xml", 0), ("tree.xml", 5), ("tree.xml", 6), ("tree.xml", 10)]
        renames = types.RenameParams(editor.document, at(DEEP, 'ID="Own"', 5), "Mine")
        edits = (await editor.call("rename", renames)).changes
        await editor.type(changed(DEEP, edits[editor.uri]))
        assert editor.marks["tree.xml"] == []
        new = changed((folder / "caller.xml").read_text(), edits[(folder / "caller.xml").as_uri()])
        assert '<SubTree ID="Mine"' in new

        await editor.type(DEEP)
        for word, offset, name, count in (("{tries}", 2, "n", 4), ("what &gt", 1, "w", 5), ("{part}", 2, "p", 4)):
            place = at(DEEP, word, offset)
            renamed = (await editor.call("rename", types.RenameParams(editor.document, place, name))).changes
            assert len(renamed[editor.uri]) == count
            await editor.type(changed(DEEP, renamed[editor.uri]))
            assert editor.marks["tree.xml"] == [], word
            await editor.type(DEEP)
        taken = types.RenameParams(editor.document, at(DEEP, "{tries}", 2), "part")
        assert await editor.call("rename", taken) is None

    talk(conversation)


@pytest.mark.long
def test_the_outline_links_hovers_and_offers_of_a_file(folder: Path, talk: Talk) -> None:
    async def conversation(editor: Editor) -> None:
        await editor.type(DEEP)
        found = await editor.call("document_symbol", types.DocumentSymbolParams(editor.document))
        assert [one.name for one in found] == ["Main", "Own"]
        assert [child.name for child in found[0].children[0].children][:2] == ["Script", "SubTree Own"]
        assert (found[0].range.start.line, found[0].range.end.line) == (2, 9)
        (link,) = await editor.call("document_link", types.DocumentLinkParams(editor.document))
        assert link.target == (folder / "more.xml").as_uri()
        assert (link.range.start, link.range.end) == (types.Position(1, 17), types.Position(1, 25))
        told = await editor.call("hover", types.HoverParams(editor.document, at(DEEP, "{tries}", 3)))
        assert "written by Script at tree.xml:5" in told.contents.value
        made = await editor.call("definition", types.DefinitionParams(editor.document, at(DEEP, "{tries}", 3)))
        assert made.range.start == types.Position(4, 20)
        assert {"o1", "o2", "{part}"} <= await editor.offered(DEEP.replace('part="{=}"', 'part=""'), 'part="')
        wanted = DEEP.replace('ID="Own" what="{tries}" part="{=}"', 'ID="Own" ')
        assert {"what", "part"} <= await editor.offered(wanted, 'ID="Own" ')
        assert await editor.offered(DEEP.replace("more.xml", ""), 'path="') == {"more.xml"}

    talk(conversation)


@pytest.mark.long
def test_what_is_wrong_is_mended_by_a_click(talk: Talk) -> None:
    async def conversation(editor: Editor) -> None:
        text = DEEP.replace("<Greet who", "<Great who").replace(" whom=", " whmo=")
        await editor.type(text)
        while editor.marks["tree.xml"]:
            mark = editor.marks["tree.xml"][0]
            context = types.CodeActionContext([mark])
            asked = types.CodeActionParams(editor.document, mark.range, context)
            found = await editor.call("code_action", asked)
            assert found, mark
            text = changed(text, found[0].edit.changes[editor.uri])
            await editor.type(text)
        assert text == DEEP

    talk(conversation)


@pytest.mark.long
def test_ten_keystrokes_cost_little(talk: Talk) -> None:
    """Each one makes the one before it needless, so that a large file is checked once or twice."""
    large = TREE.replace('<MoveTo pose="park"/>', '<MoveTo pose="park"/>' * 1000)

    async def conversation(editor: Editor) -> None:
        await editor.type(large)
        before_s = editor.spent_s()
        for number in range(10):
            editor.press(large + " " * number)
            await asyncio.sleep(0.1)
        await editor.told()
        assert editor.spent_s() - before_s < BURST_S

    talk(conversation)
