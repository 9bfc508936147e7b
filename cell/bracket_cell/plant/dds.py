"""Topics of ROS 2 over DDS, as its middleware has them: names, and qualities of service."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from bracket_cell.packages import needed
from bracket_cell.plant.ros_types import PACKAGE_OF, message
from bracket_cell.skills.drivers.settings import DdsSettings
from bracket_ground.errors import InputError

WRITE_S = 0.1  # [s] that a reliable topic may wait for a slow reader
DOMAINS: dict[int, tuple[str, Any]] = {}  # of this process, each with its network; DDS knows each once
SETTINGS = """<CycloneDDS><Domain><General>
<Interfaces><NetworkInterface {by}="{network}" multicast="default"/></Interfaces>
<AllowMulticast>{multicast}</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex>{peers}</Discovery>
<Tracing><Verbosity>none</Verbosity></Tracing></Domain></CycloneDDS>"""
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


class Node:
    """A participant of a domain.

    Raises:
        InputError: the extra is not installed, the network is not there, or the domain has another one here.
    """

    def __init__(self, settings: DdsSettings) -> None:
        self._dds = needed("cyclonedds.domain", PACKAGE_OF, "ros2")
        self._open(settings)
        self._participant = self._dds.DomainParticipant(settings.domain)

    def publisher(self, topic: str, kind: str, quality: Quality = Quality()) -> Any:
        """What writes messages of a kind, for example "std_msgs/msg/String"."""
        made = needed("cyclonedds.pub", PACKAGE_OF, "ros2")
        return made.DataWriter(self._participant, self._topic(topic, kind, quality), qos=_qos(quality))

    def subscription(self, topic: str, kind: str, quality: Quality) -> Any:
        """What takes them."""
        made = needed("cyclonedds.sub", PACKAGE_OF, "ros2")
        return made.DataReader(self._participant, self._topic(topic, kind, quality), qos=_qos(quality))

    def _topic(self, topic: str, kind: str, quality: Quality) -> Any:
        """ROS 2's topics have rt before their names on the wire."""
        made = needed("cyclonedds.topic", PACKAGE_OF, "ros2")
        return made.Topic(self._participant, f"rt{topic}", message(kind), qos=_qos(quality))

    def _open(self, settings: DdsSettings) -> None:
        if settings.domain in DOMAINS:
            if DOMAINS[settings.domain][0] != settings.network:
                raise InputError(f"ROS 2: domain {settings.domain} is on {DOMAINS[settings.domain][0]} already")
            return
        core = needed("cyclonedds.core", PACKAGE_OF, "ros2")
        local = settings.network == LOCAL
        by = "address" if settings.network[0].isdigit() or ":" in settings.network else "name"
        peers = f'<Peers><Peer address="{LOCAL}"/></Peers>' if local else ""
        text = SETTINGS.format(by=by, network=settings.network, multicast="false" if local else "default", peers=peers)
        try:
            DOMAINS[settings.domain] = settings.network, self._dds.Domain(settings.domain, text)
        except core.DDSException as error:
            raise InputError(f"ROS 2: no network {settings.network!r} here ({type(error).__name__})") from None


def _qos(quality: Quality) -> Any:
    told = needed("cyclonedds.qos", PACKAGE_OF, "ros2")
    policy, util = told.Policy, needed("cyclonedds.util", PACKAGE_OF, "ros2")
    reliable = policy.Reliability.Reliable(util.duration(seconds=WRITE_S))
    return told.Qos(
        reliable if quality.reliable else policy.Reliability.BestEffort,
        policy.Durability.TransientLocal if quality.lasting else policy.Durability.Volatile,
        policy.History.KeepLast(quality.kept),
    )
