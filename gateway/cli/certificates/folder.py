"""A folder with an authority and what it has signed. Nothing in it is ever overwritten, but its list."""

import os
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)

from gateway.cli.certificates.making import Signed, make_list
from gateway.files import FileRefusedError, read_regular_file
from gateway.state.folder import write_whole

AUTHORITY: Final = "ca"
LIST_NAME: Final = "crl.pem"
LARGEST: Final = 4_000_000
"""Bytes."""
KEY_MODE: Final = 0o600
CERTIFICATE_MODE: Final = 0o644
FOLDER_MODE: Final = 0o700


class FolderError(Exception):
    """What cannot be done in a folder, and what to do about it."""


def found_authority(folder: Path, make: Callable[[], Signed], now: datetime) -> tuple[Path, ...]:
    """Write a new authority and its list, in which nothing is; returns the files.

    Raises:
        FolderError: there is one already, or the folder cannot be written.
    """
    try:
        folder.mkdir(mode=FOLDER_MODE, parents=True, exist_ok=True)
    except OSError as error:
        raise FolderError(f"{folder} cannot be made: {error.strerror or error}") from None
    _refuse_existing(folder, LIST_NAME)
    signed = make()
    files = write_signed(folder, AUTHORITY, signed)
    _write_new(folder / LIST_NAME, make_list(signed, (), now), CERTIFICATE_MODE)
    return (*files, folder / LIST_NAME)


def read_authority(folder: Path, now: datetime) -> Signed:
    """Return the authority of a folder.

    Raises:
        FolderError: there is none, it cannot be read, or it has expired.
    """
    paths = folder / f"{AUTHORITY}.pem", folder / f"{AUTHORITY}.key"
    try:
        content, key_content = (read_regular_file(path, LARGEST, "an authority") for path in paths)
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
        raise FolderError(f"{paths[1]}: not a key that this command made; use the tool that made it")
    if certificate.not_valid_after_utc <= now:
        ended = certificate.not_valid_after_utc.date().isoformat()
        raise FolderError(f"{paths[0]} expired on {ended}; make a new authority in another folder")
    return Signed(certificate, key)


def write_signed(folder: Path, name: str, signed: Signed) -> tuple[Path, Path]:
    """Write a certificate and its key; returns both files.

    Raises:
        FolderError: one of them is there already, or cannot be written.
    """
    certificate, key = folder / f"{name}.pem", folder / f"{name}.key"
    for path in (certificate, key):
        _refuse_existing(folder, path.name)
    content = signed.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    _write_new(key, content, KEY_MODE)
    try:
        _write_new(certificate, signed.certificate.public_bytes(Encoding.PEM), CERTIFICATE_MODE)
    except FolderError:
        key.unlink()
        raise
    return certificate, key


def revoke(folder: Path, name: str, now: datetime) -> Path:
    """Put a certificate into the list of the folder's authority; returns the list.

    Raises:
        FolderError: no such certificate, not of this authority, or in the list already.
    """
    authority = read_authority(folder, now)
    path, list_path = folder / f"{name}.pem", folder / LIST_NAME
    try:
        certificate = x509.load_pem_x509_certificate(read_regular_file(path, LARGEST, "a certificate"))
        before = _revoked(list_path)
        certificate.verify_directly_issued_by(authority.certificate)
    except FileRefusedError as error:
        raise FolderError(f"{path}: {error}") from None
    except (ValueError, TypeError, InvalidSignature) as error:
        raise FolderError(f"{path}: not a certificate of the authority of {folder} ({error})") from None
    if certificate.serial_number in (serial for serial, _ in before):
        raise FolderError(f"{path}: is in {list_path} already")
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
    content = read_regular_file(path, LARGEST, "a list of revoked certificates")
    return [(each.serial_number, each.revocation_date_utc) for each in x509.load_pem_x509_crl(content)]


def _refuse_existing(folder: Path, name: str) -> None:
    if os.path.lexists(folder / name):
        raise FolderError(
            f"{folder / name} exists already, and is not overwritten; move it away, or take another name"
        )


def _write_new(path: Path, content: bytes, mode: int) -> None:
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode)
        with open(descriptor, "wb") as file:  # noqa: PTH123 - a descriptor
            os.fchmod(file.fileno(), mode)  # whatever the umask takes away or leaves
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise FolderError(f"{path} cannot be written: {error.strerror or error}") from None
