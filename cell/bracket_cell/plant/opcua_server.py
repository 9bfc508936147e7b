"""A cell by OPC UA: anybody may read, clients with a trusted certificate may order; in a thread and loop of its own."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

from bracket_cell.packages import needed
from bracket_cell.plant.opcua_space import CALLER, CellSpace, Control
from bracket_cell.settings import OpcuaSettings
from bracket_cell.viewing import gate
from bracket_cell.viewing.door import GREETING_S
from bracket_cell.viewing.gate import Address, Gate, begins, hidden_address
from bracket_ground.errors import InputError

PACKAGE_OF, EXTRA, KEY = "plant.opcua", "opcua", "plant.opcua.at"
APPLICATION, COMMON_NAME = "urn:bracket-cell:server", "a cell"
EVERY_S = 0.5  # so often the values are renewed
STARTS_S, STOPS_S = 60.0, 5.0
HELLO, HELLO_BYTES = b"HELF", 32  # OPC 10000-6, 7.1.2.3: a Hello that names no address is so long


class OpcuaServer:
    """Serves a cell until it is closed.

    Args:
        folder: for the server's own certificate and key, made at the first start.
        control: the cell.
        say: is told if it ends before it is closed.

    Raises:
        InputError: the extra is not installed, the port is taken, or a certificate cannot be read.
    """

    def __init__(self, settings: OpcuaSettings, folder: Path, control: Control, say: Callable[[str], None]) -> None:
        needed("asyncua", PACKAGE_OF, EXTRA)
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)
        where = Address.parse(settings.at, KEY)
        self._clients = _trusted(settings.trusted)
        self._listening = where.listening()
        self.address = f"opc.tcp://{where.host}:{where.port}/cell/"
        self._host, self._folder, self._control, self._say = where.host, folder, control, say
        self._over, self._ready, self._problem = threading.Event(), threading.Event(), ""
        self._thread = threading.Thread(target=self._run, name="OPC UA", daemon=True)
        self._thread.start()
        if not self._ready.wait(STARTS_S):
            raise InputError(f"{KEY}: the server at {self.address} did not begin within {STARTS_S:g} s")
        if self._problem:
            raise InputError(f"{KEY}: the server at {self.address} did not begin: {self._problem}")

    def close(self) -> None:
        """Serve no longer; harmless when repeated."""
        self._over.set()
        self._thread.join(STOPS_S)

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except Exception as error:  # whatever ends the library's server: it is said, and the cell goes on
            self._problem = f"{type(error).__name__}: {error}"
            if self._ready.is_set():
                self._say(f"OPC UA is served no more: {self._problem}")
        finally:
            self._listening.close()
            self._ready.set()

    async def _serve(self) -> None:
        from asyncua.server.server import Server

        server, behind = Server(user_manager=_users(self._clients)), hidden_address()
        await server.init()
        await self._secure(server)
        server.set_endpoint(self.address)
        server.socket_address = behind, 0
        server.set_match_discovery_client_ip(False)  # clients are told of the gate, not of what is behind it
        server.iserver.max_connections = gate.PLACES_N
        server.iserver.max_pending_activation_seconds = GREETING_S
        server.set_server_name("cell")
        space = CellSpace(server, self._control)
        await space.make()
        async with server:
            assert server.bserver is not None  # it has begun
            at = Gate(self._listening, (behind, server.bserver.port), greets=begins(HELLO, HELLO_BYTES))
            with closing(at):
                while not self._over.is_set():
                    await space.renew()
                    self._ready.set()
                    await asyncio.sleep(EVERY_S)

    async def _secure(self, server: Any) -> None:
        """Two end points: in clear to read, and signed and encrypted by the server's own certificate."""
        from asyncua import ua
        from asyncua.crypto.cert_gen import setup_self_signed_certificate
        from cryptography.x509.oid import ExtendedKeyUsageOID as Usage

        self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        certificate, key = self._folder / "certificate.der", self._folder / "key.pem"
        name = {"commonName": COMMON_NAME}
        await setup_self_signed_certificate(key, certificate, APPLICATION, self._host, [Usage.SERVER_AUTH], name)
        await server.set_application_uri(APPLICATION)
        await server.load_certificate(certificate)
        await server.load_private_key(key)
        policies = [ua.SecurityPolicyType.NoSecurity, ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt]
        server.set_security_policy(policies, permission_ruleset=_rules())
        server.set_identity_tokens([ua.AnonymousIdentityToken, ua.X509IdentityToken])


def _trusted(folder: Path | None) -> dict[bytes, str]:
    """Names of clients by their certificate in DER: the names of its file."""
    from cryptography import x509
    from cryptography.hazmat.primitives.serialization import Encoding

    if folder is None:
        return {}
    try:
        files = sorted(path for path in folder.iterdir() if path.suffix in (".der", ".pem", ".crt", ".cer"))
    except OSError as error:
        raise InputError(f"plant.opcua.trusted: {folder}: {error.strerror}") from None
    found = {}
    for path in files:
        try:
            text = path.read_bytes()
            read = x509.load_pem_x509_certificate if text.startswith(b"-----") else x509.load_der_x509_certificate
            found[read(text).public_bytes(Encoding.DER)] = path.stem
        except (OSError, ValueError):
            raise InputError(f"plant.opcua.trusted: {path} is no certificate of X.509") from None
    return found


def _users(clients: dict[bytes, str]) -> Any:
    """Whose certificate is trusted has a name; the library has checked that a client has the key of its own."""
    from asyncua.crypto.permission_rules import User, UserRole
    from asyncua.server.user_managers import UserManager

    class Users(UserManager):
        def get_user(self, iserver: Any, username: Any = None, password: Any = None, certificate: Any = None) -> User:  # noqa: ARG002
            name = clients.get(certificate)
            return User(UserRole.Anonymous if name is None else UserRole.User, name)

    return Users()


def _rules() -> Any:
    """Nobody changes the address space; only who has a name calls methods."""
    from asyncua.crypto.permission_rules import ADMIN_TYPES, PermissionRuleset, UserRole
    from asyncua.ua.object_ids import ObjectIds

    call = ObjectIds.CallRequest_Encoding_DefaultBinary
    never = {*ADMIN_TYPES, ObjectIds.WriteRequest_Encoding_DefaultBinary}

    class Rules(PermissionRuleset):
        def check_validity(self, user: Any, action_type: Any, body: Any) -> bool:  # noqa: ARG002
            asked = action_type.Identifier
            CALLER.set(user.name or "")
            return asked not in never and (asked != call or user.role is UserRole.User)

    return Rules()
