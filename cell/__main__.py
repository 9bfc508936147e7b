"""Entry point: `cell`, or `python -m cell`."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line."""
    from cell.commands.main import main as command_line

    sys.exit(command_line())


if __name__ == "__main__":
    main()
