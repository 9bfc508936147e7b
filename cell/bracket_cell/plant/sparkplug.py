"""The numbers of a run by MQTT as an edge node of Sparkplug B 3.0: birth, data that changed, death."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from bracket_cell.production.samples import Sample
from bracket_cell.settings import MqttSettings
from bracket_cell.watching.observer import Observer, Outcome
from bracket_ground.errors import InputError, words_of

if TYPE_CHECKING:
    from pysparkplug import Metric

NAMESPACE = "spBv1.0"
REBIRTH = "Node Control/Rebirth"  # Sparkplug 3.0, 6.4.20: any host may ask for it
BIRTH_OR_DEATH = "bdSeq"
NUMBERS = 256  # of messages, and of births; then they begin anew
AGAIN_S = (1, 20)  # [s] a broker that is gone is tried again so soon, and at the latest
CLOSES_S = 2.0  # [s] in which the death is sent

Numbers = dict[str, float]


class SparkplugNode(Observer):
    """An observer that publishes what another counts, in a thread of its own; a broker that is gone stops nothing.

    All numbers are totals or states, so that whoever misses a message has everything after the next birth.

    Args:
        say: is told once whenever the broker is lost or refuses.

    Raises:
        InputError: the extra is not installed, or a file cannot be read.
    """

    def __init__(
        self, samples: Callable[[], Sequence[Sample]], settings: MqttSettings, say: Callable[[str], None]
    ) -> None:
        try:
            import paho.mqtt.client as mqtt
            import pysparkplug  # noqa: F401 - it is seen here whether it is installed
        except ImportError:
            raise InputError("plant.mqtt needs the extra mqtt, which brings pysparkplug") from None
        logging.getLogger("pysparkplug").setLevel(logging.CRITICAL)
        self._samples, self._settings, self._say = samples, settings, say
        self._lock, self._over, self._born = threading.Lock(), threading.Event(), threading.Event()
        self._sent: Numbers = {}
        self._sequence = self._births = 0
        self._lost = ""
        self._client = client = mqtt.Client(f"{settings.group}-{settings.node}", clean_session=True)
        client.suppress_exceptions = True
        self._secure()
        client.reconnect_delay_set(*AGAIN_S)
        client.on_connect, client.on_disconnect, client.on_message = self._connected, self._disconnected, self._ordered
        self._set_will()
        client.connect_async(settings.host, settings.port, keepalive=10)
        client.loop_start()
        self._thread = threading.Thread(target=self._publish_changes, name="Sparkplug", daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """Where the numbers are found."""
        return f"mqtt://{self._settings.host}:{self._settings.port}/{self._topic('NDATA')}"

    def close(self, outcome: Outcome) -> None:  # noqa: ARG002 - how it ended is among the numbers
        with suppress(Exception):
            self._publish()
        self.abandon()

    def abandon(self) -> None:
        """Publish the death and end; harmless when repeated."""
        if self._over.is_set():
            return
        self._over.set()
        if self._born.is_set():
            sent = self._client.publish(self._topic("NDEATH"), self._death(), qos=0)
            with suppress(ValueError, RuntimeError):  # it is not connected any more: its will is published then
                sent.wait_for_publish(CLOSES_S)
        self._client.disconnect()
        self._client.loop_stop()
        self._thread.join(CLOSES_S)

    def _secure(self) -> None:
        settings = self._settings
        try:
            if settings.certificates is not None:
                self._client.tls_set(ca_certs=str(settings.certificates))
            if settings.user is not None:
                password = None if settings.password_file is None else settings.password_file.read_text().strip()
                self._client.username_pw_set(settings.user, password)
        except (OSError, ValueError) as error:
            file = getattr(error, "filename", None) or "certificates or password_file"
            raise InputError(f"plant.mqtt: {file}: {words_of(error)}") from None

    def _connected(self, _: Any, __: Any, ___: Any, code: int) -> None:
        if code:
            self._tell(f"the broker at {self._settings.host} refuses: {REFUSALS.get(code, f'code {code}')}")
            return
        self._lost = ""
        self._client.subscribe(self._topic("NCMD"), qos=1)
        self._birth()

    def _disconnected(self, _: Any, __: Any, code: int) -> None:
        was_there = self._born.is_set()
        self._born.clear()
        self._births = (self._births + 1) % NUMBERS
        self._set_will()
        if code and was_there and not self._over.is_set():
            self._tell(f"the broker at {self._settings.host} is gone; it is tried again")

    def _tell(self, words: str) -> None:
        if words != self._lost:
            self._lost = words
            self._say(words)

    def _ordered(self, _: Any, __: Any, message: Any) -> None:
        """A host's command: the one that is obeyed is to publish the birth again."""
        from pysparkplug import NCmd

        try:
            metrics = NCmd.decode(message.payload).metrics
        except Exception:  # whatever a stranger sends: what is no command orders nothing
            return
        if any(metric.name == REBIRTH and metric.value is True for metric in metrics):
            self._birth()

    def _publish_changes(self) -> None:
        while not self._over.wait(self._settings.every_s):
            if not self._client.is_connected():
                if not self._born.is_set():
                    self._tell(f"the broker at {self._settings.host} is not there; it is tried again")
            elif self._born.is_set():
                self._publish()

    def _publish(self) -> None:
        """What changed; a number that the birth did not name needs another birth."""
        from pysparkplug import NData, get_current_timestamp

        with self._lock:
            numbers = self._numbers()
            if numbers.keys() == self._sent.keys():
                changed = {name: value for name, value in numbers.items() if value != self._sent[name]}
                if changed and self._born.is_set():
                    data = NData(get_current_timestamp(), self._next(), _metrics(changed))
                    self._client.publish(self._topic("NDATA"), data.encode(include_dtypes=True), qos=0)
                    self._sent = numbers
                return
        self._birth()

    def _birth(self) -> None:
        from pysparkplug import DataType, Metric, NBirth, get_current_timestamp

        with self._lock:
            self._sequence, self._sent = 0, self._numbers()
            now = get_current_timestamp()
            control = Metric(now, REBIRTH, DataType.BOOLEAN, value=False)
            metrics = (*_metrics(self._sent), control, self._number_of_birth())
            birth = NBirth(now, self._next(), metrics)
            self._client.publish(self._topic("NBIRTH"), birth.encode(include_dtypes=True), qos=0)
            self._born.set()

    def _numbers(self) -> Numbers:
        return {"/".join((name, *labels.values())): float(value) for name, labels, value in self._samples()}

    def _next(self) -> int:
        number, self._sequence = self._sequence, (self._sequence + 1) % NUMBERS
        return number

    def _number_of_birth(self) -> Metric:
        from pysparkplug import DataType, Metric, get_current_timestamp

        return Metric(get_current_timestamp(), BIRTH_OR_DEATH, DataType.INT64, value=self._births)

    def _death(self) -> bytes:
        from pysparkplug import NDeath, get_current_timestamp

        return NDeath(get_current_timestamp(), self._number_of_birth()).encode(include_dtypes=True)

    def _set_will(self) -> None:
        self._client.will_set(self._topic("NDEATH"), self._death(), qos=1)

    def _topic(self, kind: str) -> str:
        return f"{NAMESPACE}/{self._settings.group}/{kind}/{self._settings.node}"


REFUSALS = {  # MQTT 3.1.1, 3.2.2.3
    1: "another version of MQTT is needed",
    2: "another node has this name",
    3: "it is not ready",
    4: "user or password is wrong",
    5: "this user may not connect",
}


def _metrics(numbers: Numbers) -> tuple[Metric, ...]:
    from pysparkplug import DataType, Metric, get_current_timestamp

    now = get_current_timestamp()
    return tuple(Metric(now, name, DataType.DOUBLE, value=value) for name, value in numbers.items())
