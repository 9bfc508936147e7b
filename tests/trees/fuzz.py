"""Hostile and random tree files, scripts and monitor messages: each ends in an answer, soon, and without a traceback.

Run it: python -m tests.trees.fuzz --count 50000
"""

from __future__ import annotations

import argparse
import contextlib
import json
import random
import struct
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from bracket_cell.trees.node_library import node_registry
from bracket_cell.viewing.monitor import Monitor
from bracket_ground.interfaces.clock import ManualClock
from btxml.engine.blackboard import Scope
from btxml.engine.errors import NodeError, TreeFileError
from btxml.engine.script import ScriptError, parse_script
from btxml.files.check import Circumstances, findings
from btxml.files.compile.registry import Registry
from btxml.files.loader import load_tree
from tests import ROOT

LIMIT_S = 1.0  # of processor time
SOURCES = (*sorted((ROOT / "trees" / "jobs").glob("*.xml")), ROOT / "trees" / "commission.xml")
WORDS = (
    *(
        "x",
        "y",
        "@x",
        "1",
        "0",
        "-1",
        "2.5",
        "1e308",
        "9223372036854775807",
        "0x1F",
        "1e999",
        "'a'",
        '"b"',
        "''",
        "true",
    ),
    *(":=", "=", "+=", "*=", "/=", "==", "<", "<=", "&&", "||", "!", "~", "?", ":", ";", "..", "+", "-", "*", "/", "%"),
    *("(", ")", "((((", "SUCCESS", "nan", "\0", "é", "٣", "🤖", "'", '"', "\n", " ", "x" * 300, "9" * 400),
)
PIECES = (
    *(
        "<",
        ">",
        "/>",
        "</",
        "&amp;",
        "&#0;",
        "&x;",
        "<!--",
        "-->",
        "<![CDATA[",
        "]]>",
        "<?xml?>",
        '"',
        "'",
        "{",
        "}",
        "=",
    ),
    *("<Sequence>", "</Sequence>", '<SubTree ID="Main"/>', '_autoremap="true"', '_skipIf="x"', '_while="1/0"', "{=}"),
    *('num_cycles="-1"', '<include path="."/>', '<include path="/dev/zero"/>', "<!DOCTYPE a>", "\0", "é", "\ufeff"),
)
TREE = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence><Script code="a := 3; t := 'x'"/>
<Sleep msec="1000" _onSuccess="a += 1"/></Sequence></BehaviorTree></root>"""


def script(draw: random.Random) -> None:
    """A script of random words, parsed and run a few times."""
    scope = Scope()
    scope.entry("x").value, scope.entry("y").value = 3, "7"
    code = "".join(draw.choice(WORDS) for _ in range(draw.randint(1, 14)))
    try:
        parsed = parse_script(code, scope, {"SUCCESS": 2})
        for _ in range(5):
            parsed.run()
            parsed.true()
    except (ScriptError, NodeError):
        pass


class FileFuzz:
    """Tree files that were damaged at random, checked with and without stubs, and loaded where they are sound."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "tree.xml"
        self._texts = [path.read_text() for path in SOURCES]
        self._registries = node_registry(), Registry()

    def __call__(self, draw: random.Random) -> None:
        self._file.write_bytes(damaged(draw.choice(self._texts), draw).encode("utf-8", "surrogatepass"))
        registry = draw.choice(self._registries)
        known = Circumstances(stubs=registry is self._registries[1])
        if findings([self._file], registry, known).problems or known.stubs:
            return
        with contextlib.suppress(TreeFileError):
            load_tree(self._file, registry)


def damaged(text: str, draw: random.Random) -> str:
    """A text with pieces taken out, doubled, exchanged and put in."""
    for _ in range(draw.randint(1, 6)):
        start = draw.randrange(len(text) + 1)
        end = min(len(text), start + draw.choice((0, 1, 3, 20, 200)))
        middle = draw.choice(("", text[start:end] * 2, draw.choice((*PIECES, *WORDS))))
        text = text[:start] + middle + text[end:]
    return text


class MessageFuzz:
    """Random requests to a monitor with hooks; the tree goes on being ticked."""

    def __init__(self, folder: Path) -> None:
        file = folder / "monitored.xml"
        file.write_text(TREE)
        self._tree = load_tree(file, Registry())
        self._clock = ManualClock()
        self._tree.setup(None, self._clock)
        self._monitor = Monitor(self._tree, Registry(), 18_667, with_hooks=True)

    def __call__(self, draw: random.Random) -> None:
        head = struct.pack(
            "<BBI", draw.choice((2, 2, 2, 1, 255)), draw.choice(b"TSBrtIRUDAXN\0\xff"), draw.randrange(2**32)
        )
        body = json.dumps(self._order(draw, 3)).encode()
        if draw.random() < 0.3:
            body = draw.randbytes(draw.randrange(60))
        frames = draw.choice(([head], [head, body], [head[: draw.randrange(7)], body], [head, body, body]))
        answer = self._monitor.answer(frames)
        assert answer
        assert answer[0][:1] == b"\x02" or answer[0] == b"error"
        if draw.random() < 0.2:
            self._clock.sleep_until(self._clock.now_s() + draw.random())
            self._tree.tick()

    def _order(self, draw: random.Random, depth: int) -> object:
        plain: tuple[object, ...] = (
            None,
            True,
            -1,
            0,
            1,
            3,
            10**30,
            1e308,
            float("nan"),
            float("inf"),
            "",
            "SUCCESS",
            "x" * 99,
            [],
            {},
        )
        if depth == 0 or draw.random() < 0.2:
            return draw.choice(plain)
        if draw.random() < 0.2:
            return [self._order(draw, depth - 1) for _ in range(draw.randrange(4))]
        names = ("uid", "position", "mode", "once", "enabled", "desired_status", "remove_when_done", "other")
        return {
            name: self._order(draw, depth - 2 if depth > 1 else 0) for name in draw.sample(names, draw.randrange(8))
        }

    def close(self) -> None:
        """Let go of the port."""
        self._monitor.abandon()


def fuzz(count: int, first_seed: int = 0) -> dict[str, float]:
    """Try so many, two fifths files, two fifths scripts, one fifth messages; the longest time of each kind in [s].

    Raises:
        AssertionError: one took too long; anything else: a traceback that a user would see.
    """
    slowest: dict[str, float] = {}
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name:
        messages = MessageFuzz(Path(name))
        kinds: list[tuple[str, Callable[[random.Random], None]]] = [("file", FileFuzz(Path(name))), ("script", script)]
        turns: list[tuple[str, Callable[[random.Random], None]]] = [*kinds, *kinds, ("message", messages)]
        try:
            for seed in range(first_seed, first_seed + count):
                kind, attempt = turns[seed % len(turns)]
                began_s = time.process_time()
                try:
                    attempt(random.Random(seed))
                except Exception as error:
                    raise AssertionError(f"{kind} of seed {seed}: {error!r}") from error
                took_s = time.process_time() - began_s
                assert took_s < LIMIT_S, f"{kind} of seed {seed} took {took_s:.1f} s"
                slowest[kind] = max(slowest.get(kind, 0.0), took_s)
                counts[kind] += 1
        finally:
            messages.close()
    print(dict(counts), {kind: round(time_s, 3) for kind, time_s in slowest.items()})
    return slowest


def main() -> None:
    """Run it from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--first-seed", type=int, default=0)
    options = parser.parse_args()
    fuzz(options.count, options.first_seed)


if __name__ == "__main__":
    main()
