"""An authority, and what it signs: certificates of gateways and controllers, lists of revoked ones.

P-256 throughout: a handshake with it costs less than one with RSA of 2048 bits and a fifth of one with 4096,
and everything that speaks TLS 1.2 knows it.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from ipaddress import ip_address
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from gateway.transport.certificates import ROLE_OID, write_role

AUTHORITY_DAYS: Final = 3650
LEAF_DAYS: Final = 825
"""What operating systems and browsers took at most when these rules were made; a year more than most need."""
SKEW: Final = timedelta(hours=1)
"""A certificate is good a little before it was made: clocks of machines differ."""


@dataclass(frozen=True, slots=True)
class Signed:
    """A certificate with its key."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey


def make_authority(name: str, now: datetime, days: float = AUTHORITY_DAYS) -> Signed:
    """Make an authority that signs itself."""
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
    """Make the certificate of a gateway that is reached by ``hosts``, names or addresses."""
    names = x509.SubjectAlternativeName([_general_name(host) for host in hosts])
    return make_leaf(authority, name, [ExtendedKeyUsageOID.SERVER_AUTH], [names], now)


def make_controller(authority: Signed, name: str, role: str, now: datetime) -> Signed:
    """Make the certificate of a controller with a role."""
    return make_leaf(authority, name, [ExtendedKeyUsageOID.CLIENT_AUTH], [role_extension(role)], now)


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
    """Make a certificate that may sign nothing; it never outlives its authority."""
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
    """Return a list of serials that were revoked, each with when, in PEM.

    It is good as long as its authority: one that ended sooner, and that nobody renewed in time, would lock
    every controller out.
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
