"""Logs that lie: names, types, sizes and nesting of what they say are flipped, and nothing of it may be called."""

from __future__ import annotations

import copy
import signal
import struct
import sys
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from hypothesis import strategies as st

LIMIT_S = 30.0  # wall time of one example; most take milliseconds
NAMES = (
    "execute", "update", "runtime", "children", "services", "__class__", "__init__", "__dict__", "_follower", "status",
    "n", "ref", "named", "kept", "record", "object", "function", "partial", "method", "enum", "float", "array", "tuple",
    "dict", "frozen", "deque", "set", "of", "form", "tick", "lost", "learned", "number", "time_s", "files", "x" * 300,
)  # fmt: skip
CODE = (
    "os.system", "subprocess.Popen", "builtins.eval", "bracket_cell.skills.motion.separation.np.testing.runstring",
    "bracket_cell.recording.sink.LogSink", "bracket_cell.skills.drivers.ur.UrArm", "btxml.engine.tree.Tree",
    "bracket_ground.interfaces.pose.Pose",
    "bracket_cell.skills.grasping.phases.Move", "bracket_cell.skills.motion.motions.SameWay",
    "services", "tools", "motion", "clock", "runtime", "tools.learn", "../../etc/passwd", "\x00", "{x.__class__}", "",
)  # fmt: skip
ODD: tuple[Any, ...] = (
    None, True, 0, -1, 2**63, 2**64 - 1, 1e308, -1e-308, [], {}, [[]], [{}], {"": None}, "nan", {"float": "inf"},
    {"float": "nan"}, {"kept": True, "n": 1}, {"ref": 0}, {"ref": 10**9}, {"named": "services"}, {"named": "tools"},
    {"n": 5, "array": ["|O", [1], "00"]}, {"n": 5, "array": ["<f8", [2**40], ""]}, {"n": 5, "array": ["<f8", [0], "0"]},
    {"n": 5, "record": "bracket_ground.interfaces.pose.Pose", "of": {"position_m": {"n": 6, "tuple": [0, 0, 0]}}},
    {"n": 5, "function": ["bracket_cell.skills.motion.separation", "np.testing.runstring", None], "of": {}},
    {"n": 5, "method": [{"named": "services"}, "learn"]}, {"n": 5, "partial": [{"named": "tools.learn"}, [], {}]},
    {"enum": ["btxml.engine.status.Status", "mro"]}, {"enum": ["bracket_ground.interfaces.pose.Pose", "x"]},
)  # fmt: skip


WAYS = ("value", "text", "name", "gone", "twice", "moved", "deep", "kind")
PATH = st.lists(st.integers(0, 999), min_size=1, max_size=14)  # child by child from the whole down
EDITS = st.lists(
    st.tuples(PATH, st.sampled_from(WAYS), st.sampled_from(ODD), st.sampled_from(NAMES + CODE), PATH, st.floats()),
    min_size=1,
    max_size=3,
)


def place(value: Any, path: list[int]) -> tuple[Any, Any]:
    """The list or mapping at the end of a path, and the key in it; the key is None where there is none."""
    holder, key = None, None
    for number in path:
        keys: Any = list(value) if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
        if not keys:
            break
        holder, key = value, keys[number % len(keys)]
        value = holder[key]
    return holder, key


def flipped(sound: Any, edits: list[tuple[Any, ...]]) -> Any:
    """Plain data with one to three places flipped."""
    value = copy.deepcopy(sound)
    for path, way, odd, name, other, number in edits:
        holder, key = place(value, path)
        if holder is None:
            continue
        match way:
            case "value":
                holder[key] = copy.deepcopy(odd)
            case "text":
                holder[key] = name
            case "name" if isinstance(holder, dict):
                holder[name] = holder.pop(key)
            case "gone":
                del holder[key]
            case "twice" if isinstance(holder, list):
                holder[key:key] = copy.deepcopy(holder[max(0, key - 3) : key + 1])
            case "moved":
                source, of = place(value, other)
                holder[key] = copy.deepcopy(source[of]) if source is not None else None
            case "deep":
                for _ in range(3 if number < 0 else 60):
                    holder[key] = [holder[key]]
            case _:
                holder[key] = str(holder[key])[:99] if isinstance(holder[key], int | float) else number
    return value


class Watched(AssertionError):
    """Something ran that a log may not call."""


class Audit:
    """Notes what Python's own audit tells while it is on: code that is loaded, programs, files that are written."""

    NEVER = (
        "subprocess.",
        "os.system",
        "os.exec",
        "os.posix_spawn",
        "os.remove",
        "os.rename",
        "socket.",
        "ctypes.",
        "pickle.",
    )

    def __init__(self) -> None:
        self.on, self.seen = False, list[str]()
        sys.addaudithook(self._heard)

    def _heard(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self.on:
            return
        if event.startswith(self.NEVER) or (event in ("exec", "import") and self._foreign(arguments[0])):
            self.seen.append(f"{event} {str(arguments)[:200]}")
        elif event == "open" and isinstance(arguments[1], str) and set(arguments[1]) & set("wax+"):
            self.seen.append(f"{event} {arguments}")

    def _foreign(self, code: Any) -> bool:
        """Scripts of trees are compiled by the program's own parser, and some of its modules are loaded when needed."""
        name = code if isinstance(code, str) else getattr(code, "co_filename", "")
        return name not in sys.modules and name != "script" and "/hypothesis/" not in name

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Fail where something ran, and where it takes too long."""
        before = signal.signal(signal.SIGALRM, _too_long)
        signal.setitimer(signal.ITIMER_REAL, LIMIT_S)
        self.seen, self.on = [], True
        try:
            yield
        finally:
            self.on = False
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)
        if self.seen:
            raise Watched(self.seen)


def _too_long(*_: object) -> None:
    raise AssertionError(f"a log took more than {LIMIT_S:g} s")


def enormous() -> bytes:
    """A PNG file of a few bytes that says it has 60,000 x 60,000 pixels: OpenCV raises an error of its own."""
    head = struct.pack(">4sIIBBBBB", b"IHDR", 60_000, 60_000, 1, 0, 0, 0, 0)
    parts = (head, b"IDAT" + zlib.compress(bytes(99)), b"IEND")
    chunks = (struct.pack(">I", len(part) - 4) + part + struct.pack(">I", zlib.crc32(part)) for part in parts)
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)
