"""Loads a tree file: all mistakes are found, and reported at once, before anything moves."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from btxml.engine.blackboard import Scope
from btxml.engine.decorators import SubTree
from btxml.engine.errors import Place, Problem, TreeFileError
from btxml.engine.node import Runtime, TreeNode
from btxml.engine.tree import Tree
from btxml.files.checks.dataflow import check_dataflow, check_order
from btxml.files.checks.reach import check_claims, check_reach
from btxml.files.checks.structure import check_structure, count_levels
from btxml.files.compile.builder import Builder
from btxml.files.compile.registry import Registry
from btxml.files.parse.in_python import InPython, classes_of, in_python
from btxml.files.parse.library import PROBLEM_LIMIT, Library, hint, read_library

# Python frames that a level of a tree takes at most in a tick, and those that its callers may need.
FRAMES_A_LEVEL = 4
FRAMES_AROUND = 400


def load_tree(
    path: Path | InPython,
    registry: Registry,
    main: str | None = None,
    provided: Mapping[str, Any] | None = None,
    beside: Iterable[Path] = (),
) -> Tree:
    """Load a tree file, or what stands for one, and what it includes; what `cell check` reports is refused here, too.

    Args:
        registry: the nodes that the file may name.
        main: BehaviorTree to run instead of the file's `main_tree_to_execute`.
        provided: entries of the main tree that are set before the first tick.
        beside: further files, and folders with them, whose trees the file may name.

    Raises:
        TreeFileError: everything that is wrong, each with its place.
    """
    library = read_library(path, beside)
    if main is not None:
        library.main = main
    problems = find_problems(library, registry)
    if library.main not in library.trees:
        place = Place(next(iter(library.texts), Path()), 1, 1)
        what = (
            f"there is no BehaviorTree '{library.main}'"
            if library.main
            else "the file does not say which BehaviorTree to run"
        )
        if not problems and not library.incomplete:
            problems.append(Problem(place, what, f"set main_tree_to_execute; {hint(library.main, library.trees)}"))
        raise TreeFileError(*in_order(problems))
    if library.incomplete:
        raise TreeFileError(*in_order(problems))
    tree, between = build(library, registry, library.main, provided or {})
    if problems or between:
        raise TreeFileError(*in_order([*problems, *between]))
    return tree


def tree(
    root: TreeNode,
    name: str = "Main",
    trees: Mapping[str, TreeNode] | None = None,
    registry: Registry | None = None,
    provided: Mapping[str, Any] | None = None,
    beside: Iterable[Path] = (),
) -> Tree:
    """A tree that is written in Python, checked as if it stood in a file.

    Args:
        root: its topmost node; as all nodes it only says what is wanted, and may be used again.
        name: of the tree.
        trees: further trees by name, for SubTrees: `SubTree(ID="Fetch", part="o1")`.
        registry: the nodes that files may name; those of the language by default.
        provided: entries of the main tree that are set before the first tick.
        beside: tree files, and folders with them, whose trees may be called, too.

    Raises:
        TreeFileError: everything that is wrong, each with its line of Python.
    """
    source = in_python(root, name, trees)
    return load_tree(source, knowing(source, registry or Registry()), None, provided, beside)


def knowing(source: InPython, registry: Registry) -> Registry:
    """A registry with the classes that a tree in Python is made of."""
    used = classes_of(source)
    return registry.extended(
        [node for tag, node in used.items() if node is not SubTree and registry.classes.get(tag) is not node]
    )


def find_problems(library: Library, registry: Registry) -> list[Problem]:
    """What is wrong with any tree of a library as it stands in the files, before nodes are made of one of them."""
    return find_mistakes(library, registry) + find_doubts(library, registry)


def find_mistakes(library: Library, registry: Registry) -> list[Problem]:
    """What nobody could run."""
    return library.problems + library.misnamed + check_structure(library, registry)


def find_doubts(library: Library, registry: Registry) -> list[Problem]:
    """What could run, and would not do what is written; to be asked after `find_mistakes`."""
    return check_reach(library, registry) + list(check_claims(library, registry))


class Built(NamedTuple):
    """A tree, what is wrong between its nodes, and who made it."""

    tree: Tree
    problems: list[Problem]
    builder: Builder


def build(library: Library, registry: Registry, main: str, provided: Mapping[str, Any]) -> tuple[Tree, list[Problem]]:
    """Make the nodes of a checked library, and check how values flow between them; what is broken is left out."""
    made = built(library, registry, main, provided)
    return made.tree, made.problems


def built(library: Library, registry: Registry, main: str, provided: Mapping[str, Any]) -> Built:
    """The same, with who made it."""
    frames = FRAMES_A_LEVEL * count_levels(library, main) + FRAMES_AROUND
    if frames > sys.getrecursionlimit():
        sys.setrecursionlimit(frames)
    runtime = Runtime(enums=registry.enums)
    scope = Scope()
    builder = Builder(library, registry, runtime)
    root = builder.tree(main, scope)
    unused = set(provided) - {*scope, *library.models.get(main, {})}
    own = {key: value for key, value in registry.entries.items() if key in scope}
    problems = _own_written(builder, {id(scope.entry(key)) for key in own})
    for key, value in {**own, **provided}.items():
        scope.entry(key).value = value
    given = {id(scope.entry(key)) for key, port in library.models.get(main, {}).items() if port.direction != "output"}
    given |= builder.mentioned
    problems += check_dataflow(builder, given, registry.words) + check_order(builder.uses, builder.nodes, given)
    scopes = (scope, *builder.scopes)
    tree = Tree(
        main, root, tuple(builder.nodes), scope, library.texts, runtime, builder.origins, scopes, unused, builder.places
    )
    return Built(tree, problems, builder)


def _own_written(builder: Builder, own: set[int]) -> list[Problem]:
    """Ports and scripts that write what only the cell itself writes."""
    what = "{} writes {{{}}}, which only the cell itself writes"
    return [
        Problem(use.place, what.format(use.user, use.name), "read it, or give yours another name")
        for use in builder.uses
        if use.writes and id(use.entry) in own
    ]


def unused_entries(trees: Mapping[Path, Tree]) -> list[Problem]:
    """Entries that were set from outside, and that the main tree of none of these files has."""
    unused = frozenset.intersection(*(tree.unused for tree in trees.values())) if trees else frozenset()
    legal = {name for tree in trees.values() for name in tree.blackboard} - unused
    what = "is given, and the main tree has no such entry"
    return [Problem(Place(next(iter(trees))), f"{name!r} {what}", hint(name, legal)) for name in sorted(unused)]


def in_order(problems: list[Problem]) -> list[Problem]:
    """Problems by file, as first named, then by line and column; the first hundred, as nobody reads more."""
    files = list(dict.fromkeys(problem.place.file for problem in problems))
    return sorted(
        dict.fromkeys(problems),
        key=lambda problem: (files.index(problem.place.file), problem.place.line or 0, problem.place.column or 0),
    )[:PROBLEM_LIMIT]
