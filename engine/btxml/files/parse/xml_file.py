"""XML with the line and column of every element and attribute; hostile files are refused."""

from __future__ import annotations

import re
import stat
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from xml.parsers import expat
from xml.parsers.expat import errors

from btxml.engine.errors import Place, Problem, TreeFileError
from btxml.engine.literals import TRUE_WORDS

SIZE_LIMIT_BYTES = 1_000_000
DEPTH_LIMIT = 1_000
ATTRIBUTE_LIMIT = 100
ELEMENT_LIMIT = 10_000
ATTRIBUTES_LIMIT = 30_000  # in all elements together
FORMAT = "4"
EXPLICIT = ("Action", "Condition", "Control", "Decorator")

_NAME = re.compile(rb"(?<=</)[^\s>]*")
_TAG = re.compile(rb"<[^\s/>]+")
_ATTRIBUTE = re.compile(rb"\s+([^\s=]+)\s*=\s*([\"'])")
_CHARACTER = re.compile(r"&[^;]*;|\r\n|.", re.DOTALL)
CONDITIONS = ("_failureIf", "_successIf", "_skipIf", "_while")
SCRIPTS_AFTER = ("_onSuccess", "_onFailure", "_onHalted", "_post")
# Attributes that Groot2 writes for itself.
NOTES = ("_uid", "_description", "_fullpath")
_POINTER = re.compile(r"\s*\{([^{}]*)\}\s*\Z")
KEY = re.compile(r"@?[\w-][\w./-]*\Z")  # a script can name only those that begin with a letter


@dataclass(frozen=True)
class Attribute:
    """An attribute of an element.

    Attributes:
        place: where its name begins.
        value_place: where its value begins, inside the quotes.
        source: the value as the file writes it, with its `&lt;` and line breaks.
    """

    value: str
    place: Place
    value_place: Place
    source: str

    def place_at(self, offset: int) -> Place:
        """Where the character `offset` of the value stands."""
        if "&" not in self.source and "\r" not in self.source:
            return _after(self.value_place, self.source[:offset])
        characters = islice(_CHARACTER.finditer(self.source), offset)
        return _after(self.value_place, "".join(found[0] for found in characters))


@dataclass
class Element:
    """An element with all that is below it.

    Attributes:
        broken: something is wrong with it, so that nothing is known of what it does.
    """

    tag: str
    place: Place
    attributes: dict[str, Attribute] = field(default_factory=dict)
    children: list[Element] = field(default_factory=list)
    broken: bool = False

    def get(self, name: str) -> str | None:
        """An attribute's value."""
        attribute = self.attributes.get(name)
        return attribute.value if attribute else None

    def place_of(self, name: str) -> Place:
        """Where an attribute stands, or the element where it has none of that name."""
        attribute = self.attributes.get(name)
        return attribute.place if attribute else self.place


def node_tag(element: Element) -> str:
    """Which node an element stands for, in the compact form `<Foo/>` or the explicit one `<Action ID="Foo"/>`."""
    if element.tag in EXPLICIT:
        return element.get("ID") or ""
    return element.tag


def read_xml(path: Path, opened: str | None = None) -> tuple[str, Element, list[Problem]]:
    """The text of a file, its root element as far as it can be read, and what is wrong with it as XML.

    Args:
        opened: the text that an editor has open, which counts instead of the file's.

    Raises:
        TreeFileError: the file cannot be read, holds no element, or is refused: too large, too deep, with a DTD or
            entities.
    """
    data = _read(path) if opened is None else opened.encode(errors="replace")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise TreeFileError(Problem(Place(path, line), "this is not UTF-8 text", "save the file as UTF-8")) from None
    reader = _Reader(path, text)
    return text, reader.read(), reader.problems


def plain_files(folder: Path, pattern: str) -> list[Path]:
    """The files of a folder that match, by name; hidden ones, as editors leave them, and folders are none of them."""
    return sorted(file for file in folder.glob(pattern) if file.is_file() and not file.name.startswith("."))


def _read(path: Path) -> bytes:
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise TreeFileError(Problem(Place(path), "this is not a file", "give the path of a tree file"))
        if status.st_size > SIZE_LIMIT_BYTES:
            raise TreeFileError(
                Problem(Place(path), f"{status.st_size} bytes are too many", f"at most {SIZE_LIMIT_BYTES}")
            )
        return path.read_bytes()
    except OSError as error:
        raise TreeFileError(Problem(Place(path), f"cannot be read: {error.strerror}")) from None


class _Reader:
    """Builds elements from expat's events."""

    def __init__(self, path: Path, text: str) -> None:
        self._path = path
        self._data = text.encode()
        self._open: list[Element] = []
        self._count = self._attribute_count = 0
        self._root: Element | None = None
        self.problems: list[Problem] = []
        self._parser = parser = expat.ParserCreate("utf-8")
        parser.ordered_attributes = True
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._text
        parser.StartDoctypeDeclHandler = self._doctype

    def read(self) -> Element:
        try:
            self._parser.Parse(self._data, True)
        except expat.ExpatError as error:
            self.problems.append(self._malformed(error))
            for element in self._open:
                element.broken = True
        if self._root is None:
            raise TreeFileError(*self.problems)
        return self._root

    def _malformed(self, error: expat.ExpatError) -> Problem:
        """What expat refuses; a tag that closes nothing is reported with the one that is open."""
        place = Place(self._path, error.lineno, error.offset + 1)
        open_one = self._open[-1] if self._open else None
        if open_one is not None and error.code == errors.codes[errors.XML_ERROR_TAG_MISMATCH]:
            start = self._data.rindex(b"</", 0, self._parser.ErrorByteIndex + 2)
            name = _NAME.match(self._data, start + 2)
            what = f"</{name[0].decode() if name else ''}> closes <{open_one.tag}> of line {open_one.place.line}"
            head = self._data[:start].decode()
            return Problem(_after(Place(self._path, 1, 1), head), what, f"</{open_one.tag}> must come first")
        if open_one is not None and error.code == errors.codes[errors.XML_ERROR_NO_ELEMENTS]:
            what = f"the file ends, and <{open_one.tag}> of line {open_one.place.line} is not closed"
            return Problem(place, what, f"add </{open_one.tag}>")
        if not self._data.lstrip().startswith(b"<"):
            return Problem(Place(self._path, 1), "this is no tree file: it does not begin with <")
        return Problem(place, f"this is not well-formed XML: {expat.ErrorString(error.code)}")

    def _start(self, tag: str, pairs: list[str]) -> None:
        element = Element(tag, self._here())
        if len(self._open) >= DEPTH_LIMIT:
            raise TreeFileError(Problem(element.place, f"elements nest deeper than {DEPTH_LIMIT}", "use fewer levels"))
        self._count += 1
        if self._count > ELEMENT_LIMIT:
            raise TreeFileError(Problem(element.place, f"there are more than {ELEMENT_LIMIT} elements", "use SubTrees"))
        element.attributes = self._attributes(element.place, pairs)
        if self._open:
            self._open[-1].children.append(element)
        else:
            self._root = element
        self._open.append(element)

    def _end(self, _tag: str) -> None:
        self._open.pop()

    def _text(self, text: str) -> None:
        if (word := text.strip()) and not any(element.tag == "TreeNodesModel" for element in self._open):
            shown = word if len(word) <= 20 else word[:20] + "..."
            what = f"text '{shown}' stands between elements"
            place = _after(self._here(), text[: text.index(word[0])])
            self.problems.append(Problem(place, what, "only elements and comments are allowed"))

    def _doctype(self, *_: object) -> None:
        head = self._data[: self._data.index(b"<!DOCTYPE")].decode()
        place = _after(Place(self._path, 1, 1), head)
        raise TreeFileError(Problem(place, "a document type or entities are refused", "remove the <!DOCTYPE ...>"))

    def _here(self) -> Place:
        return Place(self._path, self._parser.CurrentLineNumber, self._parser.CurrentColumnNumber + 1)

    def _attributes(self, start: Place, pairs: list[str]) -> dict[str, Attribute]:
        """Scans the tag's source, which expat has found well-formed, for where its attributes stand."""
        if len(pairs) > 2 * ATTRIBUTE_LIMIT:
            raise TreeFileError(
                Problem(start, f"{len(pairs) // 2} attributes are too many", f"at most {ATTRIBUTE_LIMIT}")
            )
        self._attribute_count += len(pairs) // 2
        if self._attribute_count > ATTRIBUTES_LIMIT:
            raise TreeFileError(Problem(start, f"there are more than {ATTRIBUTES_LIMIT} attributes", "use SubTrees"))
        attributes = {}
        position = self._parser.CurrentByteIndex
        tag = _TAG.match(self._data, position)
        assert tag
        place, position = _after(start, tag[0].decode()), tag.end()
        for name, value in zip(pairs[::2], pairs[1::2], strict=True):
            found = _ATTRIBUTE.match(self._data, position)
            assert found
            end = self._data.index(found[2], found.end())
            name_place = _after(place, self._data[position : found.start(1)].decode())
            value_place = _after(name_place, self._data[found.start(1) : found.end()].decode())
            source = self._data[found.end() : end].decode()
            attributes[name] = Attribute(value, name_place, value_place, source)
            place, position = _after(value_place, source + '"'), end + 1
        return attributes


def _after(place: Place, text: str) -> Place:
    """The place behind a text that begins at `place`."""
    if place.line is None or place.column is None:
        return place
    lines = text.count("\n")
    if not lines:
        return Place(place.file, place.line, place.column + len(text))
    return Place(place.file, place.line + lines, len(text) - text.rindex("\n"))


def entry_name(value: object, port: str, bare: bool = False) -> str | None:
    """The entry that `{key}` means for a port, `{=}` being the port's own name; None for a literal.

    Args:
        bare: a name without braces means the entry, too.
    """
    found = _POINTER.match(value) if isinstance(value, str) else None
    if found is None:
        return str(value) if bare else None
    return port if found[1] == "=" else found[1]


def autoremaps(element: Element) -> bool:
    """Whether all names of a SubTree mean those of the tree around it; a word that is no bool means no."""
    return element.get("_autoremap") in TRUE_WORDS
