"""Who may operate a served page, or look at it: browsers that were paired once by a code, until they are taken out."""

from __future__ import annotations

import json
import secrets
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import get_args

from bracket_cell.viewing.page.web import Role, same
from bracket_ground.errors import InputError, Place, Problem, words_of
from bracket_ground.files.files import whole_or_none

DIGITS = 8
WRONG_N = 5  # codes that may be guessed before others are drawn
NAME_MOST = 40


@dataclass(frozen=True)
class Browser:
    """One that was paired.

    Attributes:
        sha256: of its token, 192 random bits, which is kept nowhere else.
        name: as its user named it, for the book.
    """

    sha256: str
    role: Role
    name: str
    since_utc: str


class Paired:
    """The browsers of a file; whoever takes a line out of it takes the browser's right.

    Args:
        news: is called when the codes change.

    Attributes:
        codes: that pair the next browser, by role; another one after each use.

    Raises:
        InputError: the file cannot be read.
    """

    def __init__(self, path: Path, news: Callable[[], None] = lambda: None) -> None:
        self._path, self._news, self._wrong = path, news, 0
        self._read_ns, self._browsers = 0, list[Browser]()
        self.codes = _drawn()
        self._look()

    def role_of(self, token: str) -> Role | None:
        """What the browser with this token may do."""
        found = self.browser(token)
        return None if found is None else found.role

    def browser(self, token: str) -> Browser | None:
        """That has this token."""
        self._look()
        digest = sha256(token.encode()).hexdigest()
        return next((browser for browser in self._browsers if same(browser.sha256, digest)), None)

    def pair(self, code: str, name: str) -> tuple[str, Role]:
        """A token for a browser that says a code, and what it may do.

        Raises:
            InputError: the code is none, or there is no name.
        """
        name = " ".join(name.split())[:NAME_MOST]
        if not (name and name.isprintable()):
            raise InputError("say who operates this page, or where it hangs")
        role = next((role for role, known in self.codes.items() if same(code.strip(), known)), None)
        if role is None:
            self._wrong += 1
            if self._wrong >= WRONG_N:
                self._draw()
            raise InputError("this is not the code that the cell shows")
        self._look()
        token = secrets.token_urlsafe(24)
        now = datetime.now(UTC).isoformat(timespec="seconds")
        self._browsers.append(Browser(sha256(token.encode()).hexdigest(), role, name, now))
        with whole_or_none(self._path) as partial:
            partial.touch(0o600)
            partial.write_text("".join(json.dumps(asdict(browser)) + "\n" for browser in self._browsers), "utf-8")
        self._draw()
        return token, role

    def _draw(self) -> None:
        self.codes, self._wrong = _drawn(), 0
        self._news()

    def _look(self) -> None:
        """Read the file where somebody changed it."""
        try:
            changed_ns = self._path.stat().st_mtime_ns
            if changed_ns == self._read_ns:
                return
            lines = self._path.read_text("utf-8").splitlines()
            browsers = [Browser(**json.loads(line)) for line in lines if line.strip()]
            if any(browser.role not in get_args(Role) for browser in browsers):
                raise ValueError("a role is operate or look")
        except FileNotFoundError:
            self._read_ns, self._browsers = 0, []
        except (OSError, ValueError, TypeError) as error:
            self._read_ns, self._browsers = 0, []  # nobody comes in by a file that says nothing
            raise InputError(Problem(Place(self._path), f"is no list of browsers: {words_of(error)}")) from None
        else:
            self._read_ns, self._browsers = changed_ns, browsers


def _drawn() -> dict[Role, str]:
    return {role: f"{secrets.randbelow(10**DIGITS):0{DIGITS}d}" for role in get_args(Role)}
