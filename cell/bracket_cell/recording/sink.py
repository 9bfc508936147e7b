"""A log file behind a bounded buffer: the tick hands over bytes, a thread writes them, and no disk stops the cell."""

from __future__ import annotations

import os
import threading
from collections import deque
from pathlib import Path

RETRY_S = 0.5  # of wall time, while the disk refuses
CLOSE_S = 5.0  # how long the end of a run waits for a disk that takes what is left
SEEK_FROM_HERE, SEEK_FROM_END = 1, 2


class LogSink:
    """The file that the MCAP writer writes to; only the writer's thread ever touches the disk.

    What was handed over is written at its place by `pwrite`, again and again where the disk refuses, so that a disk
    that takes bytes again completes the file. Whoever fills the sink asks `waiting_bytes` first and leaves out whole
    messages where it is too much: bytes that were taken are never dropped.

    Attributes:
        error: why the disk refuses at the moment, or refused until the end; empty where all is well.
    """

    def __init__(self, path: Path) -> None:
        """Create the file.

        Raises:
            OSError: it cannot be created, or is there already, as of another run that began at the same time.
        """
        self.path = path
        self.error = ""
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self._pending = bytearray()  # since the last hand-over; the writer may still go back in it
        self._base = self._at = self._written = 0
        self._stalled = self._closing = False
        self._blocks: deque[bytes] = deque()
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="log writer", daemon=True)
        self._thread.start()

    def write(self, data: bytes | bytearray) -> int:
        begin = self._at - self._base
        self._pending[begin : begin + len(data)] = data
        self._at += len(data)
        return len(data)

    def seek(self, offset: int, whence: int = 0) -> int:
        """Go within what was not handed over yet."""
        origin = {SEEK_FROM_HERE: self._at, SEEK_FROM_END: self._base + len(self._pending)}.get(whence, 0)
        self._at = origin + offset
        return self._at

    def flush(self) -> None:
        """Nothing: `hand_over` says when bytes are whole."""

    def hand_over(self) -> None:
        """Give what was written to the thread; `settle` says when it is in the file."""
        block = bytes(self._pending)
        if not block:
            return
        self._base += len(block)
        self._at = self._base
        self._pending.clear()
        with self._changed:
            self._blocks.append(block)
            self._changed.notify_all()

    def settle(self, patience_s: float) -> None:
        """Wait until what was handed over is in the file, but not for ever.

        A process that is killed afterwards loses none of it. A disk that has kept a caller waiting once is not waited
        for again until it has caught up.
        """
        if not self._blocks or self._stalled or self.error:
            return
        with self._changed:
            self._stalled = not self._changed.wait_for(lambda: not self._blocks or self.error, patience_s)

    @property
    def waiting_bytes(self) -> int:
        """Handed over, not on the disk yet."""
        return self._base - self._written

    @property
    def size_bytes(self) -> int:
        """Handed over since the file was opened."""
        return self._base

    @property
    def ended(self) -> bool:
        """Whether the thread has nothing to do any more, as the file was closed or retired."""
        return not self._thread.is_alive()

    def retire(self) -> None:
        """Hand over the rest without waiting; the thread ends once the disk has taken it or refuses."""
        self.hand_over()
        with self._changed:
            self._closing = True
            self._changed.notify_all()

    def close(self, patience_s: float = CLOSE_S) -> None:
        """Hand over the rest, wait for the disk, and cut off what a refusing disk took of a block."""
        self.hand_over()
        with self._changed:
            self._changed.wait_for(lambda: not self._blocks or self.error, patience_s)
        self.retire()
        self._thread.join(patience_s)
        if self.waiting_bytes and not self.error:
            self.error = f"{self.waiting_bytes} bytes were not taken within {patience_s:g} s"

    def _run(self) -> None:
        try:
            self._write_blocks()
        finally:
            os.close(self._descriptor)

    def _write_blocks(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._blocks or self._closing)
                if not self._blocks:
                    self.error = self.error or self._misplaced()
                    return
                block = self._blocks[0]
            try:
                self._put(block)
                if misplaced := self._misplaced():
                    raise OSError(misplaced)
            except OSError as error:
                if not self._wait_after(error):
                    return
            else:
                self._done(len(block))

    def _put(self, block: bytes) -> None:
        done = 0
        while done < len(block):
            done += os.pwrite(self._descriptor, memoryview(block)[done:], self._written + done)

    def _misplaced(self) -> str:
        """Why the file that is written is not the one that its path names; empty where it is."""
        try:
            found = self.path.stat()
        except OSError as error:
            return f"the file is gone: {error.strerror}"
        return "" if os.path.samestat(found, os.fstat(self._descriptor)) else "another file stands in its place"

    def _done(self, count: int) -> None:
        with self._changed:
            self._blocks.popleft()
            self._written += count
            self.error = ""
            if not self._blocks:
                self._stalled = False
            self._changed.notify_all()

    def _wait_after(self, error: OSError) -> bool:
        """Pause after a refusal; false where the run is over and no further try makes sense."""
        with self._changed:
            last = self._closing
            self.error = error.strerror or str(error)
            self._changed.notify_all()
            if not last:
                self._changed.wait_for(lambda: self._closing, RETRY_S)
        if last:
            os.ftruncate(self._descriptor, self._written)
        return not last
