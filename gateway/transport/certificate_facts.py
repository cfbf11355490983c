"""What stands in a file of certificates, for those who check configurations and for people."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

from gateway.files import FileRefusedError, read_regular_file
from gateway.transport.certificate_times import Life
from gateway.transport.certificates import NoRoleError, role_of
from gateway.transport.tls_files import LARGEST_FILE

if TYPE_CHECKING:
    from cryptography.x509 import Certificate

Taken = TypeVar("Taken")
SMALLEST_RSA: Final = 2048
SMALLEST_CURVE: Final = 256
"""Bits."""
PEM_REMEDY: Final = "give a certificate in PEM, text that begins with -----BEGIN CERTIFICATE-----"


@dataclass(frozen=True, slots=True)
class Facts:
    """One certificate."""

    subject: str
    issuer: str
    serial: str
    begins: datetime
    ends: datetime
    is_authority: bool
    is_for_servers: bool
    """Whether it may say who a server is; also where it does not say what it is for at all."""
    is_for_clients: bool
    names_purpose: bool
    """Whether it says what it is for."""
    hosts: tuple[str, ...]
    role: str
    why_no_role: str
    key: str
    weakness: str
    """Why its key is not good enough; "" where it is."""


def read_facts(path: Path) -> tuple[Facts, ...]:
    """Return every certificate of a file, in its order.

    Raises:
        FileRefusedError: it cannot be read, or holds none; with the remedy.
    """
    return _read(path, facts_of)


def read_lives(path: Path) -> tuple[Life, ...]:
    """Return from when until when the certificates of a file are good: soon done.

    Raises:
        FileRefusedError: as :func:`read_facts`.
    """
    return _read(
        path,
        lambda one: Life(one.subject.rfc4514_string(), one.not_valid_before_utc, one.not_valid_after_utc),
    )


def _read(path: Path, take: Callable[["Certificate"], Taken]) -> tuple[Taken, ...]:
    from cryptography import x509

    content = read_regular_file(path, LARGEST_FILE, "a certificate in PEM")
    try:
        return tuple(map(take, x509.load_pem_x509_certificates(content)))
    except ValueError:  # what it says is for programmers
        found = "a private key, and no certificate" if b"PRIVATE KEY-----" in content else "no certificates"
        raise FileRefusedError(found, PEM_REMEDY) from None


def facts_of(certificate: "Certificate") -> Facts:
    """Return what a certificate says.

    Raises:
        ValueError: an extension that cannot be read.
    """
    from cryptography import x509
    from cryptography.x509.oid import ExtendedKeyUsageOID

    try:
        extensions = certificate.extensions
    except x509.DuplicateExtension as error:
        raise ValueError(f"an extension twice: {error.oid.dotted_string}") from None
    role = why_no_role = ""
    try:
        role = role_of(certificate)
    except NoRoleError as error:
        why_no_role = str(error)
    is_authority, usages = False, None
    hosts: tuple[str, ...] = ()
    for extension in extensions:
        if isinstance(extension.value, x509.BasicConstraints):
            is_authority = extension.value.ca
        elif isinstance(extension.value, x509.ExtendedKeyUsage):
            usages = set(extension.value)
        elif isinstance(extension.value, x509.SubjectAlternativeName):
            hosts = tuple(str(name.value) for name in extension.value)
    anything = ExtendedKeyUsageOID.ANY_EXTENDED_KEY_USAGE
    key, weakness = _key_of(certificate)
    return Facts(
        subject=certificate.subject.rfc4514_string(),
        issuer=certificate.issuer.rfc4514_string(),
        serial=f"{certificate.serial_number:X}",
        begins=certificate.not_valid_before_utc,
        ends=certificate.not_valid_after_utc,
        is_authority=is_authority,
        is_for_servers=usages is None or bool(usages & {ExtendedKeyUsageOID.SERVER_AUTH, anything}),
        is_for_clients=usages is None or bool(usages & {ExtendedKeyUsageOID.CLIENT_AUTH, anything}),
        names_purpose=usages is not None,
        hosts=hosts,
        role=role,
        why_no_role=why_no_role,
        key=key,
        weakness=weakness,
    )


def _key_of(certificate: "Certificate") -> tuple[str, str]:
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric import ec, ed448, ed25519, rsa

    try:
        key = certificate.public_key()
    except UnsupportedAlgorithm as error:
        return "?", f"a key of a kind that is not known ({error})"
    if isinstance(key, rsa.RSAPublicKey):
        weakness = f"RSA of {key.key_size} bits, fewer than {SMALLEST_RSA}"
        return f"RSA {key.key_size}", weakness if key.key_size < SMALLEST_RSA else ""
    if isinstance(key, ec.EllipticCurvePublicKey):
        weakness = f"a curve of {key.key_size} bits, fewer than {SMALLEST_CURVE}"
        return key.curve.name, weakness if key.key_size < SMALLEST_CURVE else ""
    if isinstance(key, ed25519.Ed25519PublicKey | ed448.Ed448PublicKey):
        return "Ed25519" if isinstance(key, ed25519.Ed25519PublicKey) else "Ed448", ""
    return type(key).__name__, "a key of a kind that TLS has no use for"


def list_ends(path: Path) -> tuple[int, datetime | None]:
    """Return how many serials a list of revoked certificates has, and when it is good no more.

    Raises:
        FileRefusedError: it cannot be read, or is none.
    """
    from cryptography import x509

    content = read_regular_file(path, LARGEST_FILE, "a list of revoked certificates in PEM")
    try:
        found = x509.load_pem_x509_crl(content)
    except ValueError as error:
        remedy = "give the authority's list (CRL) in PEM"
        raise FileRefusedError(f"no list of revoked certificates ({error})", remedy) from None
    return len(found), found.next_update_utc
