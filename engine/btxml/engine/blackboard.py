"""The blackboard: entries in scopes, one scope for each SubTree, joined by remapping when the tree is loaded."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from btxml.engine.errors import NodeError
from btxml.engine.literals import LiteralError, a_type, converted, shown

UNSET: Any = object()
# Values of these very types are read and written as they stand where no port asks for another.
PLAIN = frozenset((bool, int, float, str))
_PLAINS = (int, float, str)


class Entry:
    """One value that nodes share.

    Attributes:
        name: its name in the scope that owns it.
        value: UNSET until the first write.
        kind: type of the port that writes it; Any where only scripts do, whose values the ports convert that read it.
        revision: number of writes so far.
        carried: the value comes from the tree that this one took over from in mid-run; until the next write.
        declared: a port names it, so that `=` may give it its first value.
        shown: a port of text is the first to name it, and none writes it: a script may give it a text at any time.
        text: how the file spells the value out that it passes to a SubTree, until the next write; a port of text
            reads "007" and no number.
    """

    __slots__ = ("carried", "declared", "kind", "name", "revision", "shown", "text", "value")

    def __init__(self, name: str) -> None:
        self.name = name
        self.value: Any = UNSET
        self.kind: Any = Any
        self.revision = 0
        self.carried = False
        self.declared = False
        self.shown = False
        self.text: str | None = None

    @property
    def exists(self) -> bool:
        """Whether `=` may write it."""
        return self.value is not UNSET or (self.declared and self.revision == 0)

    @property
    def holds_number(self) -> bool:
        """Whether it holds a number, and no port says that it must be anything else."""
        return self.kind is Any and not self.shown and isinstance(self.value, (int, float))

    def read(self, kind: Any = Any) -> Any:
        """The value as a port of type `kind` sees it.

        Raises:
            NodeError: nothing has been written yet, or what was does not fit.
        """
        value = self.value
        if value is UNSET:
            raise NodeError(f"nothing has been written to {{{self.name}}} yet")
        if type(value) is kind:
            return value
        if self.text is not None:
            value = self.text
        try:
            return converted(value, kind)
        except LiteralError as error:
            raise NodeError(f"{{{self.name}}} cannot be read: {error}; {error.legal}") from None

    def write(self, value: Any) -> None:
        """Replace the value, within the locked type.

        Raises:
            NodeError: the value does not fit the type.
        """
        kind = type(value)
        if kind is not self.kind and not (self.kind is Any and kind in PLAIN):
            try:
                value = converted(value, self.kind)
            except LiteralError as error:
                raise NodeError(f"{{{self.name}}} holds {a_type(self.kind)} and cannot be written: {error}") from None
        self.value = value
        self.revision += 1
        self.carried = False
        self.text = None

    def assign(self, value: Any) -> None:
        """Write from a script: where no port has locked a type, the first value does.

        Raises:
            NodeError: the value does not fit the type.
        """
        if self.kind is Any and type(value) is type(self.value) and type(value) in PLAIN:  # as `write`, without a call
            self.value, self.carried, self.text = value, False, None
            self.revision += 1
            return
        texts = self.shown and isinstance(value, str)
        if self.kind is Any and not texts and type(value) is not type(self.value) and isinstance(self.value, _PLAINS):
            kind = int if isinstance(self.value, bool) and not isinstance(value, bool) else type(self.value)
            try:
                value = converted(value, kind)
            except LiteralError as error:
                what = f"{{{self.name}}} holds {shown(self.value)} and cannot be assigned: {error}"
                raise NodeError(what) from None
        self.write(value)

    def clear(self) -> None:
        """Forget the value; who reads it next fails."""
        self.value = UNSET
        self.text = None
        self.revision += 1


class Scope:
    """The entries that one tree or SubTree sees by their names.

    Args:
        name: path of the SubTree, empty for the main tree.
        parent: scope around it, None for the main tree.
        autoremap: names that are not remapped mean the parent's, unless they begin with `_`.
    """

    def __init__(self, name: str = "", parent: Scope | None = None, autoremap: bool = False) -> None:
        self.name = name
        self.root: Scope = parent.root if parent else self
        self._parent = parent
        self._autoremap = autoremap
        self._entries: dict[str, Entry] = {}

    def entry(self, key: str) -> Entry:
        """The entry that `key` means here, made when first named; `@key` is the main tree's."""
        if key.startswith("@"):
            return self.root.entry(key[1:])
        if key not in self._entries:
            if self._parent and self._autoremap and not key.startswith("_"):
                self._entries[key] = self._parent.entry(key)
            else:
                self._entries[key] = Entry(key)
        return self._entries[key]

    def remap(self, key: str, entry: Entry) -> None:
        """Let `key` mean an entry of another scope."""
        self._entries[key] = entry

    def __contains__(self, key: object) -> bool:
        return key in self._entries

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def values(self) -> dict[str, Any]:
        """What is set, by name."""
        return {key: entry.value for key, entry in self._entries.items() if entry.value is not UNSET}
