"""Certificates for Modbus/TCP Security: an authority, its certificates, its folder, and file contents.

P-256 throughout: its handshake costs less than one with RSA of 2048 bits and a fifth of one with 4096. All
TLS 1.2 implementations support it. No file in a folder is ever overwritten, except the revocation list.
"""

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from gateway.files import FileRefusedError, create, read_regular_file
from gateway.options import OptionError
from gateway.plain import JsonObject
from gateway.state.folder import write_whole
from gateway.transport.certificates import (
    LARGEST_FILE,
    LONGEST_ROLE,
    ROLE_OID,
    SOON,
    Facts,
    day,
    list_ends,
    read_facts,
    write_role,
)

AUTHORITY_DAYS: Final = 3650
NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,62}")
HOST: Final = re.compile(r"(?=.{1,253}$)[A-Za-z0-9_]([A-Za-z0-9_.-]*[A-Za-z0-9])?|[0-9A-Fa-f:.]{2,45}")
LEAF_DAYS: Final = 825
"""The longest term that browsers and systems accepted at the time; a year more than most need."""
SKEW: Final = timedelta(hours=1)
"""A certificate is valid a little before it was made: clocks of machines differ."""


@dataclass(frozen=True, slots=True)
class Signed:
    """A certificate with its key."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey


def make_authority(name: str, now: datetime, days: float = AUTHORITY_DAYS) -> Signed:
    """Make a self-signed authority. Raises OptionError: no such name."""
    _check_text("name", name)
    key = ec.generate_private_key(ec.SECP256R1())
    subject = _name(name)
    builder = _builder(subject, subject, key, now, now + timedelta(days=days))
    certificate = (
        builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs=True), critical=True)
        .sign(key, hashes.SHA256())
    )
    return Signed(certificate, key)


def make_server(authority: Signed, name: str, hosts: Sequence[str], now: datetime) -> Signed:
    """Make the certificate of a gateway for ``hosts``, names or addresses. Raises OptionError: no host."""
    for host in hosts:
        if not HOST.fullmatch(host):
            raise OptionError("host", f"found {host!r}; allowed: a host name or an address")
    return make_leaf(authority, name, [ExtendedKeyUsageOID.SERVER_AUTH], [_host_names(hosts)], now)


def make_viewer(authority: Signed, name: str, now: datetime) -> Signed:
    """Make the certificate of a client of pages, such as Prometheus: without a role it moves nothing."""
    return make_leaf(authority, name, [ExtendedKeyUsageOID.CLIENT_AUTH], [], now)


def why_renewed(pair: tuple[bytes, bytes], authority: Signed, hosts: Sequence[str], now: datetime) -> str:
    """Return why a certificate with its key, both in PEM, needs another one; "" if it does not.

    ``hosts`` are those that it must name; none for a client.
    """
    try:
        certificate = x509.load_pem_x509_certificate(pair[0])
        key = load_pem_private_key(pair[1], None)
        certificate.verify_directly_issued_by(authority.certificate)
    except (ValueError, TypeError, InvalidSignature):
        return "the old one is none of this authority, or has no key"
    if key.public_key() != certificate.public_key():
        return "the old one has another key"
    ends = certificate.not_valid_after_utc
    # One that ends with its authority would be no longer valid if it were made anew.
    if ends < now + SOON and (ends < authority.certificate.not_valid_after_utc or ends < now):
        return f"the old one ends on {day(ends)}"
    named = [each.value for each in certificate.extensions if each.oid == x509.SubjectAlternativeName.oid]
    if named != ([_host_names(hosts)] if hosts else []):
        return "the hosts are others"
    return ""


def _host_names(hosts: Sequence[str]) -> x509.SubjectAlternativeName:
    return x509.SubjectAlternativeName([_general_name(host) for host in hosts])


def make_controller(authority: Signed, name: str, role: str, now: datetime) -> Signed:
    """Make the certificate of a controller with a role. Raises OptionError: no such role."""
    _check_text("role", role, LONGEST_ROLE)
    return make_leaf(authority, name, [ExtendedKeyUsageOID.CLIENT_AUTH], [role_extension(role)], now)


def _check_text(field: str, text: str, longest: int = 64) -> None:
    if not text.isprintable() or not 0 < len(text) <= longest:
        raise OptionError(field, f"found {text!r}; allowed: 1 to {longest} visible characters")


def role_extension(role: str) -> x509.UnrecognizedExtension:
    """Return the extension that holds a role."""
    return x509.UnrecognizedExtension(x509.ObjectIdentifier(ROLE_OID), write_role(role))


def make_leaf(
    authority: Signed,
    name: str,
    usages: Iterable[x509.ObjectIdentifier],
    extensions: Iterable[x509.ExtensionType],
    now: datetime,
    *,
    days: float = LEAF_DAYS,
) -> Signed:
    """Make a certificate that cannot sign; it never outlives its authority."""
    key = ec.generate_private_key(ec.SECP256R1())
    issuer = authority.certificate
    ends = min(now + timedelta(days=days), issuer.not_valid_after_utc)
    builder = (
        _builder(_name(name), issuer.subject, key, now, ends)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage(usages), critical=False)
        .add_extension(_authority_key(issuer), critical=False)
    )
    for extension in extensions:
        builder = builder.add_extension(extension, critical=False)
    return Signed(builder.sign(authority.key, hashes.SHA256()), key)


def make_list(authority: Signed, revoked: Iterable[tuple[int, datetime]], now: datetime) -> bytes:
    """Return the revocation list in PEM, from serial numbers with their times.

    It is valid as long as its authority. A list that expired earlier, without renewal, would lock out every
    controller.
    """
    issuer = authority.certificate
    builder = (
        x509.CertificateRevocationListBuilder()
        .issuer_name(issuer.subject)
        .last_update(now - SKEW)
        .next_update(issuer.not_valid_after_utc)
        .add_extension(_authority_key(issuer), critical=False)
        .add_extension(x509.CRLNumber(int(now.timestamp() * 1000)), critical=False)
    )
    for serial, when in revoked:
        entry = x509.RevokedCertificateBuilder().serial_number(serial).revocation_date(when).build()
        builder = builder.add_revoked_certificate(entry)
    return builder.sign(authority.key, hashes.SHA256()).public_bytes(Encoding.PEM)


def _builder(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePrivateKey,
    now: datetime,
    ends: datetime,
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(min(now, ends) - SKEW)
        .not_valid_after(ends)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )


def _name(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _authority_key(issuer: x509.Certificate) -> x509.AuthorityKeyIdentifier:
    own = issuer.extensions.get_extension_for_class(x509.SubjectKeyIdentifier).value
    return x509.AuthorityKeyIdentifier.from_issuer_subject_key_identifier(own)


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _usage(*, signs: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs,
        crl_sign=signs,
        encipher_only=False,
        decipher_only=False,
    )


AUTHORITY: Final = "ca"
LIST_NAME: Final = "crl.pem"
KEY_MODE: Final = 0o600
CERTIFICATE_MODE: Final = 0o644
FOLDER_MODE: Final = 0o700


class FolderError(Exception):
    """An action that is impossible in a folder, with the remedy."""


def found_authority(folder: Path, make: Callable[[], Signed], now: datetime) -> tuple[Path, ...]:
    """Write a new authority and its empty list; return the files.

    Raises:
        FolderError: an authority exists already, or the folder cannot be written.
    """
    try:
        folder.mkdir(mode=FOLDER_MODE, parents=True, exist_ok=True)
    except OSError as error:
        raise FolderError(f"{folder} cannot be made: {error.strerror or error}") from None
    _refuse_existing(folder, LIST_NAME)
    signed = make()
    files = _write_signed(folder, AUTHORITY, signed)
    _write_new(folder / LIST_NAME, make_list(signed, (), now), CERTIFICATE_MODE)
    return (*files, folder / LIST_NAME)


def read_authority(folder: Path, now: datetime) -> Signed:
    """Return the authority of a folder.

    Raises:
        FolderError: it does not exist, cannot be read, or has expired.
    """
    paths = folder / f"{AUTHORITY}.pem", folder / f"{AUTHORITY}.key"
    try:
        content, key_content = (read_regular_file(path, LARGEST_FILE, "an authority") for path in paths)
        certificate = x509.load_pem_x509_certificate(content)
        key = load_pem_private_key(key_content, None)
    except FileRefusedError as error:
        raise FolderError(
            f"{folder}: no authority ({paths[0].name}, {paths[1].name}): {error.found}; "
            f"make one with: pitch-gateway certificate ca {folder}"
        ) from None
    except (ValueError, TypeError) as error:
        raise FolderError(f"{folder}: its authority cannot be read: {error}") from None
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise FolderError(f"{paths[1]}: this command did not make this key; use the tool that made it")
    if certificate.not_valid_after_utc <= now:
        ended = day(certificate.not_valid_after_utc)
        raise FolderError(f"{paths[0]} expired on {ended}; make a new authority in another folder")
    return Signed(certificate, key)


def write_signed(folder: Path, name: str, signed: Signed) -> tuple[Path, Path]:
    """Write a certificate and its key as NAME.pem and NAME.key; return both files.

    Raises:
        OptionError: ``name`` is no name of files in the folder, or one of the authority's own.
        FolderError: one of them exists already, or cannot be written.
    """
    _check_name(name)
    return _write_signed(folder, name, signed)


def pem_of(signed: Signed) -> tuple[bytes, bytes]:
    """Return a certificate and its key, unencrypted, in PEM."""
    key = signed.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    return signed.certificate.public_bytes(Encoding.PEM), key


def _check_name(name: str) -> None:
    if not NAME.fullmatch(name) or name in (AUTHORITY, Path(LIST_NAME).stem):
        rule = "1 to 63 letters, digits, . - and _, beginning with a letter or digit; not ca or crl"
        raise OptionError("name", f"found {name!r}; allowed: {rule}")


def _write_signed(folder: Path, name: str, signed: Signed) -> tuple[Path, Path]:
    certificate, key = folder / f"{name}.pem", folder / f"{name}.key"
    for path in (certificate, key):
        _refuse_existing(folder, path.name)
    content, key_content = pem_of(signed)
    _write_new(key, key_content, KEY_MODE)
    try:
        _write_new(certificate, content, CERTIFICATE_MODE)
    except FolderError:
        key.unlink()
        raise
    return certificate, key


def revoke(folder: Path, name: str, now: datetime) -> Path:
    """Put a certificate into the list of the folder's authority; return the list.

    Raises:
        OptionError: ``name`` is no name of files in the folder, or one of the authority's own.
        FolderError: no such certificate, another authority, or revoked already.
    """
    _check_name(name)
    authority = read_authority(folder, now)
    path, list_path = folder / f"{name}.pem", folder / LIST_NAME
    try:
        certificate = x509.load_pem_x509_certificate(read_regular_file(path, LARGEST_FILE, "a certificate"))
        before = _revoked(list_path)
        certificate.verify_directly_issued_by(authority.certificate)
    except FileRefusedError as error:
        raise FolderError(f"{path}: {error}") from None
    except (ValueError, TypeError, InvalidSignature) as error:
        raise FolderError(f"{path}: not a certificate of the authority of {folder} ({error})") from None
    if certificate.serial_number in (serial for serial, _ in before):
        raise FolderError(f"{path}: is already in {list_path}")
    content = make_list(authority, [*before, (certificate.serial_number, now)], now)
    try:
        write_whole(list_path, content)
        list_path.chmod(CERTIFICATE_MODE)
    except OSError as error:
        raise FolderError(f"{list_path} cannot be written: {error.strerror or error}") from None
    return list_path


def _revoked(path: Path) -> list[tuple[int, datetime]]:
    if not path.exists():
        return []
    content = read_regular_file(path, LARGEST_FILE, "a list of revoked certificates")
    return [(each.serial_number, each.revocation_date_utc) for each in x509.load_pem_x509_crl(content)]


def _refuse_existing(folder: Path, name: str) -> None:
    if os.path.lexists(folder / name):
        raise FolderError(
            f"{folder / name} exists already and is not overwritten; move it away, or choose another name"
        )


def _write_new(path: Path, content: bytes, mode: int) -> None:
    try:
        descriptor = create(path, mode)
        with open(descriptor, "wb") as file:  # noqa: PTH123 - a descriptor
            os.fchmod(file.fileno(), mode)  # independent of the umask
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise FolderError(f"{path} cannot be written: {error.strerror or error}") from None


@dataclass(frozen=True, slots=True)
class FileContent:
    """The content of a file: certificates, or a list of revoked ones."""

    certificates: tuple[Facts, ...]
    now: datetime
    """Time of reading."""
    revoked: int | None = None
    """Number of revoked certificates; None: the file holds certificates."""
    until: datetime | None = None
    """End of the list's validity."""

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        if self.revoked is None:
            return {"certificates": [_as_data(each, self.now) for each in self.certificates]}
        return {"revoked": self.revoked, "until": None if self.until is None else self.until.isoformat()}

    def lines(self) -> Iterator[str]:
        """Yield it in words."""
        if self.revoked is not None:
            until = None if self.until is None else self.until.isoformat()
            yield f"a list of revoked certificates: {self.revoked}, valid until {str(until)[:10]}"
        for number, each in enumerate(self.certificates):
            if number:
                yield ""
            yield from _lines(each, self.now)


def read_file(path: Path, now: datetime) -> FileContent:
    """Return the content of a file.

    Raises:
        FileRefusedError: it cannot be read, or holds neither certificates nor a list of revoked ones.
    """
    try:
        return FileContent(tuple(read_facts(path)), now)
    except FileRefusedError as error:
        try:
            count, ends, _ = list_ends(path)
        except FileRefusedError:
            raise error from None
    return FileContent((), now, count, ends)


def _lines(facts: Facts, now: datetime) -> Iterator[str]:
    kind, left = _kind(facts), (facts.ends - now).days
    yield f"{kind}: {facts.subject}"
    if facts.role:
        yield f"  role    {facts.role}"
    elif kind == "controller":
        yield f"  role    none: {facts.why_no_role or None}"
    if facts.hosts:
        yield f"  hosts   {', '.join(facts.hosts)}"
    days = f"{left} days left" if left >= 0 else "expired"
    yield f"  valid   from {day(facts.begins)} until {day(facts.ends)} ({days})"
    yield f"  key     {facts.key}{', too weak: ' + facts.weakness if facts.weakness else ''}"
    yield f"  serial  {facts.serial}"
    yield f"  signed  by {facts.issuer}"


def _as_data(facts: Facts, now: datetime) -> JsonObject:
    return {
        "kind": _kind(facts),
        "subject": facts.subject,
        "role": facts.role or None,
        "why_no_role": facts.why_no_role or None,
        "hosts": list(facts.hosts),
        "from": facts.begins.isoformat(),
        "until": facts.ends.isoformat(),
        "days_left": (facts.ends - now).days,
        "key": facts.key,
        "weakness": facts.weakness or None,
        "serial": facts.serial,
        "issuer": facts.issuer,
    }


def _kind(facts: Facts) -> str:
    if facts.is_authority:
        return "authority"
    if facts.names_purpose and facts.is_for_servers:
        return "server"
    return "controller" if facts.is_for_clients else "certificate"
