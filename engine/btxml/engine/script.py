"""BehaviorTree.CPP's script language: checked when a tree is loaded, compiled to Python for its ticks.

Grammar, loosest binding first (all statements are separated by `;`, the value is that of the last one):
    statement:  name (:= | = | += | -= | *= | /=) statement | choice
    choice:     or [? choice : choice]
    operators:  ||  &&  == != < <= > >= (chained)  | ^  &  + - ..  * /  unary - ! ~
    operand:    number, 0xhex, 'string', true, false, enum name, entry name, (statement)
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from textwrap import shorten
from typing import Any, NamedTuple

from btxml.engine.blackboard import UNSET, Entry, Scope
from btxml.engine.errors import NodeError
from btxml.engine.literals import INT_LIMIT, shown
from btxml.engine.operators import COMPARISONS, OPERATORS, number_of, truth, unary

DEPTH_LIMIT = 30
# More than anybody reads; a hostile file could hold a million.
LENGTH_LIMIT, TOKEN_LIMIT = 10_000, 400

_TOKEN = re.compile(
    r"""\s*(?:
      (?P<number>0[xX][0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)
    | (?P<string>'[^']*'|"[^"]*")
    | (?P<name>@?[^\W\d]\w*)
    | (?P<sign>:=|\+=|-=|\*=|/=|==|!=|<=|>=|&&|\|\||\.\.|[-+*/=<>!~&|^?:;()])
    | (?P<end>\Z)
    )""",
    re.VERBOSE,
)
_ASSIGNMENTS = (":=", "=", "+=", "-=", "*=", "/=")
# What people write who know other languages.
_MEANT = {"and": "&&", "or": "||"}
_LEVELS: tuple[Collection[str], ...] = (("||",), ("&&",), COMPARISONS, ("|", "^"), ("&",), ("+", "-", ".."), ("*", "/"))


class ScriptError(ValueError):
    """A script that cannot be compiled; `offset` is where, `legal` what would be right."""

    def __init__(self, what: str, offset: int, legal: str = "") -> None:
        super().__init__(what)
        self.offset = offset
        self.legal = legal


class EntryUse(NamedTuple):
    """What a script does with an entry.

    Attributes:
        name, offset: what the source calls it, and where.
        sign: the assignment, empty where the entry is only read.
        constant: the value that is assigned, where the script spells it out; else UNSET.
    """

    entry: Entry
    name: str
    offset: int
    sign: str
    constant: Any = UNSET


class Evaluated(NamedTuple):
    """A script that was asked whether it is true, with the values that it read then."""

    script: Script
    true: bool
    values: tuple[Any, ...]

    def __str__(self) -> str:
        names = [entry.name for entry in self.script.reads]
        held = [
            f"{name} = {'nothing' if value is UNSET else shown(value)}"
            for name, value in zip(names, self.values, strict=True)
        ]
        return f"'{self.script.source}' is {str(self.true).lower()}" + (f", {', '.join(held)}" if held else "")

    @property
    def otherwise(self) -> str:
        """What would have changed it; empty for a script that reads nothing."""
        return f"if '{self.script.source}' were {str(not self.true).lower()}" if self.values else ""


class Script:
    """A script, ready to run.

    Attributes:
        uses: what it does with entries, in the order of the source.
    """

    def __init__(self, source: str, uses: tuple[EntryUse, ...], code: ast.expr, names: Mapping[str, Any]) -> None:
        self.source = source
        self.uses = uses
        self._code, self._names = code, names
        self._evaluate: Callable[[], Any] = self._compiled

    def run(self) -> Any:
        """Run all statements; the value of the last one.

        Raises:
            NodeError: an entry is unset, its type does not fit the operator, or anything else went wrong.
        """
        try:
            return self._evaluate()
        except NodeError:
            raise
        except Exception as error:  # values may be of a user's own types, whose operators may raise anything
            raise _told(error) from error

    def true(self) -> bool:
        """Whether the value is true: a number other than 0, or a string that is not empty."""
        try:
            value = self._evaluate()
        except NodeError:
            raise
        except Exception as error:  # as above
            raise _told(error) from error
        return value if value is True or value is False else truth(value)

    @cached_property
    def reads(self) -> tuple[Entry, ...]:
        """Entries that it reads, each once."""
        return tuple(dict.fromkeys(use.entry for use in self.uses if use.sign not in (":=", "=")))

    def evaluated(self, true: bool) -> Evaluated:
        """What it was asked with, kept for who asks why."""
        return Evaluated(self, true, tuple([entry.value for entry in self.reads]))

    def _compiled(self) -> Any:
        """Become a function of Python's own, and run: only now, as most scripts of a checked file never do."""
        arguments = ast.arguments(posonlyargs=[], args=[], kwonlyargs=[], kw_defaults=[], defaults=[])
        made = ast.Expression(ast.Lambda(arguments, self._code, **_AT))
        self._evaluate = eval(compile(made, "script", "eval"), {**_WORDS, **self._names})
        return self._evaluate()


def _told(error: Exception) -> NodeError:
    return NodeError(f"the script failed: {type(error).__name__}: {shown(str(error))}")


def parse_script(source: str, scope: Scope, enums: Mapping[str, Any]) -> Script:
    """Compile a script whose names mean entries of `scope` or enum members.

    Raises:
        ScriptError: it is no legal script.
    """
    return _Parser(source, scope, enums).script()


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    offset: int


class _Parser:
    """Precedence climbing; every rule returns the Python expression that evaluates it."""

    def __init__(self, source: str, scope: Scope, enums: Mapping[str, Any]) -> None:
        self._source = source
        self._scope = scope
        self._enums = enums
        self._tokens = list(_tokens(source))
        self._next = 0
        self._depth = 0
        self._uses: list[EntryUse] = []
        self._names: dict[str, Any] = {"enums": enums}

    def script(self) -> Script:
        statements = []
        while self._peek().kind != "end":
            if not self._accept(";"):
                statements.append(self._statement())
                if self._peek().kind != "end" and self._peek().text != ";":
                    raise self._unexpected("an operator or ';'")
        if not statements:
            raise ScriptError("the script is empty", 0, "like done := true")
        code = statements[0] if len(statements) == 1 else _call("last", *statements)
        return Script(self._source, tuple(self._uses), code, self._names)

    def _statement(self) -> ast.expr:
        self._depth += 1
        if self._depth > DEPTH_LIMIT:
            raise ScriptError(f"brackets nest deeper than {DEPTH_LIMIT}", self._peek().offset)
        name, sign = self._tokens[self._next], self._tokens[min(self._next + 1, len(self._tokens) - 1)]
        if name.kind == "name" and sign.text in _ASSIGNMENTS:
            evaluate = self._assignment(name, sign.text)
        else:
            evaluate = self._choice()
            if self._peek().text in _ASSIGNMENTS:
                raise ScriptError(f"'{self._peek().text}' needs a name on its left", self._peek().offset, "like n := 1")
        self._depth -= 1
        return evaluate

    def _assignment(self, name: _Token, sign: str) -> ast.expr:
        if name.text in self._enums:
            what = f"'{name.text}' is an enum name and cannot be written"
            raise ScriptError(what, name.offset, "choose another name")
        self._next += 2
        first = self._peek()
        value = self._statement()
        spelt_out = self._tokens[self._next - 1] is first
        literal = value.value if spelt_out and isinstance(value, ast.Constant) else UNSET
        entry = self._scope.entry(name.text)
        self._uses.append(EntryUse(entry, name.text, name.offset, sign, literal))
        known = self._named(entry)
        if sign not in (":=", "="):
            value = _call(sign[0], _read(known), value)
        return _call("assign", known if sign == ":=" else _call("existing", known), value, _name("enums"))

    def _choice(self) -> ast.expr:
        condition = self._level(0)
        if not self._accept("?"):
            return condition
        chosen = self._statement()
        self._expect(":")
        other = self._statement()
        return ast.IfExp(_call("truth", condition), chosen, other, **_AT)

    def _level(self, level: int) -> ast.expr:
        if level == len(_LEVELS):
            return self._unary()
        signs = _LEVELS[level]
        left = self._level(level + 1)
        if signs is COMPARISONS:
            return self._comparison(left, level)
        while self._peek().kind == "sign" and self._peek().text in signs:
            sign = self._take().text
            right = self._level(level + 1)
            if sign in _LOGIC:
                left = ast.BoolOp(_LOGIC[sign], [_call("truth", left), _call("truth", right)], **_AT)
            else:
                left = _call(sign, left, right)
        return left

    def _comparison(self, first: ast.expr, level: int) -> ast.expr:
        """`a < b < c` holds where both do; what stands between two signs is evaluated once."""
        links: list[ast.expr] = []
        left = first
        while self._peek().text in COMPARISONS and self._peek().kind == "sign":
            sign, right = self._take().text, self._level(level + 1)
            if self._peek().text in COMPARISONS and self._peek().kind == "sign":
                kept = f"v{self._next}"
                links.append(_call(sign, left, ast.NamedExpr(_name(kept, ast.Store()), right, **_AT), _name("enums")))
                left = _name(kept)
            else:
                links.append(_call(sign, left, right, _name("enums")))
        if not links:
            return first
        return links[0] if len(links) == 1 else ast.BoolOp(ast.And(), links, **_AT)

    def _unary(self) -> ast.expr:
        token = self._peek()
        if token.kind == "sign" and token.text in ("-", "!", "~"):
            self._depth += 1
            if self._depth > DEPTH_LIMIT:
                raise ScriptError(f"operators nest deeper than {DEPTH_LIMIT}", token.offset)
            self._take()
            operand = self._unary()
            self._depth -= 1
            return _call("unary", ast.Constant(token.text, **_AT), operand)
        return self._operand()

    def _operand(self) -> ast.expr:
        token = self._peek()
        if token.kind == "end" or (token.kind == "sign" and token.text != "("):
            raise self._unexpected("a number, 'string', name or '('")
        self._take()
        if token.kind == "number":
            return ast.Constant(_number(token), **_AT)
        if token.kind == "string":
            return ast.Constant(token.text[1:-1], **_AT)
        if token.kind == "name":
            return self._name(token)
        inner = self._statement()
        self._expect(")")
        return inner

    def _name(self, token: _Token) -> ast.expr:
        if token.text in ("true", "false"):
            return ast.Constant(token.text == "true", **_AT)
        if token.text in self._enums:
            return self._named(self._enums[token.text])
        entry = self._scope.entry(token.text)
        self._uses.append(EntryUse(entry, token.text, token.offset, ""))
        return _read(self._named(entry))

    def _named(self, value: Any) -> ast.Name:
        """A value that Python cannot spell out, by a name of its own."""
        name = f"n{len(self._names)}"
        self._names[name] = value
        return _name(name)

    def _peek(self) -> _Token:
        return self._tokens[self._next]

    def _take(self) -> _Token:
        token = self._tokens[self._next]
        self._next = min(self._next + 1, len(self._tokens) - 1)
        return token

    def _accept(self, text: str) -> bool:
        if self._peek().kind == "sign" and self._peek().text == text:
            self._next += 1
            return True
        return False

    def _expect(self, text: str) -> None:
        if not self._accept(text):
            raise self._unexpected(f"'{text}'")

    def _unexpected(self, wanted: str) -> ScriptError:
        token = self._peek()
        found = "the script ends" if token.kind == "end" else f"'{token.text}' stands"
        before = self._tokens[self._next - 1].text.lower() if self._next else ""
        meant = _MEANT.get(token.text.lower(), "!" if before == "not" else "")
        legal = f"did you mean '{meant}'?" if meant else ""
        return ScriptError(f"{found} where {wanted} is expected", token.offset, legal)


def _tokens(source: str) -> list[_Token]:
    if len(source) > LENGTH_LIMIT:
        raise ScriptError(f"{len(source)} characters are too many", 0, f"at most {LENGTH_LIMIT}; use several Scripts")
    tokens: list[_Token] = []
    position = 0
    while not tokens or tokens[-1].kind != "end":
        found = _TOKEN.match(source, position)
        if found is None:
            rest = source[position:]
            offset = position + len(rest) - len(rest.lstrip())
            raise _unknown(source, offset)
        if len(tokens) == TOKEN_LIMIT:
            raise ScriptError(f"more than {TOKEN_LIMIT} names, numbers and operators", position, "use several Scripts")
        kind = found.lastgroup or "end"
        tokens.append(_Token(kind, found[kind], found.start(kind)))
        position = found.end()
    return tokens


def _unknown(source: str, offset: int) -> ScriptError:
    """What begins at `offset` is no word of the language."""
    if (quote := source[offset]) in "'\"":
        start = source[offset:].split(";")[0]
        what = f"the text {shorten(start, 30, placeholder='...')} has no end"
        return ScriptError(what, offset, f"close it with {quote}")
    word = re.match(r"\S\w*", source[offset:])
    what = f"'{word[0] if word else source[offset]}' has no meaning here"
    return ScriptError(what, offset, "see `cell docs trees` for the operators")


def _number(token: _Token) -> int | float:
    text = token.text
    hexadecimal = text[:2] in ("0x", "0X")
    if hexadecimal and len(text) > 18:
        raise ScriptError(f"'{shorten(text, 30, placeholder='...')}' is too large", token.offset, "at most 64 bits")
    if hexadecimal or (text.isdigit() and len(text) <= 20):
        whole = int(text, 16 if hexadecimal else 10)
        return whole if whole < INT_LIMIT else float(whole)
    if not math.isfinite(float(text)):
        raise ScriptError(f"'{text[:12]}' is too large a number", token.offset, "at most 1.7e308")
    return float(text)


_AT: Any = {"lineno": 1, "col_offset": 0, "end_lineno": 1, "end_col_offset": 0}
_LOGIC: dict[str, ast.boolop] = {"&&": ast.And(), "||": ast.Or()}


def _name(name: str, use: ast.expr_context | None = None) -> ast.Name:
    return ast.Name(name, use or ast.Load(), **_AT)


def _call(function: str, *arguments: ast.expr) -> ast.expr:
    return ast.Call(_name(function), list(arguments), [], **_AT)


def _read(entry: ast.Name) -> ast.expr:
    """`entry.value`, where there is one; without a call, as scripts do little else."""
    value = ast.Attribute(entry, "value", ast.Load(), **_AT)
    is_set = ast.Compare(value, [ast.IsNot()], [_name("UNSET")], **_AT)
    return ast.IfExp(is_set, value, _call("unset", entry), **_AT)


def _unset(entry: Entry) -> Any:
    raise NodeError(f"nothing has been written to {{{entry.name}}} yet")


def _existing(entry: Entry) -> Entry:
    if entry.value is UNSET and not entry.exists:
        raise NodeError(f"{{{entry.name}}} does not exist yet; := creates it")
    return entry


def _assign(entry: Entry, assigned: Any, enums: Mapping[str, Any]) -> Any:
    if isinstance(assigned, str) and entry.holds_number:
        try:
            assigned = number_of(assigned, enums)
        except NodeError as error:
            raise NodeError(f"{{{entry.name}}} holds {entry.value!r} and cannot be assigned: {error}") from None
        entry.write(assigned)
    else:
        entry.assign(assigned)
    return entry.value


def _last(*values: Any) -> Any:
    return values[-1]


# What compiled scripts call; a sign is no name of Python's, but names a global all the same.
_WORDS: dict[str, Any] = {
    **OPERATORS,
    **COMPARISONS,
    **{"UNSET": UNSET, "unset": _unset, "existing": _existing, "assign": _assign, "last": _last},
    **{"truth": truth, "unary": unary, "__builtins__": {}},
}
