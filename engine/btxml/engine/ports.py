"""Typed ports: declared as class attributes of a node, connected by the tree file, read and written in ticks.

Example:
    class PredictNextObject(Node):
        state = InputPort(AssemblyState, "what is placed so far")
        part = OutputPort(str, "type of the part to fetch")

        def update(self) -> Status:
            self.part.set(next_part(self.state.get()))
            return Status.SUCCESS
"""

from __future__ import annotations

from typing import Any, Generic, TypeVar, cast, overload

from btxml.engine.blackboard import PLAIN, UNSET, Entry
from btxml.engine.errors import NodeError
from btxml.engine.vocabulary import Words, misnomer

T = TypeVar("T")
D = TypeVar("D")
NO_WORDS: Words = {}
_FURTHER = "port "  # no attribute of a class is named so


class Port:
    """A declared port.

    Attributes:
        kind: type of its values.
        meaning: one line for people.
        default: value where the file gives none, or a string such as "{entry}" or "{=}"; UNSET where it has none.
        optional: an input that the file may leave unconnected though it has no default.
        unset_ok: the node has an answer as long as nothing was written to the entry.
        name: attribute name in XML; the name of the class attribute unless given.
        least, most: of its values; of a text's length.
        also: further legal values, such as -1 for no limit.
    """

    direction = "inout"
    names_entry = False
    takes_texts = False  # also where it writes: nothing is known of what it does

    def __init__(
        self, kind: Any, meaning: str = "", default: Any = UNSET, optional: bool = False, name: str | None = None
    ) -> None:
        self.kind = kind
        self.meaning = meaning
        self.default = default
        self.optional = optional or default is not UNSET
        self.unset_ok = False
        self.name = name or ""
        self.attribute = ""
        self.least: float | None = None
        self.most: float | None = None
        self.also: tuple[float, ...] = ()

    @property
    def range(self) -> str:
        """Which values are legal, for people; empty where all are."""
        if self.kind is str:
            return "some text" if self.least else ""
        least = "" if self.least is None else f"at least {self.least:g}"
        most = "" if self.most is None else f"at most {self.most:g}"
        return ", or ".join([", ".join(filter(None, (least, most))), *(f"{value:g}" for value in self.also)])

    def outside(self, value: object) -> str:
        """What would be legal, where a value is not; empty where it is."""
        if isinstance(value, str):
            size: float = len(value.strip())
        elif isinstance(value, int | float):
            size = value
        else:
            return ""
        low = self.least is not None and size < self.least
        high = self.most is not None and size > self.most
        return self.range if (low or high) and size not in self.also else ""

    def __set_name__(self, owner: type, attribute: str) -> None:
        self.attribute = attribute
        self.name = self.name or attribute

    def connect(self, node: object, entry: Entry | None, constant: bool = False, words: Words = NO_WORDS) -> None:
        """Connect this port of one node; a plain attribute of the node from now on."""
        connection = vars(node)[self.attribute] = CONNECTIONS[self.direction](self, entry, constant)
        if isinstance(self.kind, type) and self.kind in words:
            connection.words = words

    def _own(self, node: object) -> Any:
        """A port that no file connected, as in a unit test: an entry of its own."""
        entry = Entry(self.name)
        if self.default is not UNSET:
            entry.value = self.default
        self.connect(node, entry)
        return vars(node)[self.attribute]


class Connection:
    """A port of one node, connected to an entry.

    Attributes:
        entry: an entry of the blackboard, an entry of its own for a constant, or None for an output that the
            file left unconnected, whose values are dropped.
        constant: the file spells the value out.
        words: the names that the configuration knows, for a port that takes only those.
    """

    __slots__ = ("_kind", "constant", "entry", "port", "words")

    def __init__(self, port: Port, entry: Entry | None, constant: bool) -> None:
        self.port = port
        self._kind = port.kind
        self.entry = entry
        self.constant = constant
        self.words: Words = {}

    @property
    def revision(self) -> int:
        """Number of writes to the entry so far."""
        return 0 if self.entry is None else self.entry.revision

    @property
    def carried(self) -> bool:
        """Whether the value comes from the tree that this one took over from, and was not written since."""
        return self.entry is not None and self.entry.carried


class Input(Connection, Generic[T]):
    """What a node reads."""

    __slots__ = ()

    def get(self) -> T:
        """The value.

        Raises:
            NodeError: nothing was written yet, or what was does not fit; the node fails with this message.
        """
        if self.entry is None:
            raise NodeError(f"port {self.port.name} is not connected")
        value: T = self.entry.value
        kind = type(value)
        if kind is self._kind or (self._kind is Any and kind in PLAIN and self.entry.text is None):
            return value
        read = self.entry.read(self._kind)
        if self.words and (wrong := misnomer(read, self._kind, self.words)):
            raise NodeError(f"port {self.port.name}: {'; '.join(wrong)}")
        return cast(T, read)

    def get_or(self, other: D) -> T | D:
        """The value, or `other` where there is none."""
        if self.entry is None or self.entry.value is UNSET:
            return other
        return self.get()


class Output(Connection, Generic[T]):
    """What a node writes."""

    __slots__ = ()

    def set(self, value: T) -> None:
        """Write the value for the nodes that read the entry.

        Raises:
            NodeError: the entry holds another type.
        """
        if self.entry is not None:
            self.entry.write(value)


class InOut(Input[T], Output[T]):
    """What a node reads and writes."""

    __slots__ = ()


CONNECTIONS: dict[str, type[Connection]] = {"input": Input, "output": Output, "inout": InOut}


class InputPort(Port, Generic[T]):
    """A port that a node reads; mandatory in the file unless it has a default or is optional."""

    direction = "input"

    def __init__(
        self,
        kind: type[T],
        meaning: str = "",
        default: T | str = UNSET,
        optional: bool = False,
        name: str | None = None,
        unset_ok: bool = False,
        least: float | None = None,
        most: float | None = None,
        also: tuple[float, ...] = (),
    ) -> None:
        super().__init__(kind, meaning, default, optional, name)
        self.unset_ok = unset_ok or optional
        self.least, self.most, self.also = least, most, also

    @overload
    def __get__(self, node: None, owner: type) -> InputPort[T]: ...
    @overload
    def __get__(self, node: object, owner: type) -> Input[T]: ...
    def __get__(self, node: object | None, owner: type) -> InputPort[T] | Input[T]:
        return self if node is None else cast(Input[T], self._own(node))


class OutputPort(Port, Generic[T]):
    """A port that a node writes."""

    direction = "output"

    def __init__(self, kind: type[T], meaning: str = "", default: str = UNSET, name: str | None = None) -> None:
        super().__init__(kind, meaning, default, True, name)

    @overload
    def __get__(self, node: None, owner: type) -> OutputPort[T]: ...
    @overload
    def __get__(self, node: object, owner: type) -> Output[T]: ...
    def __get__(self, node: object | None, owner: type) -> OutputPort[T] | Output[T]:
        return self if node is None else cast(Output[T], self._own(node))


class EntryPort(OutputPort[Any]):
    """A port that says which entry is meant, whatever its type: `{key}`, or the bare name."""

    names_entry = True

    def __init__(self, meaning: str = "", direction: str = "output") -> None:
        super().__init__(Any, meaning)
        self.direction = direction
        self.optional = False


class InOutPort(Port, Generic[T]):
    """A port that a node reads and writes."""

    def __init__(
        self, kind: type[T], meaning: str = "", default: str = UNSET, name: str | None = None, unset_ok: bool = False
    ) -> None:
        super().__init__(kind, meaning, default, False, name)
        self.unset_ok = unset_ok

    @overload
    def __get__(self, node: None, owner: type) -> InOutPort[T]: ...
    @overload
    def __get__(self, node: object, owner: type) -> InOut[T]: ...
    def __get__(self, node: object | None, owner: type) -> InOutPort[T] | InOut[T]:
        return self if node is None else cast(InOut[T], self._own(node))


def named(port: Port, name: str) -> Port:
    """A port that a file names and no class declares; its connection is among `further_of`."""
    port.name, port.attribute = name, _FURTHER + name
    return port


def further_of(node: object) -> dict[str, Any]:
    """Connections of a node's ports that only the file names, in its order."""
    return {key.removeprefix(_FURTHER): value for key, value in vars(node).items() if key.startswith(_FURTHER)}


def ports_of(node: type) -> dict[str, Port]:
    """Declared ports of a node class by their names in XML, base classes first."""
    ports: dict[str, Port] = {}
    for owner in reversed(node.__mro__):
        ports |= {port.name: port for port in vars(owner).values() if isinstance(port, Port)}
    return ports
