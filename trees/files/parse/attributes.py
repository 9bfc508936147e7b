"""What the attributes of an element mean: which are scripts, and which entry a port names."""

from __future__ import annotations

import re

from trees.engine.literals import TRUE_WORDS
from trees.files.parse.xml_file import Element

CONDITIONS = ("_failureIf", "_successIf", "_skipIf", "_while")
SCRIPTS_AFTER = ("_onSuccess", "_onFailure", "_onHalted", "_post")
# Attributes that Groot2 writes for itself.
NOTES = ("_uid", "_description", "_fullpath")

_POINTER = re.compile(r"\s*\{([^{}]*)\}\s*\Z")
KEY = re.compile(r"@?[^\W\d][\w./-]*\Z")


def entry_name(value: object, port: str, bare: bool = False) -> str | None:
    """The entry that `{key}` means for a port, `{=}` being the port's own name; None for a literal.

    Args:
        bare: a name without braces means the entry, too.
    """
    found = _POINTER.match(value) if isinstance(value, str) else None
    if found is None:
        return str(value) if bare else None
    return port if found[1] == "=" else found[1]


def autoremaps(element: Element) -> bool:
    """Whether all names of a SubTree mean those of the tree around it; a word that is no bool means no."""
    return element.get("_autoremap") in TRUE_WORDS
