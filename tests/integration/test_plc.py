"""A PLC's program runs a shift of a served cell by OPC UA alone: it orders, begins, waits for brackets, and ends it."""

from __future__ import annotations

import asyncio
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bracket_cell.configuration import DEFAULT_CONFIGURATION
from bracket_cell.plant.packml import State

sync = pytest.importorskip("asyncua.sync", reason="the extra opcua is not installed")
from asyncua import ua  # noqa: E402 - as above
from asyncua.crypto.cert_gen import setup_self_signed_certificate  # noqa: E402
from cryptography.x509.oid import ExtendedKeyUsageOID  # noqa: E402

from tests.cell.plant.test_opcua import Heard, call, free_port  # noqa: E402

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]

CELL = """\
plant:
  opcua:
    at: 127.0.0.1:{port}
    trusted: ../trusted
"""
SOON_S, BRACKET_S = 120.0, 600.0
LOST_S = 20.0  # for so long the PLC's line is cut


def until(true: Callable[[], bool], seconds: float = SOON_S) -> None:
    end_s = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end_s
        time.sleep(0.2)


def plc(port: int, folder: Path) -> Any:
    made = sync.Client(f"opc.tcp://127.0.0.1:{port}/cell/", timeout=SOON_S)
    made.application_uri = "urn:plc"
    made.set_security_string(f"Basic256Sha256,SignAndEncrypt,{folder}/trusted/plc.der,{folder}/plc.pem")
    return made


def state(at: Any) -> int:
    return int(at.get_node("ns=2;s=Status.StateCurrent").read_value())


def test_a_shift_by_opc_ua(tmp_path: Path) -> None:
    port, page = free_port(), free_port()
    (tmp_path / "trusted").mkdir()
    names, usage = {"commonName": "plc"}, [ExtendedKeyUsageOID.CLIENT_AUTH]
    made = setup_self_signed_certificate(
        tmp_path / "plc.pem", tmp_path / "trusted" / "plc.der", "urn:plc", "localhost", usage, names
    )
    asyncio.run(made)
    shutil.copytree(DEFAULT_CONFIGURATION.parent, tmp_path / "config")
    with (tmp_path / "config" / "cell.yaml").open("a") as file:
        file.write(CELL.format(port=port))
    words = [
        "serve",
        "--config",
        "config/cell.yaml",
        "--page",
        str(page),
        "--shift",
        "0",
        "--look",
        "none",
        "--goal",
        "g1",
    ]
    with (tmp_path / "out").open("w") as out:
        command = [sys.executable, "-m", "bracket_cell", *words]
        server = subprocess.Popen(command, cwd=tmp_path, stdout=out, stderr=out, env={**os.environ})
    try:
        told = tmp_path / "out"
        until(lambda: "OPC UA" in told.read_text() or server.poll() is not None)
        assert server.poll() is None, told.read_text()
        heard = Heard()
        with plc(port, tmp_path) as at:
            assert state(at) == State.IDLE
            assert call(at, "Hold") == [False, "no run goes on"]
            assert call(at, "Order", "B1", "g1", ua.Variant(2, ua.VariantType.UInt32), "") == [True, ""]
            assert call(at, "Start", False) == [True, ""]
            assert call(at, "Start", False) == [False, "a run goes on already"]
            until(lambda: state(at) == State.EXECUTE)
            assert call(at, "Hold") == [True, ""]
            until(lambda: state(at) == State.HELD)
            assert call(at, "Unhold") == [True, ""]
            until(lambda: state(at) == State.EXECUTE)
        time.sleep(LOST_S)  # the run does not need its PLC
        with plc(port, tmp_path) as at:
            assert state(at) in (State.EXECUTE, State.SUSPENDED)
            subscription = at.create_subscription(200, heard)
            subscription.subscribe_events(at.nodes.server, at.nodes.base_event_type.get_child("2:BracketEventType"))
            done = at.get_node("ns=2;s=cell_brackets_total.true")
            until(lambda: done.read_value() + heard.events.qsize() >= 1, BRACKET_S)
            assert call(at, "Complete") == [True, ""]
            until(lambda: state(at) == State.COMPLETE, BRACKET_S)
            finished = done.read_value()
            subscription.delete()
        ended = list(heard.events.queue)
        assert finished >= 1
        assert {(event.Variant, event.OrderId, event.Finished) for event in ended} <= {("g1", "B1", True)}
    finally:
        server.terminate()
        server.wait(SOON_S)
