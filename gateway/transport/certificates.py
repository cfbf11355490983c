"""What a certificate says of whoever shows it; the role is that of Modbus/TCP Security.

``cryptography`` is imported where it is needed first: only a process that has to do with TLS pays for it.
"""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from cryptography.x509 import Certificate

ROLE_OID: Final = "1.3.6.1.4.1.50316.802.1"
"""The extension that holds the role, as one UTF8String (MODBUS/TCP Security v36, R-21 to R-23)."""
LONGEST_ROLE: Final = 64
"""Characters."""
UTF8_STRING: Final = 0x0C
SHORT_LENGTH, ONE_BYTE_LENGTH, TWO_BYTE_LENGTH = 0x80, 0x81, 0x82
"""How DER writes lengths: in the byte itself below the first, else in bytes that follow (X.690, 8.1.3)."""


class NoRoleError(Exception):
    """A certificate without one role; the text says what it has instead."""


@dataclass(frozen=True, slots=True)
class Identity:
    """Who has shown a certificate, and as what."""

    subject: str
    serial: str
    """Hexadecimal, as ``openssl x509 -serial`` shows it."""
    role: str
    """"" where there is none; ``problem`` says why."""
    problem: str
    ends: str
    """When the certificate is good no more, ISO 8601."""


def identity_of(der: bytes, now: datetime) -> Identity:
    """Read a certificate that a handshake has found good.

    It may have expired since a session began that a client takes up again: then it is a problem too.
    """
    from cryptography import x509

    try:
        certificate = x509.load_der_x509_certificate(der)
        subject, serial = certificate.subject.rfc4514_string(), f"{certificate.serial_number:X}"
        begins, ends = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    except ValueError as error:  # OpenSSL is less strict
        return Identity("?", "?", "", f"it cannot be read ({error})", "")
    role = problem = ""
    try:
        role = role_of(certificate)
    except NoRoleError as error:
        problem = str(error)
    if not begins <= now <= ends:
        problem = "it has expired"
    return Identity(subject, serial, role, problem, ends.isoformat(timespec="seconds"))


def role_of(certificate: "Certificate") -> str:
    """Return the role that a certificate gives.

    Raises:
        NoRoleError: it has none, several, or something that is no UTF8String.
    """
    from cryptography import x509

    try:
        found = [each for each in certificate.extensions if each.oid.dotted_string == ROLE_OID]
    except x509.DuplicateExtension as error:
        if error.oid.dotted_string == ROLE_OID:
            raise NoRoleError("it has more than one role") from None
        raise NoRoleError(f"its extensions cannot be read ({error})") from None
    except ValueError as error:
        raise NoRoleError(f"its extensions cannot be read ({error})") from None
    if not found:
        raise NoRoleError(f"it has no role (extension {ROLE_OID})")
    value = found[0].value
    assert isinstance(value, x509.UnrecognizedExtension), "cryptography knows nothing of Modbus"
    return read_role(value.value)


def read_role(der: bytes) -> str:
    r"""Read a role as it stands in a certificate.

    Raises:
        NoRoleError: anything but one UTF8String with 1 to 64 printable characters.

    >>> read_role(b"\x0c\x08Operator")
    'Operator'
    """
    role = ""
    header = 2
    if len(der) > 1 and der[1] == ONE_BYTE_LENGTH:
        header = 3
    elif len(der) > 1 and der[1] == TWO_BYTE_LENGTH:
        header = 4
    if len(der) > header and der[0] == UTF8_STRING and der[:header] == _header(len(der) - header):
        try:
            role = der[header:].decode()
        except UnicodeDecodeError:
            role = ""
    if not role or len(role) > LONGEST_ROLE or not role.isprintable():
        raise NoRoleError(f"its role is not one UTF8String with 1 to {LONGEST_ROLE} characters")
    return role


def write_role(role: str) -> bytes:
    """Return a role as it stands in a certificate; the other way of :func:`read_role`."""
    content = role.encode()
    return _header(len(content)) + content


def _header(length: int) -> bytes:
    if length < SHORT_LENGTH:
        return bytes((UTF8_STRING, length))
    if length <= 0xFF:
        return bytes((UTF8_STRING, ONE_BYTE_LENGTH, length))
    return bytes((UTF8_STRING, TWO_BYTE_LENGTH)) + length.to_bytes(2, "big")


def now_utc() -> datetime:
    """Return the time that certificates are held against."""
    return datetime.now(UTC)
