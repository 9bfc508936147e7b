"""Topics of ROS 2 over DDS, as its middleware has them: names, and qualities of service."""

from __future__ import annotations

import socket
from dataclasses import dataclass
from typing import Any, Protocol

from bracket_cell.packages import needed
from bracket_cell.plant.ros_types import PACKAGE_OF, message
from bracket_ground.errors import InputError

WRITE_S = 0.1  # [s] that a reliable topic may wait for a slow reader
DOMAINS: dict[int, tuple[str, Any, Any]] = {}  # of this process: network, domain and participant; DDS knows each once
SETTINGS = """<CycloneDDS><Domain><General>
<Interfaces><NetworkInterface {by}="{network}" multicast="default"/></Interfaces>
<AllowMulticast>{multicast}</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex>{peers}</Discovery>
<Tracing><Verbosity>none</Verbosity></Tracing></Domain></CycloneDDS>"""
MOST_N = 256  # messages that are taken at a time
LOCAL = "127.0.0.1"


@dataclass(frozen=True)
class Quality:
    """How samples are delivered.

    Attributes:
        reliable: lost samples are sent again; a sensor's are not.
        kept: samples that wait for a reader.
        lasting: who comes later gets the last ones (transient local).
    """

    reliable: bool = True
    kept: int = 10
    lasting: bool = False


SENSOR = Quality(reliable=False, kept=5)  # rmw_qos_profile_sensor_data; it hears reliable publishers, too
LAST = Quality(kept=1, lasting=True)


class Network(Protocol):
    """Where topics are: ROS_DOMAIN_ID, and name or address of the network's interface."""

    @property
    def domain(self) -> int: ...

    @property
    def network(self) -> str: ...


class Node:
    """The participant of this process in a domain, as a context of ROS 2 has one.

    Raises:
        InputError: the extra is not installed, the network is not there, or the domain has another one here.
    """

    def __init__(self, settings: Network) -> None:
        self._dds = needed("cyclonedds.domain", PACKAGE_OF, "ros2")
        self._participant = self._opened(settings)

    def publisher(self, topic: str, kind: str, quality: Quality = Quality()) -> Any:
        """What writes messages of a kind, for example "std_msgs/msg/String"."""
        return self.writer(f"rt{topic}", message(kind), quality)

    def subscription(self, topic: str, kind: str, quality: Quality) -> Any:
        """What takes them."""
        return self.reader(f"rt{topic}", message(kind), quality)

    def writer(self, name: str, kind: Any, quality: Quality) -> Any:
        """The same of a name on the wire: ROS 2 has rt before topics, rq and rr before a service's two."""
        made = needed("cyclonedds.pub", PACKAGE_OF, "ros2")
        return made.DataWriter(self._participant, self._topic(name, kind), qos=_qos(quality))

    def reader(self, name: str, kind: Any, quality: Quality) -> Any:
        """What takes them, likewise."""
        made = needed("cyclonedds.sub", PACKAGE_OF, "ros2")
        return made.DataReader(self._participant, self._topic(name, kind), qos=_qos(quality))

    def _topic(self, name: str, kind: Any) -> Any:
        """The topic alone has no quality: each who writes or reads it has one."""
        made = needed("cyclonedds.topic", PACKAGE_OF, "ros2")
        return made.Topic(self._participant, name, kind)

    def _opened(self, settings: Network) -> Any:
        if settings.domain in DOMAINS:
            network, _, participant = DOMAINS[settings.domain]
            if network != settings.network:
                raise InputError(f"ROS 2: domain {settings.domain} is on {network} already")
            return participant
        core = needed("cyclonedds.core", PACKAGE_OF, "ros2")
        local = settings.network == LOCAL
        by = "address" if settings.network[0].isdigit() or ":" in settings.network else "name"
        names = [name for _, name in socket.if_nameindex()]
        if by == "name" and settings.network not in names:  # DDS would write to the terminal
            raise InputError(f"ROS 2: no network {settings.network!r} here; there are: {', '.join(names)}")
        peers = f'<Peers><Peer address="{LOCAL}"/></Peers>' if local else ""
        text = SETTINGS.format(by=by, network=settings.network, multicast="false" if local else "default", peers=peers)
        try:
            domain = self._dds.Domain(settings.domain, text)
            participant = self._dds.DomainParticipant(settings.domain)
        except core.DDSException:
            raise InputError(f"ROS 2: no network {settings.network!r} here") from None
        DOMAINS[settings.domain] = settings.network, domain, participant
        return participant


def _qos(quality: Quality) -> Any:
    qos = needed("cyclonedds.qos", PACKAGE_OF, "ros2")
    policy, util = qos.Policy, needed("cyclonedds.util", PACKAGE_OF, "ros2")
    reliable = policy.Reliability.Reliable(util.duration(seconds=WRITE_S))
    return qos.Qos(
        reliable if quality.reliable else policy.Reliability.BestEffort,
        policy.Durability.TransientLocal if quality.lasting else policy.Durability.Volatile,
        policy.History.KeepLast(quality.kept),
    )


def taken(reader: Any) -> list[Any]:
    """What came since the last call, oldest first; a topic that ended is no message."""
    core = needed("cyclonedds.internal", PACKAGE_OF, "ros2")
    return [came for came in reader.take(MOST_N) if not isinstance(came, core.InvalidSample)]


def waited(reader: Any, limit_s: float) -> Any:
    """The next message, or None where none comes in time; raises what the reader raises."""
    util, core = (needed(f"cyclonedds.{part}", PACKAGE_OF, "ros2") for part in ("util", "internal"))
    came = next(reader.take_iter(timeout=util.duration(seconds=limit_s)), None)
    return None if isinstance(came, core.InvalidSample) else came
