"""Digest of all that a run saw, so that a changed input is noticed even where no decision hangs on it."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

INPUTS = ("/observation", "/bench", "/parts")
NAME = "inputs_sha256"  # of the digest in the metadata `outcome`


class InputDigest:
    """SHA-256 over topic and content of every message that holds an input, in the order of writing."""

    def __init__(self) -> None:
        self._sha256 = hashlib.sha256()

    def add(self, topic: str, content: bytes) -> None:
        """One more message; topics that hold no input are passed over."""
        if topic in INPUTS:
            self._sha256.update(f"{topic} {len(content)}\n".encode())
            self._sha256.update(content)

    def text(self) -> str:
        """The digest so far, in hexadecimal digits."""
        return self._sha256.hexdigest()


def inputs_sha256(messages: Iterable[tuple[str, bytes]]) -> str:
    """The digest of messages, given as (topic, content)."""
    digest = InputDigest()
    for topic, content in messages:
        digest.add(topic, content)
    return digest.text()
