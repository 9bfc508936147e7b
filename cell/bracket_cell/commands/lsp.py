"""`cell lsp`: the language server of tree files, which editors start and talk to over stdin and stdout.

The protocol is in: https://microsoft.github.io/language-server-protocol.
"""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bracket_cell.commands.options import NamesOption, WithOption, always_loaded, beside_config, registry_of, user_files
from bracket_cell.packages import needed, version
from bracket_ground.errors import InputError
from btxml.engine.errors import Place, Problem, TreeFileError
from btxml.engine.literals import type_name
from btxml.files.check import Circumstances, findings
from btxml.files.compile.registry import Registry
from btxml.files.parse.library import Library, read_library
from btxml.views.cures import cures
from btxml.views.editing import Offer, definition, hover, offers, prefix_start, word_end
from btxml.views.symbols import Heading, Symbol, Symbols, links, outline, related

if TYPE_CHECKING:
    from lsprotocol import types
    from pygls.lsp.server import LanguageServer
    from pygls.workspace import TextDocument

PAUSE_S = (0.2, 2.0)  # after a keystroke, before a check: at least as long as nobody notices, at most to be of use
CHECKS_PAUSE = 2.0  # the pause in times of the last check, so that checks take less than a third of a processor


class Workshop:
    """What the server knows of the nodes, and what it told the editor.

    Attributes:
        complaint: why the newest state of the user's nodes cannot be loaded; those before it count.
        told: by open file, those that have marks because of it.
        marks: by file, what is marked there, and where.
    """

    def __init__(self, config: Path | None, own: Iterable[str] | None) -> None:
        self._config = config or beside_config()
        self._nodes, self.beside = user_files(own)
        self._registry: Registry | None = None
        self._stamps: list[float] = []
        self.complaint = ""
        self.told: dict[Path, set[Path]] = {}
        self.marks: dict[Path, list[tuple[Problem, types.Diagnostic]]] = {}
        self._turns: dict[str, int] = {}
        self._pause_s = PAUSE_S[0]

    @property
    def registry(self) -> Registry:
        """The nodes as they are now: made again when a file of theirs, or the configuration, was saved."""
        files = [self._config] if self._config else []
        for path in map(Path, (*self._nodes, *always_loaded())):
            files += [path, *path.glob("*.py")]
        stamps = [file.stat().st_mtime for file in files if file.is_file()]
        if self._registry is None or stamps != self._stamps:
            self._stamps = stamps
            try:
                self._registry, self.complaint = registry_of(self._config, self._nodes), ""
            except InputError as error:
                self.complaint = str(error)
                self._registry = self._registry or registry_of(None, ())
        return self._registry

    async def check(self, uri: str, now: bool, check: Callable[[], None]) -> None:
        """Check a file after a pause in typing; a check that a later keystroke has overtaken is never begun."""
        turn = self._turns[uri] = self._turns.get(uri, 0) + 1
        if not now:
            await asyncio.sleep(self._pause_s)
        if self._turns[uri] == turn:
            began_s = time.process_time()
            check()
            self._pause_s = min(max(PAUSE_S[0], CHECKS_PAUSE * (time.process_time() - began_s)), PAUSE_S[1])


def lsp(config: NamesOption = None, own: WithOption = None) -> None:
    """Serve an editor: the language server of tree files."""
    needed("pygls.lsp.server", "the language server", "editor")
    server = language_server(Workshop(config, own))
    answers, sys.stdout = sys.stdout, sys.stderr  # what a node of the user's prints is no message to the editor
    server.start_io(sys.stdin.buffer, answers.buffer)


def language_server(shop: Workshop) -> LanguageServer:
    """The server, before it is started."""
    from lsprotocol import types
    from pygls.lsp.server import LanguageServer

    server = LanguageServer("cell", version())

    @server.feature(types.TEXT_DOCUMENT_DID_OPEN)
    @server.feature(types.TEXT_DOCUMENT_DID_CHANGE)
    @server.feature(types.TEXT_DOCUMENT_DID_SAVE)
    async def changed(
        parameters: types.DidOpenTextDocumentParams
        | types.DidChangeTextDocumentParams
        | types.DidSaveTextDocumentParams,
    ) -> None:
        uri, typed = parameters.text_document.uri, isinstance(parameters, types.DidChangeTextDocumentParams)
        await shop.check(uri, not typed, lambda: _mark(server, shop, server.workspace.get_text_document(uri)))

    @server.feature(types.TEXT_DOCUMENT_DID_CLOSE)
    def closed(parameters: types.DidCloseTextDocumentParams) -> None:
        for path in shop.told.pop(_path(parameters.text_document.uri), ()):
            shop.marks.pop(path, None)
            server.text_document_publish_diagnostics(types.PublishDiagnosticsParams(path.as_uri(), []))

    @server.feature(types.TEXT_DOCUMENT_COMPLETION, types.CompletionOptions(trigger_characters=list('<{" @')))
    def complete(parameters: types.CompletionParams) -> list[types.CompletionItem]:
        document, offset, library = _asked(server, shop, parameters)
        start = document.client_position_at_offset(prefix_start(document.source, offset))
        place = types.Range(start, parameters.position)
        found = offers(document.source, offset, _path(document.uri), shop.registry, library)
        return [_item(offer, place) for offer in found]

    @server.feature(types.TEXT_DOCUMENT_HOVER)
    def explain(parameters: types.HoverParams) -> types.Hover | None:
        document, offset, library = _asked(server, shop, parameters)
        text = hover(document.source, offset, shop.registry, library)
        if not text and (named := _named(server, shop, parameters)) is not None:
            text = _mentioned(*named)
        return types.Hover(types.MarkupContent(types.MarkupKind.Markdown, f"```\n{text}\n```")) if text else None

    @server.feature(types.TEXT_DOCUMENT_DEFINITION)
    def made(parameters: types.DefinitionParams) -> types.Location | None:
        document, offset, library = _asked(server, shop, parameters)
        named = _named(server, shop, parameters)
        if named is not None and named[1].entry and (mention := named[0].made(named[1])) is not None:
            return _location(server, mention.place, 0)
        place = definition(document.source, offset, _path(document.uri), shop.registry, library)
        return None if place is None or place.line is None else _location(server, place, 0)

    _navigation(server, shop)
    _cures(server, shop)
    return server


def _navigation(server: LanguageServer, shop: Workshop) -> None:
    """References, renaming, the outline and links of a file."""
    from lsprotocol import types

    @server.feature(types.TEXT_DOCUMENT_REFERENCES)
    def references(parameters: types.ReferenceParams) -> list[types.Location]:
        named = _named(server, shop, parameters)
        found = [] if named is None else named[0].of(named[1])
        also = parameters.context.include_declaration
        return [_location(server, mention.place, mention.length) for mention in found if also or mention.role != "made"]

    @server.feature(types.TEXT_DOCUMENT_RENAME)
    def rename(parameters: types.RenameParams) -> types.WorkspaceEdit | None:
        named = _named(server, shop, parameters)
        try:
            if named is None:
                raise TreeFileError("only trees and entries can be renamed; nodes and ports are classes of Python")
            edits: dict[str, list[types.TextEdit]] = {}
            for mention, text in named[0].renamed(named[1], parameters.new_name):
                at = _location(server, mention.place, mention.length)
                edits.setdefault(at.uri, []).append(types.TextEdit(at.range, text))
        except TreeFileError as error:
            server.window_show_message(types.ShowMessageParams(types.MessageType.Error, str(error)))
            return None
        return types.WorkspaceEdit(edits)

    @server.feature(types.TEXT_DOCUMENT_DOCUMENT_SYMBOL)
    def symbols(parameters: types.DocumentSymbolParams) -> list[types.DocumentSymbol]:
        document = server.workspace.get_text_document(parameters.text_document.uri)
        root = related(_path(document.uri), None, _opened(server)).get(_path(document.uri))
        return [] if root is None else [_symbol(document, heading) for heading in outline(root)]

    @server.feature(types.TEXT_DOCUMENT_DOCUMENT_LINK)
    def linked(parameters: types.DocumentLinkParams) -> list[types.DocumentLink]:
        path = _path(parameters.text_document.uri)
        root = related(path, None, _opened(server)).get(path)
        found = [] if root is None else links(root, path)
        return [
            types.DocumentLink(_location(server, attribute.value_place, len(attribute.source)).range, file.as_uri())
            for attribute, file in found
        ]


def _cures(server: LanguageServer, shop: Workshop) -> None:
    from lsprotocol import types

    @server.feature(types.TEXT_DOCUMENT_CODE_ACTION, types.CodeActionOptions([types.CodeActionKind.QuickFix]))
    def mend(parameters: types.CodeActionParams) -> list[types.CodeAction]:
        document, asked = server.workspace.get_text_document(parameters.text_document.uri), parameters.range
        found: list[types.CodeAction] = []
        for problem, mark in shop.marks.get(_path(document.uri), ()):
            offered = cures(problem, document.source) if _meet(mark.range, asked) else []
            for cure in offered:
                edits = [types.TextEdit(_between(document, *edit[:2]), edit.text) for edit in cure.edits]
                change = types.WorkspaceEdit({document.uri: edits})
                alone = len(offered) == 1
                kind = types.CodeActionKind.QuickFix
                found.append(types.CodeAction(cure.title, kind, [mark], is_preferred=alone, edit=change))
        return found


def _named(
    server: LanguageServer,
    shop: Workshop,
    parameters: types.HoverParams | types.DefinitionParams | types.ReferenceParams | types.RenameParams,
) -> tuple[Symbols, Symbol] | None:
    """What the cursor is on, a tree or an entry, among the files that have to do with this one."""
    document = server.workspace.get_text_document(parameters.text_document.uri)
    before = document.source[: document.offset_at_position(parameters.position)]
    path, folder = _path(document.uri), server.workspace.root_path
    library = read_library(path, shop.beside, _opened(server))
    texts = {file.resolve(): text for file, text in library.texts.items()}
    roots = related(path, Path(folder) if folder else path.parent, texts)
    symbols = Symbols(roots, shop.registry, library.main)
    symbol = symbols.at(path, before.count("\n") + 1, len(before) - before.rfind("\n"))
    return None if symbol is None else (symbols, symbol)


def _mentioned(symbols: Symbols, symbol: Symbol) -> str:
    """What an entry holds, who writes it and who reads it."""
    kinds = dict.fromkeys(type_name(port.kind) for port in symbols.ports(symbol))
    title = f"{symbol.entry or symbol.tree}  [{'entry of ' + symbol.tree if symbol.entry else 'SubTree'}]"
    lines = [
        f"    {mention.role} by {mention.by} at {mention.place.file.name}:{mention.place.line}"
        for mention in symbols.of(symbol)
    ]
    return "\n".join([title, *([f"    {', '.join(kinds)}"] if kinds else []), *dict.fromkeys(lines)])


def _asked(
    server: LanguageServer,
    shop: Workshop,
    parameters: types.CompletionParams | types.HoverParams | types.DefinitionParams,
) -> tuple[TextDocument, int, Library]:
    """The document, where in it the cursor is, and the trees that it can name."""
    document = server.workspace.get_text_document(parameters.text_document.uri)
    library = read_library(_path(document.uri), shop.beside, _opened(server))
    return document, document.offset_at_position(parameters.position), library


def _mark(server: LanguageServer, shop: Workshop, document: TextDocument) -> None:
    """Tell everything that is wrong with a file, and with what it includes."""
    from lsprotocol import types

    path = _path(document.uri)
    if path.suffix != ".xml":
        return
    known = Circumstances(shop.beside, opened=_opened(server))
    found = findings([path], shop.registry, known)
    if shop.complaint:
        server.window_show_message(types.ShowMessageParams(types.MessageType.Error, shop.complaint))
    marks: dict[Path, list[tuple[Problem, types.Diagnostic]]] = {file: [] for file in {path, *shop.told.get(path, ())}}
    levels = (types.DiagnosticSeverity.Error, types.DiagnosticSeverity.Warning, types.DiagnosticSeverity.Information)
    for level, problems in zip(levels, found, strict=True):
        for problem in problems:
            file = problem.place.file.resolve()
            text = server.workspace.get_text_document(file.as_uri())
            what = f"{problem.what}; {problem.legal}" if problem.legal else problem.what
            marks.setdefault(file, []).append(
                (problem, types.Diagnostic(_range(text, problem), what, level, source="cell"))
            )
    shop.told[path] = {file for file, some in marks.items() if some}
    shop.marks |= marks
    for file, some in marks.items():
        params = types.PublishDiagnosticsParams(file.as_uri(), [mark for _, mark in some])
        server.text_document_publish_diagnostics(params)


def _range(document: TextDocument, problem: Problem) -> types.Range:
    """The word at which a problem stands."""
    start = _start(document, problem.place)
    return _between(document, start, word_end(document.source, start))


def _start(document: TextDocument, place: Place) -> int:
    """The offset of a place in a text, which may have become shorter."""
    lines = document.lines
    line = min((place.line or 1) - 1, max(0, len(lines) - 1))
    return min(sum(map(len, lines[:line])) + (place.column or 1) - 1, len(document.source))


def _between(document: TextDocument, start: int, end: int) -> types.Range:
    from lsprotocol import types

    return types.Range(*(document.client_position_at_offset(min(at, len(document.source))) for at in (start, end)))


def _location(server: LanguageServer, place: Place, length: int) -> types.Location:
    from lsprotocol import types

    uri = place.file.resolve().as_uri()
    document = server.workspace.get_text_document(uri)
    start = _start(document, place)
    return types.Location(uri, _between(document, start, start + length))


def _symbol(document: TextDocument, heading: Heading) -> types.DocumentSymbol:
    from lsprotocol import types

    place, text = heading.element.place, document.source
    start, end = _start(document, place), len(text) if heading.end is None else _start(document, heading.end)
    kind = types.SymbolKind.Module if heading.element.tag == "BehaviorTree" else types.SymbolKind.Object
    below: Sequence[types.DocumentSymbol] = [_symbol(document, inner) for inner in heading.below]
    whole = _between(document, start, start + len(text[start:end].rstrip()))
    return types.DocumentSymbol(
        heading.title or "?", kind, whole, _between(document, start, word_end(text, start)), children=below
    )


def _meet(one: types.Range, other: types.Range) -> bool:
    return one.start <= other.end and other.start <= one.end


def _item(offer: Offer, place: types.Range) -> types.CompletionItem:
    from lsprotocol import types

    kinds = {
        "node": types.CompletionItemKind.Class,
        "port": types.CompletionItemKind.Property,
        "condition": types.CompletionItemKind.Event,
        "entry": types.CompletionItemKind.Variable,
        "value": types.CompletionItemKind.EnumMember,
        "tree": types.CompletionItemKind.Module,
    }
    return types.CompletionItem(
        offer.label,
        kind=kinds[offer.kind],
        detail=offer.about or None,
        filter_text=offer.snippet if offer.snippet.startswith("<") else offer.label,
        insert_text_format=types.InsertTextFormat.Snippet if "$" in offer.snippet else types.InsertTextFormat.PlainText,
        text_edit=types.TextEdit(place, offer.snippet or offer.label),
    )


def _opened(server: LanguageServer) -> dict[Path, str]:
    return {_path(document.uri): document.source for document in server.workspace.text_documents.values()}


def _path(uri: str) -> Path:
    from pygls.uris import to_fs_path

    return Path(to_fs_path(uri) or uri).resolve()
