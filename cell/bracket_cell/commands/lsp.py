"""`cell lsp`: the language server of tree files, which editors start and talk to over stdin and stdout.

The protocol is in: https://microsoft.github.io/language-server-protocol.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from bracket_cell.commands.options import NamesOption, WithOption, always_loaded, beside_config, own_files, registry_of
from bracket_cell.packages import needed, version
from bracket_ground.errors import InputError
from btxml.engine.errors import Problem
from btxml.files.check import Circumstances, findings
from btxml.files.compile.registry import Registry
from btxml.files.parse.library import Library, read_library
from btxml.views.editing import Offer, definition, hover, offers, prefix_start, word_end

if TYPE_CHECKING:
    from lsprotocol import types
    from pygls.lsp.server import LanguageServer
    from pygls.workspace import TextDocument


class Workshop:
    """What the server knows of the nodes, and what it told the editor.

    Attributes:
        complaint: why the newest state of the user's nodes cannot be loaded; those before it count.
    """

    def __init__(self, config: Path | None, own: Iterable[str] | None) -> None:
        self._config = config or beside_config()
        self._nodes, self.beside = own_files(own)
        self._registry: Registry | None = None
        self._stamps: list[float] = []
        self.complaint = ""
        self.told: dict[Path, set[Path]] = {}  # by open file, those that have marks because of it

    @property
    def registry(self) -> Registry:
        """The nodes as they are now: made again when a file of theirs, or the configuration, was saved."""
        files = [self._config] if self._config else []
        for one in map(Path, (*self._nodes, *always_loaded())):
            files += [one, *one.glob("*.py")]
        stamps = [file.stat().st_mtime for file in files if file.is_file()]
        if self._registry is None or stamps != self._stamps:
            self._stamps = stamps
            try:
                self._registry, self.complaint = registry_of(self._config, self._nodes), ""
            except InputError as error:
                self.complaint = str(error)
                self._registry = self._registry or registry_of(None, ())
        return self._registry


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
    def changed(parameters: types.DidOpenTextDocumentParams) -> None:
        _mark(server, shop, server.workspace.get_text_document(parameters.text_document.uri))

    @server.feature(types.TEXT_DOCUMENT_DID_CLOSE)
    def closed(parameters: types.DidCloseTextDocumentParams) -> None:
        for path in shop.told.pop(_path(parameters.text_document.uri), ()):
            server.text_document_publish_diagnostics(types.PublishDiagnosticsParams(path.as_uri(), []))

    @server.feature(types.TEXT_DOCUMENT_COMPLETION, types.CompletionOptions(trigger_characters=list('<{" @')))
    def complete(parameters: types.CompletionParams) -> list[types.CompletionItem]:
        document, offset, library = _asked(server, shop, parameters)
        start = document.client_position_at_offset(prefix_start(document.source, offset))
        place = types.Range(start, parameters.position)
        found = offers(document.source, offset, shop.registry, library)
        return [_item(one, place) for one in found]

    @server.feature(types.TEXT_DOCUMENT_HOVER)
    def explain(parameters: types.HoverParams) -> types.Hover | None:
        document, offset, library = _asked(server, shop, parameters)
        text = hover(document.source, offset, shop.registry, library)
        return types.Hover(types.MarkupContent(types.MarkupKind.Markdown, f"```\n{text}\n```")) if text else None

    @server.feature(types.TEXT_DOCUMENT_DEFINITION)
    def made(parameters: types.DefinitionParams) -> types.Location | None:
        document, offset, library = _asked(server, shop, parameters)
        place = definition(document.source, offset, _path(document.uri), shop.registry, library)
        if place is None or place.line is None:
            return None
        start = types.Position(place.line - 1, (place.column or 1) - 1)
        return types.Location(place.file.resolve().as_uri(), types.Range(start, start))

    return server


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
    marks: dict[Path, list[types.Diagnostic]] = {one: [] for one in {path, *shop.told.get(path, ())}}
    levels = (types.DiagnosticSeverity.Error, types.DiagnosticSeverity.Warning, types.DiagnosticSeverity.Information)
    for level, problems in zip(levels, found, strict=True):
        for one in problems:
            file = one.place.file.resolve()
            text = server.workspace.get_text_document(file.as_uri())
            what = f"{one.what}; {one.legal}" if one.legal else one.what
            marks.setdefault(file, []).append(types.Diagnostic(_range(text, one), what, level, source="cell"))
    shop.told[path] = {file for file, some in marks.items() if some}
    for file, some in marks.items():
        server.text_document_publish_diagnostics(types.PublishDiagnosticsParams(file.as_uri(), some))


def _range(document: TextDocument, problem: Problem) -> types.Range:
    """The word at which a problem stands."""
    from lsprotocol import types

    place, lines = problem.place, document.lines
    line = min((place.line or 1) - 1, max(0, len(lines) - 1))
    start = sum(map(len, lines[:line])) + (place.column or 1) - 1
    end = word_end(document.source, start)
    return types.Range(*(document.client_position_at_offset(min(one, len(document.source))) for one in (start, end)))


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
