"""A run opens no socket that its command line does not name, and leaves nothing in the home of who starts it."""

from __future__ import annotations

import os
import re
import signal
import sys
import time
from collections.abc import Set
from pathlib import Path

import pytest

from tests import ROOT
from tests.cell.viewing.test_monitor import free_port
from tests.processes import started

TABLES = ("tcp", "tcp6", "udp", "udp6", "udplite", "udplite6", "raw", "raw6", "icmp", "icmp6", "packet")
SOCKET = re.compile(r"socket:\[(\d+)\]")
LOOPBACK = "0100007F"  # as /proc/net/tcp writes 127.0.0.1
PATIENCE_S = 240.0  # until a run of a busy machine has loaded its networks
IMPORTS = (
    "bracket_cell",
    "bracket_cell.learned.inference.onnx_model",
    "bracket_cell.learned.inference.policy",
    "bracket_lab.learned.training.torch_model",
)


def network_sockets(session: int) -> set[str]:
    """Local addresses of all sockets beyond this machine's files that processes of a session hold (Linux)."""
    found: set[str] = set()
    for process in Path("/proc").iterdir():
        try:
            if not process.name.isdigit() or os.getsid(int(process.name)) != session:
                continue
            handles = [_target(handle) for handle in (process / "fd").iterdir()]
            tables = [(process / "net" / name).read_text() for name in TABLES if (process / "net" / name).exists()]
        except OSError:  # it has ended meanwhile
            continue
        held = {match[1] for handle in handles if (match := SOCKET.fullmatch(handle))}
        rows = [line.split() for table in tables for line in table.splitlines()[1:]]
        found |= {row[1] for row in rows if held.intersection(row[8:])}
    return found


def _target(handle: Path) -> str:
    try:
        return str(handle.readlink())
    except OSError:  # it is closed meanwhile
        return ""


def files_of(folder: Path) -> list[str]:
    return [str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()]


def watched_run(folder: Path, *options: str) -> tuple[Set[str], list[str]]:
    """Sockets of the processes of a run until the robot has begun to work, and what is left in HOME and TMPDIR."""
    home, scratch, said = folder / "home", folder / "scratch", folder / "said.txt"
    home.mkdir()
    scratch.mkdir()
    shell = f'exec "$0" -m bracket_cell run --goal g1 --seed 7 --log "{folder}/log.mcap" "$@" > "{said}" 2>&1'
    environment = {"HOME": str(home), "TMPDIR": str(scratch), "XDG_CACHE_HOME": "", "PYTHONPATH": str(ROOT)}
    with started(["sh", "-c", shell, sys.executable, *options], folder, environment) as process:
        seen, until_s = set[str](), time.monotonic() + PATIENCE_S
        while not (said.exists() and re.search(r"s +robot", said.read_text())):
            assert process.poll() is None, said.read_text()
            assert time.monotonic() < until_s, said.read_text()
            seen |= network_sockets(process.pid)
        process.send_signal(signal.SIGINT)
        while process.poll() is None:
            seen |= network_sockets(process.pid)
            assert time.monotonic() < until_s, said.read_text()
    return seen, files_of(home) + files_of(scratch)


@pytest.mark.long
def test_a_run_opens_no_socket_and_leaves_no_file_outside_its_folder(tmp_path: Path) -> None:
    assert watched_run(tmp_path) == (set(), [])


@pytest.mark.long
def test_a_run_with_doors_opens_those_alone(tmp_path: Path) -> None:
    ports = [free_port() for _ in range(2)]
    seen, left = watched_run(tmp_path, "--page", str(ports[0]), "--open", f"monitor={ports[1]}")
    named = {f"{LOOPBACK}:{port:04X}" for port in (*ports, ports[1] + 1)}
    assert (seen, left) == (named, [])


def test_the_watch_sees_a_grandchilds_socket() -> None:
    opens = (
        "import socket, time; s = socket.socket(type=socket.SOCK_DGRAM); s.connect(('127.0.0.1', 9)); time.sleep(60)"
    )
    parent = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {opens!r}])"
    with started([sys.executable, "-c", parent]) as process:
        until_s = time.monotonic() + PATIENCE_S
        while not network_sockets(process.pid):
            assert time.monotonic() < until_s


@pytest.mark.long
@pytest.mark.parametrize("module", IMPORTS)
def test_whatever_is_imported_first_onnx_runtime_keeps_quiet(tmp_path: Path, module: str) -> None:
    code = f"import {module}, onnxruntime, time; time.sleep(0.5)"
    environment = {
        "HOME": str(tmp_path),
        "TMPDIR": str(tmp_path),
        "ORT_DISABLE_TELEMETRY": "0",
    }
    with started([sys.executable, "-c", code], environment=environment) as process:
        seen = set[str]()
        while process.poll() is None:
            seen |= network_sockets(process.pid)
        assert process.returncode == 0, process.stderr and process.stderr.read()
    assert (seen, files_of(tmp_path)) == (set(), [])
