"""A viewer that connects to a run gets what the log gets."""

from __future__ import annotations

import gc
import json
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed

from bracket_cell.recording.recorder import Heading, McapRecorder
from bracket_cell.recording.scene import CellModel
from bracket_cell.settings import LogSettings
from bracket_cell.viewing import door, gate
from bracket_cell.viewing.live_server import LiveServer
from bracket_ground.errors import InputError
from tests.cell.fakes import frame
from tests.cell.recording.test_recorder import OUTCOME, record
from tests.cell.recording.test_scene import cell  # noqa: F401 - a fixture
from tests.cell.viewing.viewer import LiveViewer, live_viewer

STREAMS = ("/camera/overhead", "/tick", "/observation", "/joint_states")
STILL = ("/scene/robot", "/scene/bench", "/tf/bench", "/camera/overhead/calibration")


@pytest.fixture
def recorder(tmp_path: Path, cell: CellModel) -> Iterator[McapRecorder]:  # noqa: F811
    made = McapRecorder(tmp_path / "log.mcap", LogSettings(), Heading(), cell)
    yield made
    made.abandon()


@pytest.fixture
def live(recorder: McapRecorder) -> Iterator[LiveServer]:
    made = LiveServer(recorder.context, recorder.scene, 0)
    yield made
    made.abandon()


def run_until_seen(recorder: McapRecorder, live: LiveServer, viewer: LiveViewer, wanted: set[str]) -> dict[str, bytes]:
    """Tick until every wanted topic has brought a message; returns the first of each."""
    found: dict[str, bytes] = {}
    for number in range(500):
        recorder.frame(frame(number, number * 0.04))
        recorder.tick(record(number))
        live.tick(record(number))
        while (message := viewer.message()) is not None:
            topic, time_ns, data = message
            assert time_ns <= number * 40_000_000
            found.setdefault(topic, data)
        if found.keys() >= wanted:
            break
    return found


def test_a_viewer_receives_images_ticks_and_joint_states(recorder: McapRecorder, live: LiveServer) -> None:
    recorder.frame(frame(0, 0.0))
    with live_viewer(live.port) as viewer:
        viewer.learn(*STREAMS)
        assert viewer.channels["/camera/overhead"]["schemaName"] == "foxglove.CompressedImage"
        viewer.subscribe(*STREAMS)
        found = run_until_seen(recorder, live, viewer, set(STREAMS))
    assert b"\xff\xd8" in found["/camera/overhead"]
    assert json.loads(found["/tick"])["changes"][0]["path"] == "Assemble/park"
    assert json.loads(found["/observation"])["arm"]["positions_rad"] == list(record().observation.arm.positions_rad)
    assert b"shoulder_pan" in found["/joint_states"]


def test_a_viewer_that_comes_late_sees_what_stands_still(recorder: McapRecorder, live: LiveServer) -> None:
    for number in range(3):
        recorder.frame(frame(number, number * 0.04))
        recorder.tick(record(number))
        live.tick(record(number))
    with live_viewer(live.port) as viewer:
        viewer.learn(*STILL)
        viewer.subscribe(*STILL)
        assert run_until_seen(recorder, live, viewer, set(STILL)).keys() == set(STILL)


def test_it_listens_on_this_machine_only(live: LiveServer) -> None:
    listening = [line.split()[1] for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    listening += [line.split()[1] for line in Path("/proc/net/tcp6").read_text().splitlines()[1:]]
    hosts = {address.split(":")[0] for address in listening if int(address.split(":")[1], 16) == live.port}
    assert hosts == {"0100007F"}


def test_a_taken_port_is_refused_by_its_number(recorder: McapRecorder) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=rf"port {port} cannot be used: .*--open live=PORT"):
            LiveServer(recorder.context, recorder.scene, port)


def test_the_end_of_a_run_ends_the_connection(live: LiveServer) -> None:
    with live_viewer(live.port) as viewer:
        viewer.learn("/tick")
        live.close(OUTCOME)
        with pytest.raises(ConnectionClosed):
            viewer.message(10.0)
    live.abandon()


def test_the_end_of_a_run_with_a_viewer_says_nothing(live: LiveServer, capfd: pytest.CaptureFixture[str]) -> None:
    with live_viewer(live.port) as viewer, socket.create_connection(("127.0.0.1", live.port), 5):
        viewer.learn("/tick")
        live.close(OUTCOME)
    gc.collect()
    assert capfd.readouterr().err == ""


UPGRADE = (
    "GET / HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n{origin}"
    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
    "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
)


def status(port: int, request: str) -> bytes:
    """The number of the answer, empty where the caller is hung up on."""
    with socket.create_connection(("127.0.0.1", port), 5) as asking:
        try:
            asking.sendall(request.encode())
            return asking.recv(64)[9:12]
        except ConnectionError:
            return b""


@pytest.mark.parametrize(
    ("host", "origin", "answer"),
    [
        ("127.0.0.1:{port}", None, b"101"),
        ("localhost:{port}", "https://app.foxglove.dev", b"101"),
        ("localhost:{port}", "http://localhost:8080", b"101"),
        ("localhost:{port}", "https://127.0.0.1", b"101"),
        ("localhost:{port}", "file://", b"403"),
        ("127.0.0.1:{port}", "chrome-extension://abcdefgh", b"403"),
        ("127.0.0.1:{port}", "app://localhost", b"403"),
        ("127.0.0.1:{port}", "http://localhost@evil.example", b"403"),
        ("127.0.0.1:{port}", "http://[", b"403"),
        ("127.0.0.1:{port}", "http://evil.example", b"403"),
        ("127.0.0.1:{port}", "https://app.foxglove.dev.evil.example", b"403"),
        ("127.0.0.1:{port}", "http://localhost.evil.example", b"403"),
        ("127.0.0.1:{port}", "null", b"403"),
        ("127.0.0.1:{port}", "", b"403"),
        ("rebound.example:80", None, b"403"),
        ("rebound.example:{port}", "http://rebound.example:{port}", b"403"),
    ],
)
def test_pages_of_other_sites_stay_outside(live: LiveServer, host: str, origin: str | None, answer: bytes) -> None:
    line = "" if origin is None else f"Origin: {origin.format(port=live.port)}\r\n"
    assert status(live.port, UPGRADE.format(host=host.format(port=live.port), origin=line)) == answer


def test_callers_that_say_nothing_or_too_much_are_hung_up_on(live: LiveServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(door, "GREETING_S", 0.2)
    with ExitStack() as stack:
        callers = range(gate.PLACES_N + 40)
        idle = [stack.enter_context(socket.create_connection(("127.0.0.1", live.port), 5)) for _ in callers]
        assert {one.recv(1) for one in idle} == {b""}
    assert status(live.port, "GET / HTTP/1.1\r\nX: " + "x" * 10 * gate.HEAD_BYTES) == b""
    assert status(live.port, UPGRADE.format(host=f"localhost:{live.port}", origin="")) == b"101"


def test_a_caller_that_is_no_viewer_is_not_told_to_the_operator(
    live: LiveServer, caplog: pytest.LogCaptureFixture
) -> None:
    port = live.port
    for _ in range(5):
        with socket.create_connection(("127.0.0.1", port), 5.0) as caller:
            caller.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n\r\n" % port)
            caller.settimeout(5.0)
            while caller.recv(4096):
                pass
    assert [record.getMessage() for record in caplog.records] == []
