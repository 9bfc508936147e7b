"""A certificate of the cell's own where none is configured: no code or order goes over a network in clear."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.ec import SECP256R1, generate_private_key
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

from bracket_cell.settings import PageSettings

VALID, LEFT = timedelta(days=800), timedelta(days=30)  # browsers refuse more than 825; made anew before its end


def with_certificate(settings: PageSettings, folder: Path, host: str) -> PageSettings:
    """The settings, with a certificate for a host that is made at the first start and kept in a folder."""
    if settings.certificate is not None:
        return settings
    certificate, key = folder / "page.pem", folder / "page.key"
    if not (certificate.is_file() and key.is_file() and _fits(certificate, host)):
        folder.mkdir(parents=True, exist_ok=True)
        _make(certificate, key, host)
    return settings.model_copy(update={"certificate": certificate, "key": key})


def fingerprint(certificate: Path) -> str:
    """SHA-256 of a certificate, as browsers show it."""
    return x509.load_pem_x509_certificate(certificate.read_bytes()).fingerprint(SHA256()).hex(":").upper()


def _fits(certificate: Path, host: str) -> bool:
    try:
        found = x509.load_pem_x509_certificate(certificate.read_bytes())
        names = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (ValueError, x509.ExtensionNotFound):
        return False
    return _name(host) in names and found.not_valid_after_utc - datetime.now(UTC) > LEFT


def _make(certificate: Path, key: Path, host: str) -> None:
    secret, now = generate_private_key(SECP256R1()), datetime.now(UTC)
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "a cell")])
    made = (
        x509.CertificateBuilder(name, name, secret.public_key(), x509.random_serial_number(), now, now + VALID)
        .add_extension(x509.SubjectAlternativeName([_name(host)]), critical=False)
        .sign(secret, SHA256())
    )
    pem = secret.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    key.unlink(missing_ok=True)
    key.touch(0o600)
    key.write_bytes(pem)
    certificate.write_bytes(made.public_bytes(Encoding.PEM))


def _name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(host))
    except ValueError:
        return x509.DNSName(host)
