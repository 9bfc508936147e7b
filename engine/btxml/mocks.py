"""Mocks from a file: which nodes of a tree are replaced in a test, and by what, as BehaviorTree.CPP 4.10 reads it.

    {"TestNodeConfigs": {"Late": {"return_status_script": "n > 2 ? SUCCESS : FAILURE", "async_delay": 200}},
     "SubstitutionRules": {"PickPart": "Late", "left/*": "AlwaysSuccess"}}

https://www.behaviortree.dev/docs/tutorial-advanced/tutorial_15_replace_rules
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from btxml.engine.blackboard import Scope
from btxml.engine.errors import NodeError, Place, TreeFileError
from btxml.engine.literals import STATUS_WORDS
from btxml.engine.node import FAILURE, RUNNING, SUCCESS, Node
from btxml.engine.ports import InputPort
from btxml.engine.script import Script, ScriptError, parse_script
from btxml.engine.status import IDLE, STATUSES, Status
from btxml.files.compile.registry import Registry, is_leaf
from btxml.files.parse.library import hint
from btxml.files.parse.xml_file import Attribute, Element

SCRIPTS = ("return_status_script", "success_script", "failure_script", "post_script")
KEYS = ("return_status", "async_delay", *SCRIPTS)
NUMBERS = (IDLE, RUNNING, SUCCESS, FAILURE, Status.SKIPPED)  # what a script may say instead of a name
_UID = re.compile(r"::\d+(?=/|$)")


class TestNode(Node):
    """Answers as a file of mocks says."""

    __test__ = False  # pytest collects by name

    return_status = InputPort(str, "its answer", default="SUCCESS")
    return_status_script = InputPort(Script, "works the answer out", optional=True)
    success_script = InputPort(Script, "runs when it succeeds", optional=True)
    failure_script = InputPort(Script, "runs when it fails", optional=True)
    post_script = InputPort(Script, "runs when it ends", optional=True)
    async_delay = InputPort(int, "time before it answers in [ms]", default=0)

    def initialise(self) -> None:
        self._end_s = self.runtime.clock.now_s() + self.async_delay.get() / 1000

    def update(self) -> Status:
        late = self.async_delay.get() > 0
        if self.runtime.clock.now_s() < self._end_s or (self.status is RUNNING and not late):
            return RUNNING
        answer = self._answer()
        for port, when in ((self.success_script, SUCCESS), (self.failure_script, FAILURE), (self.post_script, answer)):
            if answer is when and port.entry is not None:
                port.get().run()
        return answer

    def _answer(self) -> Status:
        if self.return_status_script.entry is None:
            return STATUS_WORDS[self.return_status.get()]
        found = self.return_status_script.get().run()
        if isinstance(found, int | float) and found in range(len(NUMBERS)):
            found = NUMBERS[int(found)]
        status = STATUSES.get(found, IDLE) if isinstance(found, str) else found
        if not isinstance(status, Status) or status is IDLE:
            raise NodeError(f"return_status_script gives {found!r}; one of {', '.join(STATUS_WORDS)}")
        return status


@dataclass(frozen=True)
class Mocks:
    """What replaces which nodes.

    Attributes:
        rules: patterns of names, tags or paths (`*` for any text, `?` for a character), and the node or configuration.
        configured: attributes of test nodes by the name of their configuration.
        used: rules that have replaced a node so far.
    """

    file: Path = Path()
    rules: Mapping[str, str] = field(default_factory=dict)
    configured: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)

    def instead(self, element: Element, tag: str, name: str, path: str) -> tuple[str, Element] | None:
        """The node that takes the place of another, and its attributes; None where no rule fits."""
        for pattern, wanted in self.rules.items():
            if pattern in (name, tag) or any(_fits(pattern, text) for text in (path, _UID.sub("", path))):
                self.used.add(pattern)
                own = wanted in self.configured
                return (TestNode.__name__, self._element(element, wanted)) if own else (wanted, element)
        return None

    def _element(self, element: Element, wanted: str) -> Element:
        place = Place(self.file)
        own = {key: Attribute(value, place, place, value) for key, value in self.configured[wanted].items()}
        kept = {
            key: attribute
            for key, attribute in element.attributes.items()
            if key in ("name", "ID") or key.startswith("_")
        }
        return replace(element, attributes={**kept, **own})


def read_mocks(file: Path, registry: Registry) -> Mocks:
    """Read a file of mocks.

    Args:
        registry: the nodes that may take another's place, and the names that scripts know.

    Raises:
        TreeFileError: everything that is wrong with it.
    """
    try:
        data = json.loads(file.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise TreeFileError(f"{file}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    sections = ("TestNodeConfigs", "SubstitutionRules")
    parts: list[Any] = [data.get(section, {}) for section in sections] if isinstance(data, dict) else [None]
    if not all(isinstance(part, dict) for part in parts) or set(data) - {*sections}:
        raise TreeFileError(f"{file}: holds an object with {' and '.join(sections)}, which are objects, too")
    problems: list[str] = []
    configured = {name: _configured(how, f"{file}: {name}", registry.enums, problems) for name, how in parts[0].items()}
    rules = parts[1]
    legal = {*configured, *(tag for tag, node in registry.classes.items() if is_leaf(node))}
    for pattern, wanted in rules.items():
        if not isinstance(wanted, str) or wanted not in legal:
            which = hint(str(wanted), legal, "name a TestNodeConfig or a leaf")
            problems.append(f"{file}: '{pattern}' is replaced by {wanted!r}; {which}")
    if problems:
        raise TreeFileError(*problems)
    return Mocks(file, rules, configured)


def _configured(config: Any, where: str, enums: Mapping[str, Any], problems: list[str]) -> dict[str, str]:
    checks: dict[str, Callable[[Any], bool]] = {
        "return_status": lambda value: isinstance(value, str) and value in STATUS_WORDS,
        "async_delay": lambda value: isinstance(value, int) and not isinstance(value, bool) and value >= 0,
    }
    if not isinstance(config, dict) or not {"return_status", "return_status_script"} & set(config):
        problems.append(f"{where} needs return_status or return_status_script")
        return {}
    for key, value in config.items():
        if key not in KEYS:
            problems.append(f"{where} has no '{key}'; {hint(key, KEYS)}")
        elif key in SCRIPTS:
            _script(value, f"{where}: {key}", enums, problems)
        elif not checks[key](value):
            legal = "one of " + ", ".join(STATUS_WORDS) if key == "return_status" else "whole milliseconds from 0"
            problems.append(f"{where}: {key} is {value!r}; {legal}")
    return {key: str(value) for key, value in config.items()}


def _script(value: Any, where: str, enums: Mapping[str, Any], problems: list[str]) -> None:
    try:
        parse_script(value if isinstance(value, str) else "", Scope(), enums)
    except ScriptError as error:
        problems.append(f"{where}: bad script: {error}" + (f"; {error.legal}" if error.legal else ""))


def _fits(pattern: str, text: str) -> bool:
    return re.fullmatch(re.escape(pattern).replace(r"\*", ".*").replace(r"\?", "."), text, re.DOTALL) is not None
