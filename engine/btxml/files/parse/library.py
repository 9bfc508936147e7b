"""The trees of a file and of what it includes."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from btxml.engine.errors import Place, Problem, TreeFileError
from btxml.engine.literals import TRUE_WORDS
from btxml.files.parse.in_python import InPython
from btxml.files.parse.replacing import REPLACES, original_of, replace_nodes
from btxml.files.parse.version3 import Converted, convert
from btxml.files.parse.xml_file import FORMAT, Element, plain_files, read_xml

MOST_WORDS = 12
CONVERT = "`cell new tree NAME --convert FILE` writes it as a file of version 4"
UNNAMED = "BehaviorTree"  # the name of a tree that has none
# Nobody reads more; a hostile file could cause a million.
PROBLEM_LIMIT = 100
_FORBIDDEN = re.compile(r"""[\x00-\x20\x7f<>&"'/\\:*?|.]""")  # in names; `validateModelName` of BehaviorTree.CPP 4.10


def is_near(word: str, legal: Iterable[str]) -> bool:
    """Whether a word is written much like a legal one."""
    return bool(difflib.get_close_matches(word.lower(), [known.lower() for known in legal], n=1, cutoff=0.6))


def hint(word: str, legal: Iterable[str], all_of_them: str = "") -> str:
    """What could be meant: the nearest legal word, else all of them, or where they are listed."""
    words = sorted(legal)
    folded = {legal_word.lower(): legal_word for legal_word in words}
    if near := difflib.get_close_matches(word.lower(), folded, n=1, cutoff=0.6):
        return f"did you mean '{folded[near[0]]}'?"
    if not words:
        return "none is legal here"
    if all_of_them:
        return all_of_them
    shown = ", ".join(words[:MOST_WORDS])
    return f"legal: {shown}" + (", ..." if len(words) > MOST_WORDS else "")


@dataclass(frozen=True)
class ModelPort:
    """A port of a SubTree as a TreeNodesModel declares it; without a default it is mandatory."""

    direction: str
    default: str | None


@dataclass
class Library:
    """All trees that one file can name.

    Attributes:
        trees: BehaviorTree elements by ID.
        models: ports of SubTrees by ID, from TreeNodesModel.
        main: ID of the tree to run; empty where the file does not say.
        texts: every file read, with its text.
        warnings: what runs, and can hardly be meant.
        notes: what is left out of account here and means something elsewhere, such as to editors.
        misnamed: attributes of the language's own elements that are written much like legal ones.
        replacing: trees that take the place of a tree or node of their name.
        opened: texts of files that an editor has open, by their absolute path; they count instead of the files.
        incomplete: some file could not be read to its end, or is too large: trees may be missing, none is built.
    """

    trees: dict[str, Element] = field(default_factory=dict)
    models: dict[str, dict[str, ModelPort]] = field(default_factory=dict)
    main: str = ""
    texts: dict[Path, str] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    notes: list[Problem] = field(default_factory=list)
    warnings: list[Problem] = field(default_factory=list)
    misnamed: list[Problem] = field(default_factory=list)
    replacing: dict[str, Element] = field(default_factory=dict)
    opened: Mapping[Path, str] = field(default_factory=dict)
    incomplete: bool = False


def read_library(
    source: Path | InPython, beside: Iterable[Path] = (), opened: Mapping[Path, str] | None = None
) -> Library:
    """Read a file, or what stands for one, and what it includes; what is wrong is in `problems`.

    Args:
        beside: further files, and folders with them, whose trees it may name.
        opened: texts that count instead of files, by absolute path.
    """
    library = Library(opened=opened or {})
    root = _read(library, source, None)
    own = tuple(library.trees)
    for file in _files(beside):
        if file.resolve() not in {known.resolve() for known in library.texts}:
            _read(library, file, None)
    replace_nodes(library.trees, library.replacing)
    if root is not None:
        _choose_main(library, root, own)
    return library


def _files(paths: Iterable[Path]) -> Iterator[Path]:
    """Files, and the tree files below folders by their names."""
    for path in paths:
        yield from plain_files(path, "**/*.xml") if path.is_dir() else [path]


def bottom_up(library: Library) -> Iterator[Element]:
    """All nodes of all checked trees, each once: children, and what a SubTree calls, before their parents."""
    seen: set[int] = set()
    waiting = [(child, False) for tree in library.trees.values() for child in tree.children]
    while waiting:
        element, below_done = waiting.pop()
        if below_done:
            yield element
        elif id(element) not in seen:
            seen.add(id(element))
            waiting.append((element, True))
            waiting += [(child, False) for child in reversed(called(library, element))]


def called(library: Library, element: Element) -> list[Element]:
    """The children of a node, for a SubTree the node of the BehaviorTree that it calls."""
    if element.broken:
        return element.children
    return library.trees[element.get("ID") or ""].children if element.tag == "SubTree" else element.children


def _read(library: Library, source: Path | InPython, included_at: Place | None) -> Element | None:
    path = source if isinstance(source, Path) else source.path
    try:
        text, root, malformed = read_xml(path, _opened(library, source))
    except TreeFileError as error:
        library.incomplete = True
        problems = [problem for problem in error.problems if isinstance(problem, Problem)]
        if included_at is not None:
            library.problems.append(Problem(included_at, f"the included file {path.name} cannot be used"))
        library.problems += problems
        return None
    if isinstance(source, InPython):
        source.placed(root)
    library.texts[path] = text
    library.problems += malformed[:PROBLEM_LIMIT]
    library.incomplete = library.incomplete or root.broken
    if root.tag != "root":
        library.problems.append(
            Problem(root.place, f"this is no tree file: its outermost element is <{root.tag}>", "must be <root>")
        )
        return None
    older = not malformed and root.get("BTCPP_format") != FORMAT
    _check_root(library, root, convert(path, text) if older else Converted())
    for element in root.children:
        if len(library.problems) < PROBLEM_LIMIT:
            _take(library, element, path, len([child for child in root.children if child.tag == "BehaviorTree"]) == 1)
    return root


def _opened(library: Library, source: Path | InPython) -> str | None:
    """The text that counts instead of a file's."""
    return library.opened.get(source.resolve()) if isinstance(source, Path) else source.text


def _check_root(library: Library, root: Element, version3: Converted) -> None:
    found, place = root.get("BTCPP_format"), root.place_of("BTCPP_format")
    if found is None:
        what = f'BTCPP_format is missing; the file is read as BTCPP_format="{FORMAT}"'
        legal = "add it to the file"
        if version3.changes:
            first = version3.changes[0]
            what += f", and would mean something else in version 3, as in line {first.place.line}: {first.what}"
            legal = f"{CONVERT}, or {legal}"
        library.notes.append(Problem(place, what, legal))
    elif found != FORMAT:
        legal = f'must be BTCPP_format="{FORMAT}"' + (f"; {CONVERT}" if found == "3" else "")
        same = found == "3" and not version3.changes and not version3.lost  # nothing in it means something else
        (library.notes if same else library.problems).append(Problem(place, f"BTCPP_format is '{found}'", legal))
    _check_attributes(library, root, ("BTCPP_format", "main_tree_to_execute", "project_name"))


def _check_attributes(library: Library, element: Element, legal: tuple[str, ...]) -> None:
    """What is written much like a legal attribute is a mistake, but in a foreign dialect; others are an editor's."""
    for name, attribute in element.attributes.items():
        if name not in legal:
            alike = [word for word in legal if word.startswith("_") == name.startswith("_")]
            near = hint(name, legal) if is_near(name, alike) or f"_{name}" in legal else ""
            problem = Problem(attribute.place, f"<{element.tag}> has no attribute '{name}'", near or "it is ignored")
            (library.misnamed if near else library.notes).append(problem)


def _take(library: Library, element: Element, path: Path, alone: bool) -> None:
    if element.tag == "BehaviorTree":
        _take_tree(library, element, alone)
    elif element.tag == "TreeNodesModel":
        _take_models(library, element)
    elif element.tag == "include":
        _include(library, element, path)
    else:
        what = f"<{element.tag}> cannot stand in <root>"
        library.problems.append(
            Problem(element.place, what, hint(element.tag, ("BehaviorTree", "TreeNodesModel", "include")))
        )


def _take_tree(library: Library, element: Element, alone: bool) -> None:
    """Take a tree; one that stands alone in its file needs no name."""
    identifier = element.get("ID") or (UNNAMED if alone and element.get("ID") is None else "")
    if not identifier:
        library.problems.append(Problem(element.place, "this BehaviorTree has no ID", 'give it one: ID="Name"'))
        return
    if refused := _FORBIDDEN.search(identifier) or re.fullmatch("Root", identifier):
        what = f"BehaviorTree.CPP and Groot2 since 4.8.4 refuse the name '{identifier}', for its '{refused[0]}'"
        library.notes.append(Problem(element.place_of("ID"), what, "letters, digits, _ and - are legal there"))
    if not _replaced(library, element, identifier):
        return
    library.trees[identifier] = element
    _check_attributes(library, element, ("ID", "_description", "_fullpath", REPLACES))
    _check_children(library, element, identifier)


def _check_children(library: Library, element: Element, identifier: str) -> None:
    if len(element.children) != 1:
        what = f"BehaviorTree '{identifier}' has {len(element.children)} nodes directly below it"
        if not element.broken:
            library.problems.append(Problem(element.place, what, "must be one; put several into a Sequence"))
        element.broken = True


def _replaced(library: Library, element: Element, identifier: str) -> bool:
    """Whether a tree can have its name; where it replaces another one, that is kept beside it, whichever came first."""
    other, replaces = library.trees.get(identifier), element.get(REPLACES) in TRUE_WORDS
    if other is not None and replaces == (identifier in library.replacing):
        what = f"a BehaviorTree '{identifier}' is already defined at {other.place}"
        legal = f'rename one of them, or let this one take its place: {REPLACES}="true"'
        library.problems.append(Problem(element.place_of("ID"), what, legal))
        return False
    if other is not None and not replaces:
        library.trees[original_of(identifier)] = element
        _check_children(library, element, identifier)
        return False
    if other is not None:
        library.trees[original_of(identifier)] = other
    if replaces:
        library.replacing[identifier] = element
    return True


def _take_models(library: Library, element: Element) -> None:
    """Only models of SubTrees mean something here; those of other nodes come from their Python classes."""
    for model in element.children:
        identifier = model.get("ID")
        if model.tag != "SubTree" or not identifier:
            continue
        ports = library.models.setdefault(identifier, {})
        for port in model.children:
            name = port.get("name")
            if port.tag == "MetadataFields" or (name or "").startswith("_"):  # as version 3 wrote what is no port
                continue
            if port.tag not in ("input_port", "output_port", "inout_port") or not name:
                library.problems.append(
                    Problem(port.place, f"<{port.tag}> is not a port", 'like <input_port name="part"/>')
                )
                continue
            ports[name] = ModelPort(port.tag.removesuffix("_port"), port.get("default"))


def _include(library: Library, element: Element, path: Path) -> None:
    """Each file is read once, however often it is included: a file of a library may name all that it needs."""
    name = element.get("path")
    place = element.place_of("path")
    if not name:
        library.problems.append(Problem(element.place, "this include has no path", 'like <include path="grasp.xml"/>'))
        return
    if element.get("ros_pkg") is not None:
        what = "a package of ROS cannot be found here"
        library.problems.append(Problem(element.place_of("ros_pkg"), what, "give the path from this file"))
        return
    target = (path.parent / name).resolve()
    known = {file.resolve() for file in library.texts}
    if target == path.resolve():
        library.problems.append(Problem(place, f"'{name}' includes itself", "remove this include"))
    elif target not in known:
        _read(library, path.parent / name, place)


def _choose_main(library: Library, root: Element, own: tuple[str, ...]) -> None:
    """The tree that the file names; without a word of it the only one that it and its includes hold."""
    main = root.get("main_tree_to_execute")
    if main is None and len(own) == 1:
        library.main = own[0]
    elif main in library.trees:
        library.main = main
    elif main is not None:
        what = f"main_tree_to_execute names '{main}', and there is no such BehaviorTree"
        library.problems.append(Problem(root.place_of("main_tree_to_execute"), what, hint(main, library.trees)))
