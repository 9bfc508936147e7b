"""Entry point: `cell`, or `python -m bracket_cell`."""

from __future__ import annotations

import gc
import os
import signal
import sys
from functools import partial
from pathlib import Path

# Nothing that is imported is garbage: with Python's own threshold, looking for it takes a tenth of the start. A run
# begins without a search, and searches more often afterwards, as each search is short then.
gc.set_threshold(300_000)


def main() -> None:
    """Run the command line; Ctrl-C is an exception to the command alone."""
    heard = signal.getsignal(signal.SIGINT) is not signal.SIG_IGN
    hear = partial(signal.signal, signal.SIGINT) if heard else id
    hear(_leave)
    try:
        Path.cwd()
    except FileNotFoundError:
        sys.stderr.write("cell: the working folder is gone; change to one that is there\n")
        sys.exit(2)
    try:
        from bracket_cell.commands.main import main as command_line

        status = command_line(begins=lambda: hear(signal.default_int_handler))
    finally:
        hear(signal.SIG_DFL)
        if {"duckdb", "ompl"} & sys.modules.keys():  # whose bindings take what is kept for leaks, and tell each of them
            gc.unfreeze()
        else:
            gc.freeze()  # nor when all of it ends
    sys.exit(status)


def _leave(*_: object) -> None:
    """Nothing has begun. An exception may get lost in a module that is imported, or change what it says."""
    if "CELL_BESIDE" not in os.environ:
        os.write(2, b"cell: interrupted\n")
    os._exit(1)


if __name__ == "__main__":
    main()
