"""The numbers of a run by OPC UA, read only, for the systems of a plant (`cell run --open opcua`)."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from bracket_cell.production.samples import Sample
from bracket_cell.viewing import gate
from bracket_cell.viewing.door import GREETING_S
from bracket_cell.viewing.gate import Address, Gate, begins, hidden_address
from bracket_cell.watching.observer import Observer, Outcome
from bracket_ground.errors import InputError

if TYPE_CHECKING:
    from asyncua.common.node import Node

NAMESPACE = "urn:bracket-cell"
EVERY_S = 0.5  # so often the values are renewed
STARTS_S, STOPS_S = 60.0, 5.0
HELLO, HELLO_BYTES = b"HELF", 32  # OPC 10000-6, 7.1.2.3: a Hello that names no address is so long


class OpcuaServer(Observer):
    """An observer that serves what another counts, in a thread and a loop of its own; clients can only read.

    Raises:
        InputError: the extra is not installed, or the port is taken.
    """

    def __init__(self, samples: Callable[[], Sequence[Sample]], where: Address) -> None:
        try:
            import asyncua  # noqa: F401
        except ImportError:
            raise InputError("--open opcua needs the extra opcua, which brings asyncua") from None
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)
        self._listening = where.listening()
        self.address = f"opc.tcp://{where.host}:{where.port}/cell/"
        self._samples, self._over, self._ready = samples, threading.Event(), threading.Event()
        self._nodes: dict[str, Node] = {}
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), name="OPC UA", daemon=True)
        self._thread.start()
        if not self._ready.wait(STARTS_S):
            raise InputError(f"--open opcua: the server at {self.address} did not begin within {STARTS_S:g} s")

    def close(self, outcome: Outcome) -> None:  # noqa: ARG002 - clients see the connection end
        self.abandon()

    def abandon(self) -> None:
        """Stop serving; harmless when repeated."""
        self._over.set()
        self._thread.join(STOPS_S)

    async def _serve(self) -> None:
        from asyncua import ua
        from asyncua.server.server import Server

        server, behind = Server(), hidden_address()
        await server.init()
        server.set_endpoint(self.address)
        server.socket_address = behind, 0
        server.set_match_discovery_client_ip(False)  # clients are told of the gate, not of what is behind it
        server.iserver.max_connections = gate.PLACES_N
        server.iserver.max_pending_activation_seconds = GREETING_S
        server.set_server_name("cell")
        server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        space = await server.register_namespace(NAMESPACE)
        folder = await server.nodes.objects.add_object(space, "Cell")
        async with server:
            assert server.bserver is not None  # it has begun
            at = Gate(self._listening, (behind, server.bserver.port), greets=begins(HELLO, HELLO_BYTES))
            while not self._over.is_set():
                for sample in self._samples():
                    await self._show(folder, space, sample)
                self._ready.set()
                await asyncio.sleep(EVERY_S)
            at.close()

    async def _show(self, folder: Node, space: int, sample: Sample) -> None:
        name, labels, value = sample
        full = ".".join((name, *labels.values()))
        if full not in self._nodes:
            self._nodes[full] = await folder.add_variable(f"ns={space};s={full}", full, float(value))
        await self._nodes[full].write_value(float(value))
