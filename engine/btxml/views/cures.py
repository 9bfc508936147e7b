"""What mends a problem: changes of the file's text, worked out from what its message says would be legal."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import NamedTuple

from btxml.engine.errors import Problem

_TAG = re.compile(r"<[^\s/>]+")
_ATTRIBUTE = re.compile(r"\s*[^\s=<>]+\s*=\s*(?:\"[^\"]*\"|'[^']*')")
_ELEMENT = re.compile(r"\s*<[^<]*/>")
_WORD = re.compile(r"(?:[\w@.-]|/(?=[\w@.-]))+")
INDENT = "  "


class Edit(NamedTuple):
    """Characters `start` to `end` of a file's text give way to others."""

    start: int
    end: int
    text: str


class Cure(NamedTuple):
    """A way to mend a problem.

    Attributes:
        title: what it does, for people.
    """

    title: str
    edits: tuple[Edit, ...]


Maker = Callable[[re.Match[str], str, int], Iterator[Cure]]


def cures(problem: Problem, text: str) -> list[Cure]:
    """What would mend a problem in the text of its file; nothing where only its author knows."""
    place = problem.place
    if place.line is None:
        return []
    start = sum(len(line) + 1 for line in text.split("\n")[: place.line - 1]) + (place.column or 1) - 1
    said = f"{problem.what}\n{problem.legal}"
    return [cure for pattern, make in _CURES if (found := pattern.search(said)) for cure in make(found, text, start)]


def _written(found: re.Match[str], text: str, start: int) -> Iterator[Cure]:
    """Words that are legal, each in the place of the wrong one."""
    wrong = _WORD.search(text, start)
    for word in re.split(r", | or ", found[1]) if wrong else ():
        if wrong and word != "..." and not _has(text, wrong, word):
            ends = _ends(text, wrong.start() - 1) if text.startswith("<", wrong.start() - 1) else None
            closing = [Edit(ends[0] + 2, ends[0] + 2 + len(wrong[0]), word)] if ends and ends[0] != ends[1] else []
            yield Cure(f"write {word}", (Edit(wrong.start(), wrong.end(), word), *closing))


def _has(text: str, wrong: re.Match[str], word: str) -> bool:
    """Whether a word would be the second attribute of its name in its element."""
    tag = text[text.rfind("<", 0, wrong.start()) : text.find(">", wrong.end())]
    return text[wrong.end() :].lstrip().startswith("=") and re.search(rf"\s{re.escape(word)}\s*=", tag) is not None


def _ends(text: str, start: int) -> tuple[int, int] | None:
    """Where the closing tag of the element at `start` begins, and where it ends; twice its end where it has none."""
    depth, name = 0, text[start + 1 :].partition(">")[0].split()[0].rstrip("/")
    for found in re.finditer(rf"<(/?){re.escape(name)}(?=[\s/>])[^>]*?(/?)>", text[start:]):
        depth += 0 if found[2] else -1 if found[1] else 1
        if depth == 0:
            return start + (found.start() if found[1] else found.end()), start + found.end()
    return None


def _insert(text: str, start: int, attribute: str) -> Iterator[Cure]:
    tag = _TAG.match(text, text.rfind("<", 0, start + 1))
    if tag is not None:
        yield Cure(f"add {attribute}", (Edit(tag.end(), tag.end(), f" {attribute}"),))


def _named(found: re.Match[str], text: str, start: int) -> Iterator[Cure]:
    for name in found[1].split(", "):
        yield from _insert(text, start, f'ID="{name}"')


def _needed(found: re.Match[str], text: str, start: int) -> Iterator[Cure]:
    return _insert(text, start, f'{found[1]}="{{=}}"')


def _given(found: re.Match[str], text: str, start: int) -> Iterator[Cure]:
    return _insert(text, start, found[1])


def _version(found: re.Match[str], text: str, start: int) -> Iterator[Cure]:
    if attribute := _ATTRIBUTE.match(text, start):
        yield Cure("write BTCPP_format", (Edit(start, attribute.end(), f'BTCPP_format="{found[1]}"'),))


def _main(found: re.Match[str], text: str, start: int) -> Iterator[Cure]:
    for name in re.findall(r"[\w.-]+", found[1]):
        yield from _insert(text, start, f'main_tree_to_execute="{name}"')


def _without(found: re.Match[str], text: str, start: int) -> Iterator[Cure]:
    begins = len(text[:start].rstrip())
    if attribute := _ATTRIBUTE.match(text, begins):
        yield Cure(f"remove {found[1]}", (Edit(begins, attribute.end(), ""),))


def _no_include(_: re.Match[str], text: str, start: int) -> Iterator[Cure]:
    begins = len(text[: text.rfind("<", 0, start + 1)].rstrip())
    if element := _ELEMENT.match(text, begins):
        yield Cure("remove this include", (Edit(begins, element.end(), ""),))


def _closed(found: re.Match[str], text: str, start: int) -> Iterator[Cure]:
    at = start if found[2] else len(text.rstrip())
    yield Cure(f"add {found[1]}", (Edit(at, at, found[1]),))


def _first(_: re.Match[str], text: str, start: int) -> Iterator[Cure]:
    """An entry that a script assigns is made there."""
    if sign := re.compile(r"[\w./-]+\s*(=)(?!=)").match(text, start):
        yield Cure("write :=", (Edit(sign.start(1), sign.end(1), ":="),))


def _guarded(found: re.Match[str], text: str, start: int) -> Iterator[Cure]:
    """A node behind a guard that is asked in every tick."""
    ends = _ends(text, start)
    for guard in found[1].split(", ") if ends else ():
        head, tail = f"<ReactiveSequence><{guard}/>", "</ReactiveSequence>"
        if ends:
            yield Cure(f"guard it with {guard}", (Edit(start, start, head), Edit(ends[1], ends[1], tail)))


def _in_sequence(_: re.Match[str], text: str, start: int) -> Iterator[Cure]:
    """Several nodes of a tree into a Sequence."""
    head, end = text.find(">", start), text.find("</BehaviorTree>", start)
    if 0 <= head < end:
        edits = Edit(head + 1, head + 1, "<Sequence>"), Edit(end, end, "</Sequence>")
        yield Cure("put them into a Sequence", edits)


def _new_tree(found: re.Match[str], text: str, _: int) -> Iterator[Cure]:
    if (end := text.rfind("</root>")) >= 0:
        body = f"\n{INDENT * 2}<AlwaysSuccess/>\n{INDENT}</BehaviorTree>\n"
        tree = f'{INDENT}<BehaviorTree ID="{found[1]}">{body}'
        yield Cure(f"add a BehaviorTree {found[1]}", (Edit(end, end, tree),))


_WORDS = r"^(?!this SubTree has no|.*main_tree_to_execute;)[^\n]*\n(?:.* takes )?"
_CURES: tuple[tuple[re.Pattern[str], Maker], ...] = tuple(
    (re.compile(pattern), make)
    for pattern, make in (
        (_WORDS + r"did you mean '([^']+)'", _written),
        (_WORDS + r"(?:legal:|one of) (.+)$", _written),
        (r"(true or false)$", _written),
        (r"must be <(root)>", _written),
        (r"must be BTCPP_format=\"(4)\"", _version),
        (r"needs port '([\w-]+)'", _needed),
        (r"this SubTree has no ID\nlegal: (.+)$", _named),
        (r"this BehaviorTree has no ID\n.*ID=\"(\w+)\"", _named),
        (r"rename (?:the tree|one of them), or .*?(_replaces=\"true\")", _given),
        (r"^BTCPP_format is missing.*?(BTCPP_format=\"4\")", _given),
        (r"main_tree_to_execute; (?:did you mean|legal:) (.*)", _main),
        (r"has no (?:port|attribute) '([^']+)'", _without),
        (r"reads no '([^']+)'", _without),
        (r"^'([^']+)' means nothing here", _without),
        (r"includes itself", _no_include),
        (r"add (</[^>]+>)()$", _closed),
        (r"(</[^>]+>) (must come first)", _closed),
        (r"put several into a Sequence", _in_sequence),
        (r"there is no BehaviorTree '([\w-]+)'", _new_tree),
        (r"write :=, which makes it", _first),
        (r"runs without a guard.*\n.* behind one of: (.+)$", _guarded),
    )
)
