"""Who may say something to the cell by its page, and who may not; what a slow client costs."""

from __future__ import annotations

import http.client
import json
import socket
import ssl
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import cv2
import numpy as np
import pytest

from bracket_cell.settings import PageSettings
from bracket_cell.viewing import door
from bracket_cell.viewing.gate import Address
from bracket_cell.viewing.page import server
from bracket_cell.viewing.page.page import OperatorPage
from bracket_ground.errors import InputError
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.operator import OperatorOrder
from bracket_ground.interfaces.pose import Pose
from tests.cell.viewing.page.rig import HELP, MODEL, PageRig, certified

KEY = "dGhlIHNhbXBsZSBub25jZQ=="  # that of RFC 6455
PAUSE = {"kind": "pause", "value": "now"}


@pytest.fixture
def rig() -> Iterator[PageRig]:
    made = PageRig()
    yield made
    made.page.abandon()


def test_an_order_with_the_token_reaches_the_cell(rig: PageRig) -> None:
    assert rig.order(PAUSE) == (204, "")
    assert rig.said == [OperatorOrder("pause", "now")]
    assert rig.channel.take(1.0).pause == "now"


@pytest.mark.long
@pytest.mark.parametrize(
    ("body", "headers", "status"),
    [
        (PAUSE, {"X_Cell_Token": ""}, 401),
        (PAUSE, {"X_Cell_Token": "x" * 32}, 401),
        (PAUSE, {"X_Cell_Token": "ü"}, 401),
        (PAUSE, {"Host": "evil.example"}, 403),
        (PAUSE, {"Host": "127.0.0.1"}, 403),
        (PAUSE, {"Origin": "http://evil.example"}, 403),
        (PAUSE, {"Origin": "null"}, 403),
        (PAUSE, {"Content_Type": "text/plain"}, 415),
        (b"{" + b" " * 5000 + b"}", {}, 413),
        (b"not JSON", {}, 400),
        (b"[" * 4000, {}, 400),
        (b"\xff\xfe", {}, 400),
        ([], {}, 400),
        ({"kind": 3}, {}, 400),
        ({"kind": "pause", "value": ["now"]}, {}, 400),
        ({"kind": "answer", "value": "done", "question": True}, {}, 400),
        ({"kind": "pause", "value": "now", "more": 1}, {}, 400),
        (b'{"kind": "place", "value": "\\ud800"}', {}, 400),
        (b'{"kind": "goal", "value": "g0", "question": 1' + b"0" * 400 + b"}", {}, 400),
        (b'{"kind": "goal", "value": "g0", "question": 1' + b"0" * 30 + b"}", {}, 400),
        ({"kind": "dance"}, {}, 409),
        ({"kind": "answer", "value": "done", "question": 9}, {}, 409),
    ],
)
def test_everything_else_is_refused_and_changes_nothing(
    rig: PageRig, body: object, headers: dict[str, str], status: int
) -> None:
    assert rig.order(body, **headers)[0] == status
    assert rig.said == []


@pytest.mark.parametrize("headers", [{}, {"X-Cell-Token": ""}, {"Authorization": "Bearer {token}"}])
def test_an_order_needs_its_token_in_its_own_header(rig: PageRig, headers: dict[str, str]) -> None:
    """A form or an image of another page can send what stands in an address, but no header of its own."""
    sent = {name: value.format(token=rig.token) for name, value in headers.items()}
    sent["Content-Type"] = "application/json"
    assert rig.request("POST", f"/order?token={rig.token}", json.dumps(PAUSE).encode(), sent)[0] == 401
    assert rig.said == []


@pytest.mark.parametrize("method", ["GET", "PUT", "DELETE", "OPTIONS"])
def test_orders_are_posted(rig: PageRig, method: str) -> None:
    assert rig.request(method, "/order", None, {"X-Cell-Token": rig.token})[0] == 405


@pytest.mark.parametrize(
    "path", ["/static/../server.py", "/static/%2e%2e/server.py", "/etc/passwd", "/static/nothing.js"]
)
def test_no_other_file_is_served(rig: PageRig, path: str) -> None:
    assert rig.request("GET", path)[0] == 404


def test_looking_needs_this_machine_by_name(rig: PageRig) -> None:
    assert rig.request("GET", "/")[0] == 200
    assert rig.request("GET", "/", headers={"Host": "cell.example"})[0] == 403
    assert rig.request("GET", "/events", headers={"Origin": "http://cell.example"})[0] == 403


def test_a_web_socket_is_answered_as_any_request(rig: PageRig) -> None:
    upgrade = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": KEY}
    assert rig.request("GET", "/", headers=upgrade)[0] == 200
    assert rig.request("GET", "/nothing", headers=upgrade)[0] == 404
    assert rig.request("GET", "/", headers={**upgrade, "Host": "cell.example"})[0] == 403


def test_the_page_may_load_nothing_from_elsewhere_nor_be_framed(rig: PageRig) -> None:
    text = rig.request("GET", "/")[1]
    assert "http" not in text.replace("<!doctype html>", "")
    assert rig.token not in text


def test_the_numbers_and_the_words_are_served(rig: PageRig) -> None:
    rig.tick(("bracket", {"number": 1, "edge": "begin"}))
    rig.tick(("bracket", {"number": 1, "edge": "end", "finished": True, "goal": "g0"}))
    status, text = rig.request("GET", "/metrics")
    assert status == 200
    assert 'cell_brackets_total{finished="true"} 1\n' in text
    assert "# TYPE cell_cycle_seconds summary\n" in text
    assert json.loads(rig.request("GET", "/words/de.json")[1])["texts"]["paused"] == "angehalten"
    assert json.loads(rig.request("GET", "/words/usual.json")[1])["language"] == "en"
    assert rig.request("GET", "/words/../de.json")[0] == 404
    assert rig.request("GET", "/words/xx.json")[0] == 404
    assert len(json.loads(rig.request("GET", "/scene.json")[1])["joints"]) == 6


BEYOND = Address(0, "127.0.0.2")


def test_beyond_this_machine_looking_needs_a_token_and_operating_another_one() -> None:
    rig = PageRig(where=BEYOND)
    try:
        operate, look = (rig.page.address_of(role).partition("#")[2] for role in ("operate", "look"))
        assert rig.request("GET", "/")[0] == 200, "the page itself holds nothing"
        for path in ("/metrics", "/scene.json", "/camera.jpg"):
            assert rig.request("GET", path)[0] == 401
            assert rig.request("GET", f"{path}?token={operate}")[0] == 401
            assert rig.request("GET", path, headers={"Authorization": f"Bearer {operate}"})[0] == 401
            for token in (operate, look):
                assert rig.request("GET", path, headers={"X-Cell-Token": token})[0] in (200, 204)
        assert events(rig) == 401
        assert events(rig, look) == events(rig, operate) == 200
        assert rig.order(PAUSE, X_Cell_Token=look)[0] == 401
        assert rig.order(PAUSE, X_Cell_Token=operate)[0] == 204
        assert rig.request("GET", "/", headers={"Host": "127.0.0.1"})[0] == 403
        assert rig.page.in_clear
    finally:
        rig.page.abandon()


@pytest.mark.parametrize(
    "text", ["0.0.0.0:8780", ":8780", "[::]:8780", "soon", "cell:", "70000", "a..b:80", f"{'x' * 64}:80", "\u2028:80"]
)
def test_a_host_must_be_named(text: str) -> None:
    with pytest.raises(InputError, match=r"--page .*: (name the host|must be PORT or HOST:PORT)"):
        Address.parse(text, "--page")


def test_a_certificate_that_is_none_is_told(tmp_path: Path) -> None:
    (tmp_path / "none.pem").write_text("nothing", encoding="utf-8")
    settings = PageSettings(certificate=tmp_path / "none.pem", key=tmp_path / "none.pem")
    with pytest.raises(InputError, match=r"page\.certificate .*none\.pem: no certificate with its key, in PEM"):
        PageRig(settings)


def test_with_a_certificate_orders_go_by_tls_and_half_greetings_are_hung_up_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(door, "GREETING_S", 0.5)
    settings, _ = certified(tmp_path, "127.0.0.1")
    rig = PageRig(settings)
    trusts = ssl.create_default_context(cafile=str(settings.certificate))
    with ExitStack() as stack:
        stack.callback(rig.page.abandon)
        idle = [
            stack.enter_context(socket.create_connection(("127.0.0.1", rig.page.port), 5))
            for _ in range(2 * door.PLACES_N)
        ]
        connection = http.client.HTTPSConnection("127.0.0.1", rig.page.port, timeout=10, context=trusts)
        stack.callback(connection.close)
        headers = {"X-Cell-Token": rig.token, "Content-Type": "application/json"}
        connection.request("POST", "/order", json.dumps(PAUSE), headers)
        assert connection.getresponse().status == 204
        for one in idle:
            with suppress(ConnectionError):
                assert one.recv(1) == b""
    assert capfd.readouterr().err == ""


def events(rig: PageRig, token: str = "") -> int:
    """The number of the answer to who asks for events with this token in the address."""
    with stream(rig, token=token) as client:
        return int(client.recv(64)[9:12])


def stream(rig: PageRig, receive_bytes: int | None = None, token: str = "") -> socket.socket:
    """A client that has asked for the events."""
    made = socket.socket()
    if receive_bytes is not None:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_bytes)
    made.settimeout(10)
    host = rig.page.address.partition("//")[2].partition(":")[0]
    made.connect((host, rig.page.port))
    made.sendall(f"GET /events?token={token} HTTP/1.1\r\nHost: {host}:{rig.page.port}\r\n\r\n".encode())
    return made


def read_until(client: socket.socket, mark: bytes) -> bytes:
    read = b""
    while mark not in read:
        piece = client.recv(65536)
        assert piece, read[-200:]
        read += piece
    return read


def test_a_client_is_told_what_stands_still_and_every_newest_state(rig: PageRig) -> None:
    rig.show(questions=(HELP,))
    rig.tick()
    with stream(rig) as client:
        read = read_until(client, b'"tick":0')
        assert b"event: still" in read
        assert HELP.reason.encode() in read + read_until(client, b"\n\n") if b"\n\n" not in read[-4:] else True
        time.sleep(0.12)
        rig.tick()
        later = read_until(client, b'"tick":1')
        assert b'"questions"' not in later, "what did not change is not sent again"


def test_slow_clients_are_dropped_and_ticks_go_on(rig: PageRig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "SLOW_S", 0.3)
    monkeypatch.setattr("bracket_cell.viewing.page.page.EVERY_S", 0.0)
    rig.tick()
    clients = [stream(rig, 2048) for _ in range(5)]
    until_s = time.monotonic() + 5
    while not rig.page._server.watched and time.monotonic() < until_s:
        time.sleep(0.01)
    worst_s = 0.0
    while rig.page._server.watched and time.monotonic() < until_s + 10:
        rig.show(message=f"{time.monotonic()}" + "x" * 200_000)  # so that buffers fill
        began_s = time.thread_time()
        rig.tick()
        worst_s = max(worst_s, time.thread_time() - began_s)
        time.sleep(0.02)
    assert not rig.page._server.watched
    assert worst_s < 0.04
    for client in clients:
        client.close()


def test_a_port_that_is_taken_is_told(rig: PageRig) -> None:
    taken = rig.page.port
    with pytest.raises(InputError, match="--page PORT"):
        OperatorPage(MODEL, {}, rig.tree, rig.channel.put, Address(taken), PageSettings(), rig.keeper)


def test_states_are_small(rig: PageRig) -> None:
    for number in range(300):
        rig.page.message(float(number), "info", "something was said that is not very long")
        rig.tick(("belief", {"edge": ["o1", "p1"], "source": "action"}))
    assert sum(map(len, rig.page._server._state.values())) < 20_000
    assert json.loads(rig.page._server._state["bracket"])["p1"]["status"] == "placed"


def test_the_picture_is_the_one_in_which_the_hand_was_found(rig: PageRig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Detectors answer some frames later: the box must not lie on a newer image."""
    monkeypatch.setattr("bracket_cell.viewing.page.page.EVERY_S", 0.0)
    monkeypatch.setattr(server.PageServer, "watched", True)
    for sequence in range(6):
        image = np.full((48, 64, 3), 20 * sequence, np.uint8)
        rig.page.frame(Frame("overhead", sequence, 0.066 * sequence, image, Pose((0.0, 0.0, 1.0))))
        if sequence >= 3:
            rig.look(sequence - 3)
    assert json.loads(rig.page._server._state["hand"])["sequence"] == 2
    assert brightness(rig, "/camera.jpg") == pytest.approx(40, abs=3)
    assert brightness(rig, "/camera.jpg?sequence=1") == pytest.approx(20, abs=3)
    assert brightness(rig, "/camera.jpg?sequence=999") == pytest.approx(40, abs=3), "unknown: the newest"


def brightness(rig: PageRig, path: str) -> float:
    """Mean of the picture that the server sends."""
    connection = http.client.HTTPConnection("127.0.0.1", rig.page.port, timeout=10)
    try:
        connection.request("GET", path)
        image = cv2.imdecode(np.frombuffer(connection.getresponse().read(), np.uint8), 1)
        assert image is not None
        return float(image.mean())
    finally:
        connection.close()


@pytest.mark.parametrize(
    "begun", ["", "GET / HTTP/1.1\r\nHost:", "GET / HTTP/1.1\r\nHost: localhost:{port}\r\n\r\nGET"]
)
def test_callers_that_never_say_what_they_want_are_hung_up_on(
    begun: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(door, "GREETING_S", 0.3)
    rig = PageRig()
    with ExitStack() as stack:
        stack.callback(rig.page.abandon)
        port, everybody = rig.page.port, range(door.PLACES_N + 40)
        idle = [stack.enter_context(socket.create_connection(("127.0.0.1", port), 5)) for _ in everybody]
        for one in idle:
            with suppress(ConnectionError):  # a later one has its place
                one.sendall(begun.format(port=port).encode())
                while one.recv(65536):
                    pass
        assert rig.order(PAUSE) == (204, "")
    assert capfd.readouterr().err == ""


def test_whoever_has_no_token_keeps_no_operator_outside(rig: PageRig) -> None:
    host = f"Host: 127.0.0.1:{rig.page.port}\r\n"
    with ExitStack() as stack:
        for words in ("", f"GET / HTTP/1.1\r\n{host}X: ", f"GET /events HTTP/1.1\r\n{host}\r\n"):
            for _ in range(2 * door.PLACES_N):
                one = stack.enter_context(socket.create_connection(("127.0.0.1", rig.page.port), 5))
                with suppress(ConnectionError):
                    one.sendall(words.encode())
            assert rig.order(PAUSE) == (204, "")
        assert events(rig, rig.token) == 200


@pytest.mark.parametrize("first", ["", "look"])
def test_pages_of_who_may_do_less_leave_room_for_who_may_do_more(rig: PageRig, first: str) -> None:
    tokens = {"": "", **{str(role): token for role, token in rig.page._server.tokens.items()}}
    with ExitStack() as stack:

        def opened(role: str) -> int:
            """Of many pages of somebody."""
            pages = [stack.enter_context(stream(rig, token=tokens[role])) for _ in range(20)]
            return [page.recv(64)[9:12] for page in pages].count(b"200")

        assert opened(first) == {"": 8, "look": 12}[first]
        assert opened("look") == {"": 4, "look": 0}[first]
        assert opened("operate") == 4


def test_a_page_that_operates_stays_open_while_others_come(rig: PageRig) -> None:
    rig.tick()
    with ExitStack() as stack:
        page = stack.enter_context(stream(rig, token=rig.token))
        read_until(page, b'"tick":0')
        for _ in range(3 * door.PLACES_N):
            stack.enter_context(socket.create_connection(("127.0.0.1", rig.page.port), 5))
        time.sleep(0.12)
        rig.tick()
        read_until(page, b'"tick":1')


def test_an_order_that_never_ends_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(door, "GREETING_S", 0.3)
    rig = PageRig()
    head = f"POST /order HTTP/1.1\r\nHost: localhost:{rig.page.port}\r\nX-Cell-Token: {rig.token}\r\n"
    try:
        with socket.create_connection(("127.0.0.1", rig.page.port), 5) as slow:
            slow.sendall(f"{head}Content-Type: application/json\r\nContent-Length: 9\r\n\r\n{{".encode())
            assert slow.recv(64)[9:12] == b"408"
    finally:
        rig.page.abandon()
