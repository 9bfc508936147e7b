"""Closed parts of a log made smaller: many ticks in one compressed chunk instead of each in a chunk of its own.

Run as a program, for a process of its own with the lowest priority: no tick waits for it.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from mcap.stream_reader import StreamReader

from bracket_cell.recording.copying import CopyingWriter

CHUNK_BYTES = 1024 * 1024
PARTIAL = ".packing"  # a file's ending until it is whole
PATIENCE_S = 120.0  # how long the end of a run waits for its parts
LOWEST_PRIORITY = 19


def pack(path: Path) -> None:
    """Rewrite a closed MCAP file with large chunks, compressed by zstd; all that it holds stays, in its order.

    It is replaced at once when the new file is whole on the disk.

    Raises:
        OSError, McapError: it cannot be read or written; it is as it was.
    """
    partial = path.with_name(path.name + PARTIAL)
    try:
        with path.open("rb") as source, partial.open("wb") as target:
            writer = CopyingWriter(target, CHUNK_BYTES)
            for record in StreamReader(source, validate_crcs=True).records:
                writer.take(record)
            writer.finish()
            target.flush()
            os.fsync(target.fileno())
        if path.exists():  # else it was taken away meanwhile, as too old
            partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


class Packer:
    """Packs files one after the other beside the run; what cannot be packed stays as it is."""

    def __init__(self) -> None:
        self._waiting: list[Path] = []
        self._packing: list[Path] = []
        self._process: subprocess.Popen[bytes] | None = None

    def add(self, path: Path) -> None:
        """A file that is whole on the disk."""
        self._waiting.append(path)
        self._go_on()

    def busy(self, path: Path) -> bool:
        """Whether a file is being replaced at the moment or will be."""
        self._go_on()
        return path in self._waiting or path in self._packing

    def close(self) -> None:
        """Wait for what is left, but not for ever; a process that needs longer ends by itself."""
        self._go_on()
        while self._process is not None:
            try:
                self._process.wait(PATIENCE_S)
            except subprocess.TimeoutExpired:
                return
            self._go_on()

    def _go_on(self) -> None:
        """Begin a process for all that waits, once the one before has ended."""
        if self._process is not None and self._process.poll() is None:
            return
        self._process, self._packing, self._waiting = None, self._waiting, []
        if self._packing:
            command = [sys.executable, "-m", __name__, *map(str, self._packing)]
            nowhere = subprocess.DEVNULL
            self._process = subprocess.Popen(
                command, stdin=nowhere, stdout=nowhere, stderr=nowhere, start_new_session=True
            )


def main(paths: list[str]) -> None:
    """Pack the files that are named; one that cannot be packed does not keep the others from it."""
    os.nice(LOWEST_PRIORITY)
    failed = 0
    for path in paths:
        try:
            pack(Path(path))
        except Exception as error:  # a file may be anything
            sys.stderr.write(f"{path}: stays as it is: {error}\n")
            failed += 1
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main(sys.argv[1:])
