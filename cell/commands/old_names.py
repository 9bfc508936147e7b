"""Names that commands and options once had: each says the name that it has now."""

from __future__ import annotations

from collections.abc import Sequence

from cell.errors import InputError

TASKS = ("actions", "hands", "holes", "parts", "grasp", "semantic", "noise")
COMMANDS = {
    "eval": "lab eval",
    "data": "lab data",
    "see": "lab see",
    "looks": "lab looks",
    "sweep": "lab sweep",
    "world": "lab world",
    "schema": "lab schema",
    "hands": "lab hands",
    "hands fetch": "lab hands",
    "train all": "train --all",
    **{f"train {name}": f"lab train {name}` with its own options, or `cell train --only {name}" for name in TASKS},
    **{f"log {name}": f"lab {name}" for name in ("files", "sheet", "snapshots")},
}
_OWN = {"--nodes": "--with", "--also": "--with", "--beside": "--with"}
_LAB_RUN = "`cell lab run {}`"
OPTIONS: dict[str, dict[str, str]] = {
    "run": {
        **_OWN,
        "--tree": "the file alone, as in `cell run trees/mine.xml`",
        "--brackets": "--shift",
        "--pace": "--real-time",
        "--monitor-hooks": "--breakpoints",
        "--monitor-port": "--monitor PORT",
        "--live-port": "--live PORT",
        "--page-port": "--page PORT",
        **{name: _LAB_RUN.format(name) for name in ("--person", "--orders", "--inject", "--world", "--overwrite")},
    },
    **dict.fromkeys(("check", "show", "nodes", "replay"), _OWN),
    "lab eval": dict.fromkeys(("--first-seed", "--recordings", "--runs"), "--seeds FIRST:END"),
    "lab data": dict.fromkeys(("--first-seed", "--recordings"), "--seeds FIRST:END"),
}
OPTIONS["lab run"] = {name: now for name, now in OPTIONS["run"].items() if "`cell lab run" not in now}


def refuse_old(words: Sequence[str]) -> None:
    """Check that a command line has no name of before.

    Raises:
        InputError: it has one; the message says the name of today.
    """
    for length in (2, 1):
        typed = " ".join(words[:length])
        if typed in COMMANDS:
            raise InputError(f"`cell {typed}` is now `cell {COMMANDS[typed]}`")
    for path, names in OPTIONS.items():
        if list(words[: len(path.split())]) != path.split():
            continue
        for word in words:
            name = word.partition("=")[0]
            if name in names:
                raise InputError(f"{name} of `cell {path}` is now {names[name]}")
