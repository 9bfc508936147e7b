"""A served cell: the page outlives runs, runs outlive the server, and only a paired browser operates."""

from __future__ import annotations

import http.client
import json
import re
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from hashlib import sha256
from itertools import takewhile
from pathlib import Path
from typing import Any

import pytest

from bracket_cell.commands.main import main
from bracket_cell.commands.options import words_of
from bracket_cell.production.book import Book, RunRow
from bracket_cell.production.bookkeeper import Bookkeeper, Moment
from bracket_cell.runs.options import RunOptions
from bracket_cell.serving.certificate import fingerprint, with_certificate
from bracket_cell.serving.control import CellControl
from bracket_cell.serving.launcher import Launcher
from bracket_cell.serving.paired import WRONG_N, Paired
from bracket_cell.serving.server import CellServer
from bracket_cell.settings import PageSettings
from bracket_cell.viewing.gate import SOCKET, Address
from bracket_ground.errors import InputError
from tests.cell.viewing.page.rig import PageRig
from tests.trees.nodes.rig import PRODUCT

SOON_S = 20.0


class Served:
    """A server whose runs are a rig's page at its socket."""

    def __init__(self, folder: Path, begin: bool = True) -> None:
        self.book = Book(folder / "book.sqlite")
        self.launcher = Launcher(folder / "served", folder / "book.sqlite", ["--no-such-option"])
        self.paired = Paired(folder / "served" / "browsers.jsonl")
        more: Callable[[], list[str]] | None = list if begin else None
        titles = {goal: PRODUCT.goal_title(goal) for goal in PRODUCT.goals}
        control = CellControl(self.launcher, self.book, titles, more)
        self.server = CellServer(Address(0), PageSettings(), control, self.paired, PRODUCT.name)
        self.token = ""

    def ask(self, path: str, value: object = None, token: str | None = None) -> tuple[int, str]:
        connection = http.client.HTTPConnection("127.0.0.1", self.server.port, timeout=SOON_S)
        headers = {"X-Cell-Token": self.token if token is None else token, "Content-Type": "application/json"}
        body = None if value is None else json.dumps(value)
        try:
            connection.request("GET" if body is None else "POST", path, body, headers)
            answer = connection.getresponse()
            return answer.status, answer.read().decode()
        finally:
            connection.close()

    def events(self) -> Generator[tuple[str, Any], None, None]:
        connection = http.client.HTTPConnection("127.0.0.1", self.server.port, timeout=SOON_S)
        connection.request("GET", f"/events?token={self.token}")
        with closing(connection), connection.getresponse() as answer:
            while line := answer.readline().decode().rstrip("\n"):
                name, text = (
                    line.removeprefix("event: "),
                    answer.readline().decode().removeprefix("data: ").rstrip("\n"),
                )
                yield name, json.loads(text) if text[:1] in "{[" else text
                answer.readline()

    def pair(self) -> None:
        status, told = self.ask("/pair", {"code": self.paired.codes["operate"], "name": "Ada"})
        assert status == 200
        self.token = json.loads(told)["token"]


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    made = Served(tmp_path)
    yield made
    made.server.close()


def until(true: Callable[[], bool]) -> None:
    end_s = time.monotonic() + SOON_S
    while not true():
        assert time.monotonic() < end_s
        time.sleep(0.02)


def test_only_a_paired_browser_operates_and_it_stays_paired(served: Served, tmp_path: Path) -> None:
    job = {"kind": "job", "value": json.dumps({"variant": "g0"})}
    assert served.ask("/order", job)[0] == 401
    assert served.ask("/begin", {})[0] == 401
    code = served.paired.codes["operate"]
    served.pair()
    assert served.paired.codes["operate"] != code, "a code pairs one browser"
    assert served.ask("/order", job)[0] == 204
    later = Paired(tmp_path / "served" / "browsers.jsonl")
    assert later.role_of(served.token) == "operate"
    text = (tmp_path / "served" / "browsers.jsonl").read_text()
    assert served.token not in text
    assert (tmp_path / "served" / "browsers.jsonl").stat().st_mode & 0o077 == 0
    (tmp_path / "served" / "browsers.jsonl").write_text("")
    assert later.role_of(served.token) is None, "whose line is taken out is unknown"


def test_whoever_is_paired_brings_back_no_right_and_takes_none(tmp_path: Path) -> None:
    """Two servers in a folder, and lines that a person takes out."""
    file = tmp_path / "browsers.jsonl"
    one, other = Paired(file), Paired(file)
    gone, _ = one.pair(one.codes["operate"], "gone")
    stays, _ = other.pair(other.codes["look"], "stays")
    assert one.role_of(gone) == "operate"
    file.write_text("".join(line + "\n" for line in file.read_text().splitlines() if "gone" not in line))
    one.pair(one.codes["look"], "new")
    assert [paired.role_of(token) for paired in (one, other) for token in (gone, stays)] == [None, "look"] * 2


def test_codes_cannot_be_guessed(tmp_path: Path) -> None:
    drawn: list[int] = []
    paired = Paired(tmp_path / "browsers.jsonl", lambda: drawn.append(1))
    codes = dict(paired.codes)
    for _ in range(WRONG_N):
        with pytest.raises(InputError, match="not the code"):
            paired.pair("0", "x")
    assert paired.codes != codes
    assert drawn == [1]
    with pytest.raises(InputError, match="say who"):
        paired.pair(paired.codes["look"], "  ")


def test_orders_are_taken_changed_and_cancelled_between_runs(served: Served) -> None:
    served.pair()

    def order(**values: object) -> tuple[int, str]:
        return served.ask("/order", {"kind": "job", "value": json.dumps(values)})

    assert order(id="A17", variant=PRODUCT.goal_title("g1"), amount=2, due="2026-11-26T14:00")[0] == 204
    assert served.server.between()["orders"] == [
        {"id": "A17", "variant": "g1", "amount": 2, "due": "2026-11-26T14:00", "cancelled": False, "done": 0}
    ]
    assert order(id="A17", amount=3)[0] == 204
    assert served.server.between()["orders"][0]["amount"] == 3
    assert order(id="A17", amuont=3) == (
        409,
        "this is no work order: no key 'amuont'; legal: id, variant, amount, due, cancelled",
    )
    assert order(id="A17", cancelled=True)[0] == 204
    assert served.server.between()["orders"] == []


def test_a_page_that_stays_open_sees_runs_begin_and_end(served: Served) -> None:
    with closing(served.events()) as events:
        assert [next(events) for _ in range(2)] == [("served", "yes"), ("role", "look")]
        assert [next(events)[0] for _ in range(2)] == ["age", "between"]
        rig = PageRig(where=Address.parse(f"{SOCKET}{served.launcher.socket}", "--page"))
        rig.tick()
        during = {name for name, _ in takewhile(lambda event: event[0] != "state", events)}
        assert during <= {"between", "role", "still", "age"}
        rig.page.abandon()
        after = {name for name, _ in takewhile(lambda event: event[0] != "between", events)}
        assert after <= {"state", "age"}


def test_orders_and_pictures_reach_the_run(served: Served) -> None:
    rig = PageRig(where=Address.parse(f"{SOCKET}{served.launcher.socket}", "--page"))
    try:
        served.pair()
        rig.tick()
        assert served.ask("/order", {"kind": "pause", "value": "now"}) == (204, "")
        assert [operator_order.kind for operator_order in rig.said] == ["pause"]
        assert served.ask("/order", {"kind": "pause", "value": "now"}, token="x")[0] == 401
        status, told = served.ask("/order", {"kind": "speed", "value": "7"})
        assert (status, told) == (409, "a speed is 10 to 100 percent")
        assert "cell_speed_ratio" in served.ask("/metrics")[1]
        assert served.ask("/scene.json")[0] == 200
    finally:
        rig.page.abandon()
    assert served.ask("/order", {"kind": "pause", "value": "now"}) == (409, "no run goes on")
    assert 'cell_state{state="over"} 1' in served.ask("/metrics")[1]


def test_a_socket_lets_nobody_else_in(tmp_path: Path) -> None:
    where = Address.parse(f"{SOCKET}{tmp_path / 'run.sock'}", "--page")
    listening = where.listening()
    assert (tmp_path / "run.sock").stat().st_mode & 0o077 == 0
    with pytest.raises(InputError, match="another run"):
        where.listening()
    listening.close()
    where.listening().close()  # what nobody listens at is replaced


def test_a_run_outlives_its_server_and_the_next_one_knows(tmp_path: Path) -> None:
    launcher = Launcher(tmp_path, tmp_path / "book.sqlite", [])
    with launcher._locked() as lock:
        assert lock is not None
        run = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], pass_fds=[lock])
    later = Launcher(tmp_path, tmp_path / "book.sqlite", [])
    assert launcher.busy
    assert later.busy
    with pytest.raises(InputError, match="a run goes on already"):
        later.begin("")
    run.kill()
    run.wait()
    assert not later.busy


def test_a_run_that_does_not_begin_says_why(served: Served) -> None:
    served.pair()
    assert served.ask("/begin", {})[0] == 204
    until(lambda: not served.launcher.busy)
    told = served.server.between()
    assert told["words"] == "It did not begin"
    assert "--no-such-option" in told["problem"]


@pytest.mark.parametrize(
    ("ended", "words"),
    [
        ("finished", "Take the bracket out"),
        ("interrupted", "It was stopped"),
        ("fault", "stop button"),
        ("", "stop button"),
    ],
)
def test_a_page_says_what_to_do_after_a_run(served: Served, ended: str, words: str) -> None:
    run = served.book.begin(RunRow("a.mcap"))
    served.book.end(run, 10.0, ended, "", "world (pid 3534): does not answer")
    told = served.server.between()
    assert words in told["words"]
    assert "pid" not in told["words"]
    assert told["moment"] == ("alarm" if ended in ("", "fault") else "over")


def test_an_inspection_makes_quality_known(served: Served) -> None:
    served.pair()
    keeper = Bookkeeper(served.book, RunRow("a.mcap"))
    keeper.take(Moment(0.0, [("bracket", {"number": 1, "edge": "begin"})]))
    keeper.take(Moment(9.0, [("bracket", {"number": 1, "edge": "end", "finished": True, "goal": "g0"})]))
    assert "quality not known" in served.ask("/production")[1]
    assert 'share="quality"' not in served.ask("/metrics")[1]
    inspection = {"kind": "inspected", "run": 1, "number": 1, "right": False}
    assert served.ask("/order", inspection)[0] == 204
    assert "quality 0 %" in served.ask("/production")[1]
    assert 'cell_oee_ratio{share="quality"} 0' in served.ask("/metrics")[1]
    assert served.ask("/production.csv")[1].splitlines()[1].split(",")[10] == "wrong"
    assert served.ask("/order", {**inspection, "number": 2})[0] == 409
    assert served.ask("/order", {**inspection, "run": 2**63})[0] == 409
    assert served.ask("/order", {**inspection, "number": "2"})[0] == 400


def test_where_the_configuration_forbids_it_no_page_begins_a_run(tmp_path: Path) -> None:
    forbids = Served(tmp_path, begin=False)
    try:
        forbids.pair()
        assert forbids.ask("/begin", {}) == (409, "runs are begun at the cell alone: page.begin in the configuration")
        assert not forbids.server.between()["may_begin"]
    finally:
        forbids.server.close()


def test_options_are_typed_again_as_they_were() -> None:
    options = RunOptions(brackets=0, seed=3, share=0.5, goal="g1")
    assert words_of(options, ("brackets", "seed", "look", "share", "goal")) == [
        *("--shift", "0", "--seed", "3", "--share", "0.5", "--goal", "g1")
    ]


def test_a_tree_that_cannot_run_is_told_before_anything_is_served(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["serve", "none.xml"]) == 2
    assert "none.xml" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_certificate_is_made_once_for_a_host_and_its_key_is_private(tmp_path: Path) -> None:
    first = with_certificate(PageSettings(), tmp_path / "served", "cell-3.local")
    assert first.certificate is not None
    assert first.key is not None
    assert first.key.stat().st_mode & 0o077 == 0
    print_of_first = fingerprint(first.certificate)
    with_certificate(PageSettings(), tmp_path / "served", "cell-3.local")
    assert fingerprint(first.certificate) == print_of_first
    with_certificate(PageSettings(), tmp_path / "served", "10.0.0.7")
    assert fingerprint(first.certificate) != print_of_first
    own = PageSettings(certificate=tmp_path / "own.pem", key=tmp_path / "own.key")
    assert with_certificate(own, tmp_path / "served", "10.0.0.7") is own


def test_a_cell_that_is_served_to_a_network_makes_a_certificate_and_says_its_fingerprint(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.2", 0)) as free:
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "bracket_cell", "serve", "--page", f"127.0.0.2:{port}"]
    with (tmp_path / "told").open("w") as told:
        process = subprocess.Popen(command, cwd=tmp_path, stdout=told, stderr=told)
    try:
        until(lambda: "code to operate" in (tmp_path / "told").read_text())
        shown = re.sub(r"\s", "", (tmp_path / "told").read_text())
        assert f"https://127.0.0.2:{port}/" in shown
        kept = tmp_path / "runs" / "served" / "page.pem"
        trusting = ssl.create_default_context(cafile=str(kept))
        connection = http.client.HTTPSConnection("127.0.0.2", port, context=trusting, timeout=SOON_S)
        connection.request("GET", "/")
        assert connection.getresponse().status == 200
        sent = connection.sock.getpeercert(binary_form=True)
        assert isinstance(sent, bytes)
        assert sha256(sent).hexdigest().upper() in shown.replace(":", "")
        connection.close()
        stranger = http.client.HTTPSConnection("127.0.0.2", port, timeout=SOON_S)
        with pytest.raises(ssl.SSLCertVerificationError):
            stranger.request("GET", "/")
    finally:
        process.terminate()
        process.wait(SOON_S)
