"""YAML files into pydantic models; every problem of a file is reported at once with its line and column."""

from __future__ import annotations

import difflib
import types
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from bracket_ground.errors import KINDS, LIST, MAPPING, SHOULD, InputError, Place, Problem, wanted
from bracket_ground.files.files import read_text, whole_or_none
from bracket_ground.files.model import Disagreement, Location

M = TypeVar("M", bound=BaseModel)
FAST: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # ten times as fast; what it refuses, the other one words
NOT_YAML = (yaml.YAMLError, ValueError, RecursionError)
MOST_NESTED = 64  # levels; the parser in C ends the process at some ten thousand
MOST_VALUES = 1_000_000  # with what aliases repeat
MOST_BITS, SHOWN = 1024, 40  # of a whole number; characters of what is refused
BEGINS, ENDS = yaml.CollectionStartEvent, yaml.CollectionEndEvent
COUNTED = {
    "too_long": "at most {max_length} values are legal here, not {actual_length}",
    "too_short": "at least {min_length} values are needed here, not {actual_length}",
}
OPENCV = "%YAML:"  # with which its FileStorage begins, and which is no legal directive
SEXAGESIMAL = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")


def load_yaml(path: Path | str, model: type[M]) -> M:
    """Read a YAML file into a model; its validators get the file's `folder` as context.

    Raises:
        InputError: the file cannot be read, is not YAML, or does not fit the model; it names every problem found.
    """
    path = Path(path)
    root, data, problems = _read(path)
    if problems:
        raise InputError(*problems)
    try:
        read = model.model_validate(data, context={"folder": path.parent})
    except ValidationError as error:
        found = [problem for details in error.errors() for problem in _problems(path, root, model, details)]
        raise InputError(*sorted(_joined(found), key=lambda p: (p.place.line or 0, p.place.column or 0))) from None
    if mistaken := list(_truths_for_numbers(path, root, data, read)):
        raise InputError(*mistaken)
    return read


def read_data(path: Path, text: str) -> Any:
    """The plain data of a text that somebody wrote, or that a log holds.

    Args:
        path: what it is called in errors.

    Raises:
        InputError: it is not YAML, has a key twice, or is nested or repeated beyond all use.
    """
    _, data, problems = _read_text(path, text)
    if problems:
        raise InputError(*problems)
    return data


def write_values(
    path: Path, values: Mapping[Location, object], legal: Callable[[Path], object] = lambda _: None
) -> None:
    """Put values into a YAML file; all that stands beside them stays as it is, comments among it.

    Args:
        values: by their location. A key that is not there is added to the keys around it, which must be there.
        legal: reads a file, and raises InputError where it cannot be used; then the old one stays.

    Raises:
        InputError: the file cannot be read or written, there is no such place in it, or it would not be legal.
    """
    text = read_text(path)
    for location, value in values.items():
        dumped = yaml.safe_dump(value, default_flow_style=True, width=1000)
        text = _with_value(path, text, location, dumped.split("\n...")[0].strip())
    try:
        with whole_or_none(path) as partial:
            partial.write_text(text, encoding="utf-8")
            legal(partial)
    except InputError as error:
        wrong = "; ".join(str(getattr(problem, "what", problem)) for problem in error.problems)
        raise InputError(f"{path} stays as it was: with what was to be written it is not legal: {wrong}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None


def _with_value(path: Path, text: str, location: Location, value: str) -> str:
    """A text with a value at a location."""
    root, _, _ = _parsed(path, text, yaml.SafeLoader)
    *around, name = location
    node: Node = root
    for key in around:
        found = _value_of(node, key)
        if found is None:
            raise InputError(Problem(_place(path, root, tuple(around)), f"key {str(key)!r} is missing"))
        node = found
    there = _value_of(node, name)
    if there is not None:
        key = next(key for key, named in node.value if named is there)
        under = there.start_mark.line > key.start_mark.line and there.start_mark.column <= key.start_mark.column
        value = f"  {value}" if under else value  # dashes may stand under their key, other values may not
        return text[: there.start_mark.index] + value + text[_end_of(there) :]
    if not isinstance(node, MappingNode) or not node.value:
        raise InputError(Problem(_at(path, node), f"{_dotted(tuple(around))}: keys with values are wanted here"))
    if node.flow_style:
        end = node.end_mark.index - 1
        return f"{text[:end].rstrip()}, {name}: {value}{text[end:]}"
    first = node.value[0][0].start_mark
    return f"{text[: first.index]}{name}: {value}\n{' ' * first.column}{text[first.index :]}"


def _value_of(node: Node, key: object) -> Node | None:
    pairs = node.value if isinstance(node, MappingNode) else ()
    return next((value for name, value in pairs if name.value == str(key)), None)


def _end_of(node: Node) -> int:
    """Where a node's own text ends: that of a block reaches over the comments behind it."""
    while isinstance(node, MappingNode | SequenceNode) and not node.flow_style and node.value:
        last = node.value[-1]
        node = last[1] if isinstance(last, tuple) else last
    return int(node.end_mark.index)


def has_key(path: Path, name: str) -> bool:
    """Whether a YAML file has a key at its top.

    Raises:
        InputError: the file cannot be read, or is not YAML.
    """
    return _value_of(_read(path)[0], name) is not None


def place_of(path: Path, location: Location) -> Place:
    """Where a location of a YAML file stands, for errors that are found later than at loading."""
    root, _, _ = _read(path)
    return _place(path, root, location, of_key=True)


def _read(path: Path) -> tuple[Node, object, list[Problem]]:
    return _read_text(path, read_text(path))


def _read_text(path: Path, text: str) -> tuple[Node, object, list[Problem]]:
    if text.startswith(OPENCV):
        text = f"#{text[1:]}"
    with suppress(*NOT_YAML):  # the parser in Python has better words about what is wrong
        return _parsed(path, text, FAST)
    try:
        return _parsed(path, text, yaml.SafeLoader)
    except NOT_YAML as error:
        raise _unreadable(path, text, error) from None


def _parsed(path: Path, text: str, kind: Any) -> tuple[Node, object, list[Problem]]:
    """Nodes, data and problems of a text.

    Raises:
        InputError: the file is empty, or nested too deeply.
        NOT_YAML: it is not legal.
    """
    _require_shallow(path, text, kind)
    loader = kind(text)
    try:
        root = loader.get_single_node()
        if root is None:
            raise InputError(Problem(Place(path, 1, 1), "the file is empty"))
        constructor = _Constructor(path, loader)
        return root, constructor.data(root), constructor.problems
    finally:
        loader.dispose()


def _require_shallow(path: Path, text: str, kind: Any) -> None:
    """Raises: InputError: nested too deeply. NOT_YAML: it is not legal."""
    nested = 0
    for event in yaml.parse(text, Loader=kind):
        nested += isinstance(event, BEGINS) - isinstance(event, ENDS)
        if nested > MOST_NESTED:
            line = event.start_mark.line + 1 if event.start_mark else None
            raise InputError(Problem(Place(path, line), f"nested more than {MOST_NESTED} levels deep"))


def _unreadable(path: Path, text: str, error: Exception) -> InputError:
    """What YAML's reader raised, in words and with its place."""
    if isinstance(error, yaml.reader.ReaderError):
        place = Place(path, text.count("\n", 0, error.position) + 1)
        return InputError(Problem(place, f"the character {error.character!r} is not legal in YAML"))
    if isinstance(error, yaml.MarkedYAMLError):
        mark = error.problem_mark or error.context_mark
        place = Place(path, mark.line + 1, mark.column + 1) if mark else Place(path)
        return InputError(Problem(place, f"not YAML: {error.problem or error.context}"))
    return InputError(Problem(Place(path), f"not YAML: {error}"))


class _Constructor:
    """Plain data of nodes; unlike PyYAML's own constructor it refuses duplicate keys and reports where they are."""

    def __init__(self, path: Path, loader: yaml.SafeLoader) -> None:
        self.problems: list[Problem] = []
        self._path = path
        self._loader = loader
        self._made: dict[int, object] = {}  # by node: an alias costs nothing however often it is used
        self._sizes: dict[int, int] = {}  # by node: how many values it is for whoever goes through all
        self._under_way: set[int] = set()

    def data(self, node: Node) -> object:
        key = id(node)
        if key in self._under_way:
            self.problems.append(Problem(_at(self._path, node), "an alias that contains itself"))
            return None
        if key not in self._made:
            self._under_way.add(key)
            self._made[key] = self._make(node)
            self._sizes[key] = self._size(node)
            self._under_way.remove(key)
        return self._made[key]

    def _scalar(self, node: Node) -> object:
        with suppress(ValueError, KeyError, AttributeError):  # what PyYAML raises for a value that does not fit its tag
            value: object = self._loader.construct_object(node)
            if not isinstance(value, int) or value.bit_length() <= MOST_BITS:
                return value
        shown = node.value if len(node.value) < SHOWN else f"{node.value[:SHOWN]}..."
        kind = node.tag.rpartition(":")[2]
        self.problems.append(Problem(_at(self._path, node), f"{shown!r} cannot be read as {kind}"))
        return None

    def _size(self, node: Node) -> int:
        inner = [pair[1] for pair in node.value] if isinstance(node, MappingNode) else node.value
        size = 1 if isinstance(node, ScalarNode) else 1 + sum(self._sizes.get(id(each), 1) for each in inner)
        if size > MOST_VALUES:
            raise InputError(Problem(_at(self._path, node), f"aliases make more than {MOST_VALUES:,} values of it"))
        return size

    def _make(self, node: Node) -> object:
        if isinstance(node, SequenceNode):
            return [self.data(item) for item in node.value]
        if not isinstance(node, MappingNode):
            if ":" in node.value and node.tag in SEXAGESIMAL:
                return node.value  # YAML 1.1 reads 1:30 as 90; nobody who writes it today means that
            return self._scalar(node)
        made: dict[str, object] = {}
        lines: dict[str, int] = {}
        for key, value in node.value:
            name = key.value if isinstance(key, ScalarNode) else "?"
            if name in made:
                what = f"key {name!r} appears twice"
                self.problems.append(Problem(_at(self._path, key), what, f"first in line {lines[name]}"))
            lines.setdefault(name, key.start_mark.line + 1)
            made[name] = self.data(value)
        return made


def _truths_for_numbers(path: Path, root: Node, data: object, read: object, at: Location = ()) -> Iterator[Problem]:
    """`true` where a number is wanted: pydantic would take it for 1."""
    if isinstance(data, bool) and not isinstance(read, bool) and isinstance(read, int | float):
        yield Problem(_place(path, root, at), f"{_dotted(at)}: input should be a number, not {str(data).lower()}")
    elif isinstance(data, dict):
        for key, value in data.items():
            inner = read.get(key) if isinstance(read, Mapping) else getattr(read, key, None)
            yield from _truths_for_numbers(path, root, value, inner, (*at, key))
    elif isinstance(data, list) and isinstance(read, Sequence):
        for number, (value, inner) in enumerate(zip(data, read, strict=False)):
            yield from _truths_for_numbers(path, root, value, inner, (*at, number))


def _problems(path: Path, root: Node, model: type[BaseModel], details: ErrorDetails) -> list[Problem]:
    location = tuple(details["loc"])
    cause = details.get("ctx", {}).get("error")
    if isinstance(cause, Disagreement):
        return [Problem(_place(path, root, (*location, *inner)), what) for inner, what in cause.places]
    if details["type"] == "extra_forbidden":
        name = str(location[-1])
        place = _place(path, root, location, of_key=True)
        for owner in _models(model, location[:-1]):
            if name in getattr(owner, "moved", {}):
                return [Problem(place, f"key {name!r} has moved", owner.moved[name])]
            if name != "moved" and name in getattr(owner, "__class_vars__", ()):
                what = f"leave it out: it is {getattr(owner, name)} in every cell"
                return [Problem(place, f"key {name!r} is no longer set by files", what)]
        return [Problem(place, f"unknown key {name!r}", suggestion(name, _legal_keys(model, location[:-1])))]
    if details["type"] == "missing":
        *around, last = location
        what = f"{_dotted(tuple(around))}: value {last + 1}" if isinstance(last, int) else f"key {last!r}"
        return [Problem(_place(path, root, tuple(around)), f"{what} is missing")]
    kind, got = details["type"], details["input"]
    what = wanted(kind, details["msg"])
    if kind in COUNTED:
        what = COUNTED[kind].format(**details["ctx"])
    _, node, steps = _found(root, location)
    what = f"{_dotted(steps)}: {what[:1].lower()}{what[1:]}{_not(got, kind)}"
    legal = suggestion("", _legal_keys(model, location) if KINDS.get(kind) == MAPPING else [])
    if kind == "string_type" and isinstance(node, ScalarNode) and node.value:
        legal = f"in quotes {node.value[:SHOWN]!r} is text"
    return [Problem(_place(path, root, location), what, legal)]


def _joined(problems: Sequence[Problem]) -> list[Problem]:
    """What an entry of several legal kinds should be, in one problem."""
    joined: dict[tuple[Place, str], Problem] = {}
    for problem in problems:
        name, _, wanted = problem.what.partition(SHOULD)
        if (before := joined.get((problem.place, name))) and wanted:
            either = f"{name}{SHOULD}{wanted.partition(', not ')[0]} or {before.what.removeprefix(name + SHOULD)}"
            problem = Problem(problem.place, either, before.legal or problem.legal)
        joined[problem.place, name] = problem
    return list(joined.values())


def _not(got: object, error: str) -> str:
    """What was given instead; of lists and mappings only that they are, and only where that is the mistake."""
    if isinstance(got, str | int | float | bool | None):
        return f", not {got!r}"
    kind = MAPPING if isinstance(got, dict) else LIST if isinstance(got, list) else ""
    return f", not {kind}" if kind and error.endswith("_type") else ""


def suggestion(name: str, legal: Sequence[str]) -> str:
    """What may have been meant, and what is legal."""
    near = difflib.get_close_matches(name, legal, n=1)
    asked = f"did you mean {near[0]!r}? " if near else ""
    return f"{asked}legal here: {', '.join(legal)}" if legal else ""


def _legal_keys(model: type[BaseModel], location: Location) -> list[str]:
    """Field names at a location."""
    return [name for option in _models(model, location) for name in option.model_fields]


def _models(model: type[BaseModel], location: Location) -> list[Any]:
    """Models at a location, following nested models, dicts, sequences and unions."""
    options: list[Any] = [model]
    for step in location:
        following = [inner for option in options for inner in _inside(option, step)]
        options = following or [option for option in options if _is_kind(option, step)] or options
    return [_as_written(option) for option in options if _is_model(option)]


def _is_kind(option: Any, tag: str | int) -> bool:
    """Whether a model is the one that a union's tag means."""
    kind = option.model_fields.get("kind") if _is_model(option) else None
    return kind is not None and tag in typing.get_args(kind.annotation)


def _inside(option: Any, step: str | int) -> list[Any]:
    if _is_model(option):
        field = _as_written(option).model_fields.get(str(step))
        return _alternatives(field.annotation) if field else []
    origin, arguments = typing.get_origin(option), typing.get_args(option)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return _alternatives(arguments[1])
    if isinstance(origin, type) and issubclass(origin, Sequence):
        return [inner for argument in arguments if argument is not Ellipsis for inner in _alternatives(argument)]
    return []


def _alternatives(annotation: Any) -> list[Any]:
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        return [inner for argument in typing.get_args(annotation) for inner in _alternatives(argument)]
    if typing.get_origin(annotation) is typing.Annotated:
        return _alternatives(typing.get_args(annotation)[0])
    return [annotation]


def _is_model(option: Any) -> bool:
    return isinstance(option, type) and issubclass(option, BaseModel)


def _as_written(model: Any) -> Any:
    """The model whose keys stand in a file; a model that is written in another way names it."""
    return getattr(model, "written_as", model)


def _place(path: Path, root: Node, location: Location, of_key: bool = False) -> Place:
    """Where a location stands; steps that the file does not have (tags of unions) are passed over."""
    key, node, _ = _found(root, location)
    begins_below = isinstance(node, MappingNode | SequenceNode) and not node.flow_style
    return _at(path, key if key is not None and (of_key or begins_below) else node)


def _found(root: Node, location: Location) -> tuple[Node | None, Node, Location]:
    """The node at a location with its key, if it has one, and the steps that the file has."""
    key: Node | None = None
    node: Node = root
    steps: Location = ()
    for step in location:
        if isinstance(node, MappingNode):
            pair = next(((name, value) for name, value in node.value if name.value == str(step)), None)
        else:
            there = isinstance(node, SequenceNode) and isinstance(step, int) and step < len(node.value)
            pair = (None, node.value[step]) if there else None
        if pair is not None:
            (key, node), steps = pair, (*steps, step)
    return key, node, steps


def _at(path: Path, node: Node) -> Place:
    return Place(path, node.start_mark.line + 1, node.start_mark.column + 1)


def _dotted(location: Location) -> str:
    return ".".join(str(step) for step in location) or "the file"
