"""Hints for people who mistyped a word."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

MOST_WORDS = 12


def is_near(word: str, legal: Iterable[str]) -> bool:
    """Whether a word is written much like a legal one."""
    return bool(difflib.get_close_matches(word.lower(), [one.lower() for one in legal], n=1, cutoff=0.6))


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
