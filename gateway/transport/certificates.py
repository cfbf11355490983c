"""Certificates: their files, their content, and their validity.

The role in a client's certificate is that of Modbus/TCP Security. This module is cheap to import, because
every plan loads it: ``cryptography`` is imported on first use, so that only a process that uses TLS pays for
it.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

from gateway.catalogue.entry import EventEntry
from gateway.catalogue.tls_events import CERTIFICATE_ENDED, CERTIFICATE_ENDS_SOON
from gateway.files import FileRefusedError, read_regular_file
from gateway.secret_files import secret_path
from gateway.status.line import CertificateStatus

if TYPE_CHECKING:
    from cryptography.x509 import Certificate, CertificateRevocationList

Taken = TypeVar("Taken")

# --- The files of a listener

LARGEST_FILE: Final = 4_000_000
"""Bytes. A list of revoked certificates may be long."""


class TlsFileError(Exception):
    """A file that TLS cannot use: its key, what was found, what to do; never its content."""

    def __init__(self, key: str, found: str, remedy: str) -> None:
        super().__init__(f"{key}: {found}; {remedy}")
        self.key = key
        self.found = found
        self.remedy = remedy


@dataclass(frozen=True, slots=True)
class TlsFiles:
    """Absolute paths; ``key`` may be ``credential:NAME``. ``revoked`` "": there is no such list."""

    certificate: str
    key: str
    clients: str
    revoked: str = ""

    @property
    def paths(self) -> dict[str, Path]:
        """Their paths, each by its key.

        Raises:
            TlsFileError: a credential is named, but the service has none.
        """
        names = {"certificate": self.certificate, "clients": self.clients, "revoked": self.revoked}
        paths = {key: Path(name) for key, name in names.items() if name}
        try:
            return {**paths, "key": secret_path(self.key, Path())}
        except FileRefusedError as error:
            raise TlsFileError("key", error.found, error.remedy) from None


# --- The role that a certificate gives

ROLE_OID: Final = "1.3.6.1.4.1.50316.802.1"
"""The extension that holds the role, as one UTF8String (MODBUS/TCP Security v36, R-21 to R-23)."""
LONGEST_ROLE: Final = 64
"""Characters."""
UTF8_STRING: Final = 0x0C
SHORT_LENGTH, ONE_BYTE_LENGTH, TWO_BYTE_LENGTH = 0x80, 0x81, 0x82
"""How DER writes lengths: below the first value in the byte itself, else in the following bytes (X.690,
8.1.3)."""


class NoRoleError(Exception):
    """A certificate without exactly one role; the text says what it has instead."""


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
    r"""Read a role from its DER bytes.

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
    """Return a role as DER bytes; the inverse of :func:`read_role`."""
    content = role.encode()
    return _header(len(content)) + content


def _header(length: int) -> bytes:
    if length < SHORT_LENGTH:
        return bytes((UTF8_STRING, length))
    if length <= 0xFF:
        return bytes((UTF8_STRING, ONE_BYTE_LENGTH, length))
    return bytes((UTF8_STRING, TWO_BYTE_LENGTH)) + length.to_bytes(2, "big")


# --- Validity

SOON: Final = timedelta(days=30)
"""``check`` and the running gateway warn of a certificate this long before its end."""
DAY: Final = timedelta(days=1)
"""Shortest time between two reports of one certificate; its expiry is reported in any case."""
CHECK_EVERY: Final = timedelta(minutes=1)
NEVER: Final = datetime.max.replace(tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class Life:
    """The validity of a certificate, and nothing else: quick to read."""

    subject: str
    begins: datetime
    ends: datetime
    sha256: str
    """The digest of its DER form, as ``openssl x509 -fingerprint -sha256`` shows it, without colons."""


@dataclass(frozen=True, slots=True)
class TimeProblem:
    """What is wrong with the validity of a certificate; ``is_good_now``: it has not expired yet."""

    found: str
    remedy: str
    is_good_now: bool


def time_problem(life: Life, now: datetime) -> TimeProblem | None:
    """Return the problem with a certificate's validity, None if there is none."""
    if life.ends < now:
        found = f"{life.subject} expired on {day(life.ends)}"
        return TimeProblem(found, "give a valid one; if this one is valid, set the clock", is_good_now=False)
    if life.begins > now:
        found = f"{life.subject} is not valid before {day(life.begins)}"
        return TimeProblem(found, "wait until then, or set the clock if it is wrong", is_good_now=False)
    if life.ends < now + SOON:
        found = f"{life.subject} expires on {day(life.ends)}"
        return TimeProblem(found, "have it renewed before that day", is_good_now=True)
    return None


def list_problem(name: str, ends: datetime | None, now: datetime) -> TimeProblem | None:
    """Return the problem if a list of revoked certificates has expired or expires soon."""
    if ends is None or ends >= now + SOON:
        return None
    when = "out of date since" if ends < now else "good until"
    remedy = "have the authority write a new list: an outdated one refuses every client"
    return TimeProblem(f"{name} is {when} {day(ends)}", remedy, is_good_now=ends >= now)


def day(when: datetime) -> str:
    """Return the day of a time, for people."""
    return when.date().isoformat()


# --- The content of a certificate

SMALLEST_RSA: Final = 2048
SMALLEST_CURVE: Final = 256
"""Bits."""
PEM_REMEDY: Final = "give a certificate in PEM, text that begins with -----BEGIN CERTIFICATE-----"


@dataclass(frozen=True, slots=True)
class Facts(Life):
    """One certificate."""

    issuer: str
    serial: str
    is_authority: bool
    is_for_servers: bool
    """Whether it may identify a server; also True if it names no purpose."""
    is_for_clients: bool
    names_purpose: bool
    """Whether it names a purpose."""
    hosts: tuple[str, ...]
    role: str
    why_no_role: str
    key: str
    weakness: str
    """Why its key is too weak; "" if it is not."""


def read_facts(path: Path) -> tuple[Facts, ...]:
    """Return every certificate of a file, in its order.

    Raises:
        FileRefusedError: it cannot be read, or holds none; with the remedy.
    """
    return _read(path, facts_of)


def read_lives(path: Path) -> tuple[Life, ...]:
    """Return the validity of the certificates of a file: quick.

    Raises:
        FileRefusedError: as :func:`read_facts`.
    """
    return _read(path, _life_of)


def _life_of(certificate: "Certificate") -> Life:
    return Life(
        certificate.subject.rfc4514_string(),
        certificate.not_valid_before_utc,
        certificate.not_valid_after_utc,
        _digest_of(certificate),
    )


def _digest_of(found: "Certificate | CertificateRevocationList") -> str:
    from cryptography.hazmat.primitives.hashes import SHA256

    return found.fingerprint(SHA256()).hex()


def _read(path: Path, take: Callable[["Certificate"], Taken]) -> tuple[Taken, ...]:
    from cryptography import x509

    content = read_regular_file(path, LARGEST_FILE, "a certificate in PEM")
    try:
        return tuple(map(take, x509.load_pem_x509_certificates(content)))
    except ValueError:  # its message is for programmers
        found = "a private key, not a certificate" if b"PRIVATE KEY-----" in content else "no certificates"
        raise FileRefusedError(found, PEM_REMEDY) from None


def facts_of(certificate: "Certificate") -> Facts:
    """Return the content of a certificate.

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
        sha256=_digest_of(certificate),
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
        return "?", f"a key of an unknown kind ({error})"
    if isinstance(key, rsa.RSAPublicKey):
        weakness = f"RSA of {key.key_size} bits, fewer than {SMALLEST_RSA}"
        return f"RSA {key.key_size}", weakness if key.key_size < SMALLEST_RSA else ""
    if isinstance(key, ec.EllipticCurvePublicKey):
        weakness = f"a curve of {key.key_size} bits, fewer than {SMALLEST_CURVE}"
        return key.curve.name, weakness if key.key_size < SMALLEST_CURVE else ""
    if isinstance(key, ed25519.Ed25519PublicKey | ed448.Ed448PublicKey):
        return "Ed25519" if isinstance(key, ed25519.Ed25519PublicKey) else "Ed448", ""
    return type(key).__name__, "a kind of key that TLS does not support"


def list_ends(path: Path) -> tuple[int, datetime | None, str]:
    """Return how many serials a list of revoked certificates has, when it expires, and its SHA-256.

    Raises:
        FileRefusedError: it cannot be read, or is no such list.
    """
    from cryptography import x509

    content = read_regular_file(path, LARGEST_FILE, "a list of revoked certificates in PEM")
    try:
        found = x509.load_pem_x509_crl(content)
    except ValueError as error:
        remedy = "give the authority's list (CRL) in PEM"
        raise FileRefusedError(f"not a list of revoked certificates ({error})", remedy) from None
    return len(found), found.next_update_utc, _digest_of(found)


# --- The clients that were admitted


@dataclass(frozen=True, slots=True)
class Identity:
    """A client that has shown a certificate, and its role."""

    subject: str
    serial: str
    """Hexadecimal, as ``openssl x509 -serial`` shows it."""
    role: str
    """"" if there is none; ``problem`` says why."""
    problem: str
    ends: str
    """When the certificate expires, ISO 8601."""


def identity_of(der: bytes, now: datetime) -> Identity:
    """Read a certificate that a handshake has accepted.

    A client may resume a session after its certificate has expired: that is a problem too.
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


# --- Expiry of the certificates in force: reported without reading the files again


@dataclass(frozen=True, slots=True)
class CertificateInForce:
    """A certificate, or a list of revoked ones, as it was when its file came into force."""

    key: str
    """Key in ``tls``: ``certificate``, ``clients`` or ``revoked``."""
    file: str
    life: Life | None
    """None: a list, or a file that only OpenSSL can read."""
    ends: datetime | None
    """None: never, or unknown."""
    sha256: str = ""
    """Of its DER form; "" if only OpenSSL can read the file."""

    def problem(self, now: datetime) -> TimeProblem | None:
        """Return the problem with its validity, None if there is none."""
        if self.life is None:
            return list_problem(self.file, self.ends, now)
        return time_problem(self.life, now)


def read_held(paths: Mapping[str, Path]) -> tuple[CertificateInForce, ...]:
    """Return the content of the ``tls`` files that OpenSSL has loaded, by their keys. It may block."""
    return tuple(
        held
        for key in ("certificate", "clients", "revoked")
        if key in paths
        for held in _held_in(key, paths[key])
    )


def _held_in(key: str, path: Path) -> Iterator[CertificateInForce]:
    try:
        if key == "revoked":
            _, ends, sha256 = list_ends(path)
            yield CertificateInForce(key, str(path), None, ends, sha256)
        else:
            for life in read_lives(path):
                yield CertificateInForce(key, str(path), life, life.ends, life.sha256)
    except FileRefusedError:  # `check` reports it; here its expiry stays unknown
        yield CertificateInForce(key, str(path), None, None)


class Endings:
    """Reports what expires soon or has expired: each certificate at the start, then at most once a day.

    ``report`` gets the event with its fields, and does not block. ``section`` is the configuration section of
    the keys, such as ``http.tls``. The time is an argument.
    """

    def __init__(self, report: Callable[[EventEntry, dict[str, object]], None], section: str) -> None:
        self._report = report
        self._section = section
        self._held: tuple[CertificateInForce, ...] = ()
        self._reported: dict[CertificateInForce, tuple[bool, datetime]] = {}
        """Whether it was still valid at its last report, and when that was."""
        self._looked: datetime | None = None

    def is_other(self, held: tuple[CertificateInForce, ...]) -> bool:
        """Whether one of these files differs from its version in force."""
        files = {(each.key, each.file) for each in held}
        return any((each.key, each.file) in files and each not in held for each in self._held)

    def take(self, held: tuple[CertificateInForce, ...]) -> None:
        """Use these from now on; earlier reports of an unchanged certificate stay valid."""
        self._held = held
        self._reported = {each: reported for each, reported in self._reported.items() if each in held}
        self._looked = None

    def is_due(self, now: datetime) -> bool:
        """Whether a report is due; may be called at any time, and checks once a minute."""
        if self._looked is not None and abs(now - self._looked) < CHECK_EVERY:
            return False
        self._looked = now
        return any(True for _ in self._due(now))

    def report(self, now: datetime) -> None:
        """Report what is due."""
        for held, problem in list(self._due(now)):
            self._reported[held] = problem.is_good_now, now
            fields: dict[str, object] = {
                "file": held.file,
                "days_left": _days_left(held.ends, now),
                "detail": f"{self._section}.{held.key}: {problem.found}",
                "remedy": problem.remedy,
            }
            self._report(CERTIFICATE_ENDS_SOON if problem.is_good_now else CERTIFICATE_ENDED, fields)

    def status(self, now: datetime) -> list[CertificateStatus]:
        """Return when each file expires: of several certificates in a file, the first to expire counts."""
        first: dict[str, CertificateInForce] = {}
        digests: dict[str, list[str]] = {}
        for held in self._held:
            digests.setdefault(held.key, []).extend(filter(None, [held.sha256]))
            if held.key not in first or (held.ends or NEVER) < (first[held.key].ends or NEVER):
                first[held.key] = held
        return [
            CertificateStatus(
                key=key,
                file=held.file,
                subject="" if held.life is None else held.life.subject,
                ends=None if held.ends is None else held.ends.isoformat(timespec="seconds"),
                days_left=_days_left(held.ends, now),
                sha256=digests[key],
            )
            for key, held in first.items()
        ]

    def _due(self, now: datetime) -> Iterator[tuple[CertificateInForce, TimeProblem]]:
        for held in self._held:
            problem = held.problem(now)
            if problem is None:
                continue
            was_good, reported = self._reported.get(held, (None, now))
            # After the clock was set back, a day counts as over: the real time is unknown.
            if was_good is not problem.is_good_now or not timedelta() <= now - reported < DAY:
                yield held, problem


def _days_left(ends: datetime | None, now: datetime) -> int | None:
    """Return whole days: 0 on the last one, negative after the end; None without an end."""
    return None if ends is None else (ends - now) // DAY
