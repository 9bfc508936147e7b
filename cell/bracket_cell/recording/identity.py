"""Who made a log: when, where, with which code and versions. No secrets: no user, environment or arguments."""

from __future__ import annotations

import hashlib
import platform
import socket
import subprocess
import uuid
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

from bracket_cell.packages import DISTRIBUTION, INSTALLED

INPUTS = ("/observation", "/bench", "/parts")
NAME = "inputs_sha256"  # of the digest in the metadata `outcome`
# Everything that a decision or a motion hangs on.
PACKAGES = (
    "cell", "mujoco", "pin", "coal", "eigenpy", "ruckig", "py-trees", "onnxruntime",
    "opencv-python-headless", "numpy", "scipy", "pydantic", "cantools", "python-can",
)  # fmt: skip
GIT_TIMEOUT_S = 5.0
UNKNOWN = "unknown"


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


def identity() -> dict[str, str]:
    """Facts about this run as text by name: run id, UTC start, host, system, code and versions."""
    return {
        "run_id": uuid.uuid4().hex,
        "started_utc": datetime.now(UTC).isoformat(timespec="milliseconds"),
        "host": socket.gethostname(),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        **code_version(),
        **versions(),
    }


def versions() -> dict[str, str]:
    """`version.<package>` of Python and of all packages in PACKAGES."""
    return {
        "version.python": platform.python_version(),
        **{f"version.{name}": _version(DISTRIBUTION if name == "cell" else name) for name in PACKAGES},
    }


def code_version() -> dict[str, str]:
    """The commit of the checkout that runs, and whether its files were changed; unknown where it is no checkout."""
    root = INSTALLED.resolve()
    commit = _git(root, "rev-parse", "HEAD")
    if commit is None or not (root / ".git").exists():
        return {"commit": UNKNOWN, "clean": UNKNOWN}
    changed = _git(root, "status", "--porcelain", "--untracked-files=no")
    return {"commit": commit, "clean": UNKNOWN if changed is None else str(not changed).lower()}


def what_changed(recorded: Mapping[str, str]) -> list[str]:
    """What of the program is another one than a log says, a line each: commit, whether files were changed, versions."""
    now = {**code_version(), **versions()}
    return [
        f"{name.removeprefix('version.')} was {was}, is {now[name]}"
        for name, was in recorded.items()
        if name in now and now[name] != was
    ]


def _git(folder: Path, *arguments: str) -> str | None:
    try:
        command = ["git", "-C", str(folder), *arguments]
        done = subprocess.run(command, capture_output=True, text=True, timeout=GIT_TIMEOUT_S, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed as a package"
