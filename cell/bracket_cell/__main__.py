"""Entry point: `cell`, or `python -m bracket_cell`."""

from __future__ import annotations

import gc
import sys

# Nothing that is imported is garbage: with Python's own threshold, looking for it takes a tenth of the start. A run
# begins without a search, and searches more often afterwards, as each search is short then.
gc.set_threshold(300_000)


def main() -> None:
    """Run the command line."""
    from bracket_cell.commands.main import main as command_line

    try:
        status = command_line()
    finally:
        if {"duckdb", "ompl"} & sys.modules.keys():  # whose bindings take what is kept for leaks, and tell each of them
            gc.unfreeze()
        else:
            gc.freeze()  # nor when all of it ends
    sys.exit(status)


if __name__ == "__main__":
    main()
