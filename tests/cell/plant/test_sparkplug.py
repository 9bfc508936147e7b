"""The numbers of a run at a broker that others wrote: birth, data, rebirth, death, and a broker that goes."""

from __future__ import annotations

import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from bracket_cell.settings import MqttSettings
from bracket_ground.errors import InputError

pysparkplug = pytest.importorskip("pysparkplug", reason="the extra mqtt is not installed")
import paho.mqtt.client as mqtt  # noqa: E402 - it comes with the extra

from bracket_cell.plant.sparkplug import SparkplugNode  # noqa: E402

BROKER = shutil.which("mosquitto") or "/usr/sbin/mosquitto"
needs_broker = pytest.mark.skipif(not Path(BROKER).exists(), reason="mosquitto is not installed (apt-get)")
PATIENCE_S = 20.0


class Counted:
    """Numbers, as `Samples` has them."""

    def __init__(self) -> None:
        self.samples: tuple[tuple[str, dict[str, str], float], ...] = (
            ("cell_brackets_total", {"finished": "true"}, 0.0),
            ("cell_questions_total", {}, 0.0),
        )

    def __call__(self) -> tuple[tuple[str, dict[str, str], float], ...]:
        return self.samples


class Host:
    """A host of the plant, by the broker alone."""

    def __init__(self, port: int) -> None:
        self.heard: list[tuple[str, dict[str, Any], int | None]] = []
        self._client = mqtt.Client("host")
        self._client.on_message = self._take
        self._client.on_connect = lambda client, *_: client.subscribe("spBv1.0/#", qos=1)
        listens = threading.Event()
        self._client.on_subscribe = lambda *_: listens.set()
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()
        assert listens.wait(PATIENCE_S)  # a birth before that is not heard again

    def _take(self, _: Any, __: Any, message: Any) -> None:
        kind = message.topic.split("/")[2]
        payload = {"NBIRTH": pysparkplug.NBirth, "NDATA": pysparkplug.NData, "NDEATH": pysparkplug.NDeath}.get(kind)
        if payload is None:
            return
        read = payload.decode(message.payload)
        metrics = [read.bd_seq_metric] if kind == "NDEATH" else read.metrics
        self.heard.append((kind, {metric.name: metric.value for metric in metrics}, getattr(read, "seq", None)))

    def order(self, name: str, value: bool) -> None:
        metric = pysparkplug.Metric(0, name, pysparkplug.DataType.BOOLEAN, value=value)
        payload = pysparkplug.NCmd(0, (metric,)).encode(include_dtypes=True)
        self._client.publish("spBv1.0/plant/NCMD/bench 4", payload, qos=1)
        self._client.publish("spBv1.0/plant/NCMD/bench 4", b"\xff\x00 nonsense", qos=1)

    def kinds(self) -> list[str]:
        return [kind for kind, _, _ in self.heard]

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()


def until(holds: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < end_s, "it did not come"
        threading.Event().wait(0.02)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port: int = free.getsockname()[1]
        return port


@contextmanager
def broker(port: int, folder: Path, *lines: str) -> Iterator[subprocess.Popen[bytes]]:
    settings = folder / "mosquitto.conf"
    settings.write_text(
        "\n".join([f"listener {port} 127.0.0.1", *(lines or ["allow_anonymous true"]), "user root"]) + "\n"
    )
    with subprocess.Popen([BROKER, "-c", str(settings)], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as one:
        try:
            until(lambda: answers(port))
            yield one
        finally:
            one.terminate()


def answers(port: int) -> bool:
    with socket.socket() as client:
        return client.connect_ex(("127.0.0.1", port)) == 0


def settings(port: int, **more: Any) -> MqttSettings:
    return MqttSettings(host="127.0.0.1", port=port, node="bench 4", every_s=0.1, **more)


@needs_broker
def test_a_host_hears_birth_data_and_death(tmp_path: Path) -> None:
    counted, port, said = Counted(), free_port(), list[str]()
    with broker(port, tmp_path):
        host = Host(port)
        node = SparkplugNode(counted, settings(port), said.append)
        until(lambda: "NBIRTH" in host.kinds())
        kind, numbers, sequence = host.heard[0]
        assert (kind, sequence) == ("NBIRTH", 0)
        assert numbers["cell_brackets_total/true"] == 0.0
        counted.samples = (counted.samples[0], ("cell_questions_total", {}, 2.0))
        until(lambda: "NDATA" in host.kinds())
        assert host.heard[-1] == ("NDATA", {"cell_questions_total": 2.0}, 1)
        node.abandon()
        until(lambda: "NDEATH" in host.kinds())
        assert host.heard[-1][1]["bdSeq"] == numbers["bdSeq"]
        node.abandon()
        host.close()
    assert not said


@needs_broker
def test_a_number_that_is_new_and_a_host_that_asks_get_another_birth(tmp_path: Path) -> None:
    counted, port = Counted(), free_port()
    with broker(port, tmp_path):
        host, node = Host(port), SparkplugNode(counted, settings(port), lambda _: None)
        until(lambda: host.kinds().count("NBIRTH") == 1)
        counted.samples = (*counted.samples, ("cell_stops_total", {"reason": "hand_unknown"}, 1.0))
        until(lambda: host.kinds().count("NBIRTH") == 2)
        assert host.heard[-1][1]["cell_stops_total/hand_unknown"] == 1.0
        host.order("Node Control/Reboot", value=True)  # which is not obeyed
        host.order("Node Control/Rebirth", value=True)
        until(lambda: host.kinds().count("NBIRTH") == 3)
        node.abandon()
        host.close()


@needs_broker
def test_a_broker_that_goes_and_comes_back_is_born_to_anew_with_all_totals(tmp_path: Path) -> None:
    counted, port, said = Counted(), free_port(), list[str]()
    with broker(port, tmp_path):
        node = SparkplugNode(counted, settings(port), said.append)
        until(node._born.is_set)
    until(lambda: bool(said))
    assert said == ["the broker at 127.0.0.1 is gone; it is tried again"]
    counted.samples = (("cell_brackets_total", {"finished": "true"}, 7.0), counted.samples[1])
    with broker(port, tmp_path):
        host = Host(port)
        until(lambda: "NBIRTH" in host.kinds() or node._born.is_set())
        if "NBIRTH" not in host.kinds():
            host.order("Node Control/Rebirth", value=True)
        until(lambda: "NBIRTH" in host.kinds())
        birth = next(numbers for kind, numbers, _ in host.heard if kind == "NBIRTH")
        assert birth["cell_brackets_total/true"] == 7.0
        assert birth["bdSeq"] == 1
        node.abandon()
        host.close()


@needs_broker
def test_a_broker_that_refuses_is_told_once_in_words(tmp_path: Path) -> None:
    (tmp_path / "nobody").write_text("")
    port, said = free_port(), list[str]()
    with broker(port, tmp_path, "allow_anonymous false", f"password_file {tmp_path / 'nobody'}"):
        secret = tmp_path / "secret"
        secret.write_text("wrong\n")
        node = SparkplugNode(Counted(), settings(port, user="cell", password_file=secret), said.append)
        until(lambda: bool(said))
        node.abandon()
    assert said[0].startswith("the broker at 127.0.0.1 refuses: ")


def test_a_broker_that_is_not_there_stops_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    said = list[str]()
    node = SparkplugNode(Counted(), settings(free_port()), said.append)
    until(lambda: bool(said))
    node.abandon()
    assert said == ["the broker at 127.0.0.1 is not there; it is tried again"]
    assert capfd.readouterr() == ("", "")


def test_what_is_no_broker_is_told_once() -> None:
    """Whoever hangs up was never there: nothing is gone."""
    said, calls = list[str](), list[bytes]()
    with socket.create_server(("127.0.0.1", 0)) as server:

        def hang_up() -> None:
            with suppress(OSError):
                while True:
                    with server.accept()[0] as caller:
                        calls.append(caller.recv(64))

        threading.Thread(target=hang_up, daemon=True).start()
        node = SparkplugNode(Counted(), settings(server.getsockname()[1]), said.append)
        until(lambda: len(calls) > 2)
        node.abandon()
        server.shutdown(socket.SHUT_RDWR)
    assert said == ["the broker at 127.0.0.1 is not there; it is tried again"]


def test_a_password_file_that_is_not_there_is_told_before_anything_moves(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"plant\.mqtt: .*nothing"):
        SparkplugNode(Counted(), settings(1, user="a", password_file=tmp_path / "nothing"), print)


@pytest.mark.parametrize("name", ["a/b", "+", "#", ""])
def test_names_that_are_no_element_of_a_topic_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match="group"):
        MqttSettings(host="broker", group=name)
