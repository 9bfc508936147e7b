"""The numbers of a run by OPC UA, read only, for the systems of a plant (`cell run --opcua`)."""

from __future__ import annotations

import asyncio
import logging
import threading
from typing import TYPE_CHECKING

from cell.errors import InputError
from cell.viewing.gate import Address
from cell.viewing.production import Production, Sample
from cell.watching.observer import Observer, Outcome

if TYPE_CHECKING:
    from asyncua.common.node import Node

NAMESPACE = "urn:bracket-cell"
EVERY_S = 0.5  # so often the values are renewed
STARTS_S, STOPS_S = 60.0, 5.0


class OpcuaServer(Observer):
    """An observer that serves what another counts, in a thread and a loop of its own; clients can only read.

    Raises:
        InputError: the extra is not installed, or the port is taken.
    """

    def __init__(self, production: Production, where: Address) -> None:
        try:
            import asyncua  # noqa: F401
        except ImportError:
            raise InputError("--opcua needs the extra opcua, which brings asyncua") from None
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)
        where.listening(1).close()  # so that a port that is taken is told
        self.address = f"opc.tcp://{where.host}:{where.port}/cell/"
        self._production, self._over, self._ready = production, threading.Event(), threading.Event()
        self._nodes: dict[str, Node] = {}
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), name="OPC UA", daemon=True)
        self._thread.start()
        if not self._ready.wait(STARTS_S):
            raise InputError(f"--opcua: the server at {self.address} did not begin within {STARTS_S:g} s")

    def close(self, outcome: Outcome) -> None:  # noqa: ARG002 - clients see the connection end
        self.abandon()

    def abandon(self) -> None:
        """Stop serving; harmless when repeated."""
        self._over.set()
        self._thread.join(STOPS_S)

    async def _serve(self) -> None:
        from asyncua import ua
        from asyncua.server.server import Server

        server = Server()
        await server.init()
        server.set_endpoint(self.address)
        server.set_server_name("cell")
        server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        space = await server.register_namespace(NAMESPACE)
        folder = await server.nodes.objects.add_object(space, "Cell")
        async with server:
            while not self._over.is_set():
                for sample in self._production.samples:
                    await self._show(folder, space, sample)
                self._ready.set()
                await asyncio.sleep(EVERY_S)

    async def _show(self, folder: Node, space: int, sample: Sample) -> None:
        name, labels, value = sample
        full = ".".join((name, *labels.values()))
        if full not in self._nodes:
            self._nodes[full] = await folder.add_variable(f"ns={space};s={full}", full, float(value))
        await self._nodes[full].write_value(float(value))
