"""Whoever looks at the page changes nothing: the same seed gives the same ticks."""

from __future__ import annotations

import hashlib
import re
import socket
import threading
import time
from io import StringIO
from pathlib import Path

import pytest
from mcap.reader import make_reader
from rich.console import Console

from bracket_cell.recording.parts import parts_of
from bracket_cell.runs.options import RunOptions
from bracket_cell.runs.run import run
from tests import ROOT

DURATION_S, CLIENTS_N = 2.5, 5
DECIDED = ("/tick", "/observation", "/command", "/display", "/judgement", "/note/belief", "/note/skill", "/bench")


class Client(threading.Thread):
    """Looks at the page as a browser does; a slow one asks for everything and takes nothing."""

    def __init__(self, told: StringIO, slow: bool) -> None:
        super().__init__(daemon=True)
        self._told, self._slow = told, slow
        self.over = threading.Event()
        self.bytes_n = 0

    def run(self) -> None:
        while not (found := re.search(r"http://127\.0\.0\.1:(\d+)", self._told.getvalue())):
            if self.over.wait(0.02):
                return
        port = int(found.group(1))
        with socket.socket() as events:
            if self._slow:
                events.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
            events.connect(("127.0.0.1", port))
            events.sendall(f"GET /events HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
            events.settimeout(0.2)
            while not self.over.is_set():
                try:
                    piece = b"" if self._slow else events.recv(65536)
                except (TimeoutError, ConnectionError):
                    piece = b""
                self.bytes_n += len(piece)
                if not piece:
                    time.sleep(0.01)


def decided(log: Path) -> dict[str, str]:
    """A digest of each topic that the run saw or decided."""
    digests = {topic: hashlib.sha256() for topic in DECIDED}
    with log.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(DECIDED, log_time_order=False):
            digests[channel.topic].update(message.log_time.to_bytes(8) + message.data)
    return {topic: digest.hexdigest() for topic, digest in digests.items()}


def short_run(log: Path, page: bool) -> tuple[dict[str, str], list[Client]]:
    told = StringIO()
    clients = [Client(told, slow=number == 0) for number in range(CLIENTS_N if page else 0)]
    for client in clients:
        client.start()
    options = RunOptions(
        tree=ROOT / "trees" / "shift.xml",
        goal="g1",
        seed=3,
        log=log,
        brackets=1,
        max_duration_s=DURATION_S,
        pixels=False,
        page="0" if page else None,
    )
    run(options, Console(file=told, soft_wrap=True, width=200))
    for client in clients:
        client.over.set()
        client.join(5)
    return decided(parts_of(log)[0]), clients


@pytest.mark.long
def test_five_clients_of_which_one_is_slow_change_no_tick(tmp_path: Path) -> None:
    alone, _ = short_run(tmp_path / "alone.mcap", page=False)
    watched, clients = short_run(tmp_path / "watched.mcap", page=True)
    assert watched == alone
    assert len(set(alone.values())) == len(DECIDED), "there is something on every topic"
    assert all(client.bytes_n > 1000 for client in clients[1:]), "the others saw the run"
