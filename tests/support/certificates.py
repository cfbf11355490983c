"""Certificates that are thrown away: made with the openssl command, and, for roles, with our own code."""

import shutil
import ssl
import subprocess
from collections.abc import Iterable
from datetime import timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID

from gateway.clock import now_utc
from gateway.commissioning.certificates import (
    SKEW,
    Signed,
    make_authority,
    make_controller,
    make_leaf,
    make_list,
    make_server,
    read_authority,
)


def openssl(*arguments: str) -> None:
    program = shutil.which("openssl")
    assert program, "openssl is not installed: apt-get install openssl"
    subprocess.run([program, *arguments], check=True, capture_output=True)


def authority(folder: Path, name: str) -> Path:
    """Make an authority; returns its certificate."""
    cert, key = folder / f"{name}.crt", folder / f"{name}.key"
    openssl(
        "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "100",
        "-subj", f"/CN={name}", "-addext", "keyUsage=critical,keyCertSign",
        "-keyout", str(key), "-out", str(cert),
    )  # fmt: skip
    return cert


def signed_by(folder: Path, signer: str, name: str, subject_alt_name: str) -> tuple[Path, Path]:
    """Make a certificate and its key."""
    cert, key, request = (folder / f"{name}.{kind}" for kind in ("crt", "key", "csr"))
    openssl(
        "req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes",
        "-subj", f"/CN={name}", "-keyout", str(key), "-out", str(request),
    )  # fmt: skip
    extension = folder / f"{name}.ext"
    extension.write_text(f"subjectAltName={subject_alt_name}\n")
    openssl(
        "x509", "-req", "-in", str(request), "-days", "100", "-CA", str(folder / f"{signer}.crt"),
        "-CAkey", str(folder / f"{signer}.key"), "-CAcreateserial", "-extfile", str(extension),
        "-out", str(cert),
    )  # fmt: skip
    return cert, key


class Shop:
    """An authority in a folder that signs whatever is asked for, good and bad."""

    def __init__(self, folder: Path, name: str = "ca", *, days: float = 100.0) -> None:
        self.folder = folder
        self.authority = make_authority(name, now_utc(), days)
        self.path = self._write(name, self.authority)[0]

    @classmethod
    def found(cls, folder: Path) -> "Shop":
        """Return the shop that a folder already has."""
        shop = cls.__new__(cls)
        shop.folder, shop.path = folder, folder / "ca.pem"
        shop.authority = read_authority(folder, now_utc())
        return shop

    def server(self, name: str = "server", *hosts: str) -> tuple[Path, Path]:
        """Make the certificate of a gateway and its key."""
        return self._write(name, make_server(self.authority, name, hosts or ("127.0.0.1",), now_utc()))

    def controller(self, name: str, role: str) -> tuple[Path, Path]:
        """Make the certificate of a controller with a role, and its key."""
        return self._write(name, make_controller(self.authority, name, role, now_utc()))

    def leaf(
        self,
        name: str,
        extensions: Iterable[x509.ExtensionType] = (),
        *,
        ended: timedelta = timedelta(),
        begins_in: timedelta = timedelta(),
        purpose: x509.ObjectIdentifier = ExtendedKeyUsageOID.CLIENT_AUTH,
    ) -> tuple[Path, Path]:
        """Make any certificate: with what is in it, ended some time ago, or not begun yet."""
        now = now_utc() + begins_in + (SKEW if begins_in else timedelta())
        days = -ended.total_seconds() / 86_400 if ended else 2.0
        return self._write(name, make_leaf(self.authority, name, [purpose], extensions, now, days=days))

    def revoke(self, *certificates: Path, ago: timedelta = timedelta()) -> Path:
        """Write the list of what was revoked, as it was some time ago."""
        now = now_utc() - ago
        serials = [x509.load_pem_x509_certificate(each.read_bytes()).serial_number for each in certificates]
        path = self.folder / "crl.pem"
        path.write_bytes(make_list(self.authority, [(one, now) for one in serials], now))
        return path

    def spoil(self, path: Path) -> None:
        """Put something else where a key or a certificate was."""
        path.write_text("nothing")

    def _write(self, name: str, signed: Signed) -> tuple[Path, Path]:
        certificate, key = self.folder / f"{name}.pem", self.folder / f"{name}.key"
        certificate.write_bytes(signed.certificate.public_bytes(Encoding.PEM))
        key.write_bytes(signed.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
        key.chmod(0o600)
        return certificate, key


def client_context(authority: Path, shown: tuple[Path, Path] | None) -> ssl.SSLContext:
    """Return what a controller connects with; ``shown`` None: it has no certificate."""
    context = ssl.create_default_context(cafile=str(authority))
    if shown is not None:
        context.load_cert_chain(*shown)
    return context
