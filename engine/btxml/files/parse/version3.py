"""Turns tree files of BehaviorTree.CPP 3 into those of version 4; comments and layout stay.

What changed from 3 to 4: https://www.behaviortree.dev/docs/migration.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from dataclasses import dataclass, field
from pathlib import Path

from btxml.engine.errors import Place, Problem
from btxml.engine.literals import TRUE_WORDS, number_in
from btxml.files.parse.xml_file import CONDITIONS, EXPLICIT, FORMAT, SCRIPTS_AFTER, entry_name

RENAMED = {
    "SequenceStar": "SequenceWithMemory",
    "FallbackStar": "Fallback",
    "RetryUntilSuccesful": "RetryUntilSuccessful",
    "SubTreePlus": "SubTree",
}
PORTS = {
    "Parallel": {
        "threshold": "success_count",
        "success_threshold": "success_count",
        "failure_threshold": "failure_count",
    }
}
CHECKS = tuple(f"BlackboardCheck{kind}" for kind in ("Int", "Double", "String", "Bool"))
GONE = {
    "ManualSelector": "ask a person: AskOperator, and a Switch on the answer",
    "BlackboardPrecondition": "use Precondition",
}
INSTEAD = {
    **{name: f"did you mean '{new}'?" for name, new in RENAMED.items()},
    **dict.fromkeys(CHECKS, "use Precondition"),
    **GONE,
}
RESERVED = (*CONDITIONS, *SCRIPTS_AFTER, "_autoremap")
_TAG = re.compile(
    r"""<!--.*?-->|<\?.*?\?>|<(/?)([^\s/>!?]+)((?:\s+[^\s=<>]+\s*=\s*(?:"[^"]*"|'[^']*'))*)(\s*/?>)""", re.DOTALL
)
_ATTRIBUTE = re.compile(r"""(\s+)([^\s=]+)(\s*=\s*)("[^"]*"|'[^']*')""")
Pairs = dict[str, str]


@dataclass
class Converted:
    """A file of version 3 as one of version 4.

    Attributes:
        text: the whole file.
        changes: what was written otherwise, beside the format's own number, each with its place in the old file.
        lost: what version 4 does not say, or says with another meaning.
    """

    text: str = ""
    changes: list[Problem] = field(default_factory=list)
    lost: list[Problem] = field(default_factory=list)


def convert(path: Path, text: str) -> Converted:
    """The file of version 4 for a well-formed file of version 3."""
    converter = _Converter(path, text)
    converter.told.text = _TAG.sub(converter.tag, text)
    return converter.told


class _Converter:
    """Goes through the tags of a file."""

    def __init__(self, path: Path, text: str) -> None:
        self._path = path
        self._lines = [0, *(found.end() for found in re.finditer("\n", text))]  # where each begins
        self._in_models = False
        self.told = Converted()

    def tag(self, found: re.Match[str]) -> str:
        """A tag as it is in version 4."""
        slash, name, written, end = found.groups()
        if name is None:
            return found[0]
        if name == "TreeNodesModel":
            self._in_models = not slash and "/" not in end
        new = RENAMED.get(name, "Precondition" if name in CHECKS else name)
        if slash:
            return f"</{new}{end}"
        node = re.search(r"\sID\s*=\s*[\"']([^\"']*)", written) if name in EXPLICIT else None
        attributes = self._attributes(found, node[1] if node else name) if not self._in_models else written
        if new != name:
            self._change(found.start(), f"{name} is {new}")
        return f"<{new}{attributes}{end}"

    def _attributes(self, found: re.Match[str], node: str) -> str:
        start, written = found.start(), found[3]
        pairs = {found[2]: found[4][1:-1] for found in _ATTRIBUTE.finditer(written)}
        if node == "root":
            rest = _ATTRIBUTE.sub(lambda found: "" if found[2] == "BTCPP_format" else found[0], written)
            return f' BTCPP_format="{FORMAT}"{rest}'
        if node in GONE:
            self._lose(start, f"version 4 has no {node}", GONE[node])
        if node in ("SubTree", "SubTreePlus"):
            new = self._subtree(start, node, pairs)
        elif node in CHECKS:
            new = self._check(start, node, pairs)
        else:
            new = self._plain(start, found[2], node, pairs)
        if list(new.items()) == list(pairs.items()):
            return written
        if new.keys() == pairs.keys():  # the values alone are other ones
            return _ATTRIBUTE.sub(lambda found: f"{found[1]}{found[2]}{found[3]}{_quoted(new[found[2]])}", written)
        lead = _ATTRIBUTE.match(written)
        return "".join(f"{lead[1] if lead else ' '}{key}={_quoted(value)}" for key, value in new.items())

    def _subtree(self, start: int, node: str, pairs: Pairs) -> Pairs:
        """A plain SubTree joins entries that are written without braces; SubTreePlus is what SubTree is now."""
        new: Pairs = {}
        for key, value in pairs.items():
            if key in ("__shared_blackboard", "__autoremap"):
                self._change(start, f"{key} is _autoremap" if value in TRUE_WORDS else f"{key} is left out")
                if value in TRUE_WORDS:
                    new["_autoremap"] = "true"
                if value in TRUE_WORDS and key == "__shared_blackboard":
                    what = "names that begin with _ are not shared with a SubTree any more"
                    self._lose(start, what, "join them one by one, or write @name")
            elif node == "SubTreePlus" or key in ("ID", "name") or key.startswith("_") or entry_name(value, key):
                new[key] = value
            else:
                self._change(start, f'{key}="{value}" joins an entry, which is {key}="{{{value}}}"')
                new[key] = f"{{{value}}}"
        return new

    def _check(self, start: int, node: str, pairs: Pairs) -> Pairs:
        """BlackboardCheckInt and its kin are a Precondition."""
        as_text = node.endswith("String")
        first, second = (_operand(pairs.get(name, ""), as_text) for name in ("value_A", "value_B"))
        what = f"{node} looked at its entries in every tick, and Precondition looks before its child begins"
        self._lose(start, what, "put a ScriptCondition and the child into a ReactiveSequence")
        new = {"if": f"{first} == {second}", "else": pairs.get("return_on_mismatch", "FAILURE")}
        return {key: value for key, value in pairs.items() if key == "name"} | new

    def _plain(self, start: int, tag: str, node: str, pairs: Pairs) -> Pairs:
        new: Pairs = {}
        for key, value in pairs.items():
            port = PORTS.get(node, {}).get(key, key)
            if tag in EXPLICIT and key == "ID":
                value = RENAMED.get(value, value)
                if value in CHECKS:
                    self._lose(start, f"version 4 has no {value}", "use Precondition")
            if key in RESERVED:
                self._lose(start, f"port '{key}' of {node} has a name that version 4 keeps for itself", "rename it")
            if port != key or value != pairs[key]:
                self._change(start, f"{key}={_quoted(pairs[key])} is {port}={_quoted(value)}")
            new[port] = value
        return new

    def _change(self, offset: int, what: str) -> None:
        self.told.changes.append(Problem(self._place(offset), what))

    def _lose(self, offset: int, what: str, legal: str) -> None:
        self.told.lost.append(Problem(self._place(offset), what, legal))

    def _place(self, offset: int) -> Place:
        line = bisect_right(self._lines, offset)
        return Place(self._path, line, offset - self._lines[line - 1] + 1)


def _operand(value: str, as_text: bool) -> str:
    """A value of version 3 in a script."""
    entry = entry_name(value, "")
    if entry is not None:
        return entry
    return value if not as_text and (number_in(value) is not None or value in ("true", "false")) else f"'{value}'"


def _quoted(value: str) -> str:
    return f"'{value}'" if '"' in value else f'"{value}"'
