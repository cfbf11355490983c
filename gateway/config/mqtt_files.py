"""The files that ``[mqtt]`` names: a password, certificates, a key."""

import os
import ssl
import stat
from pathlib import Path
from typing import Final

from gateway.config.mqtt_model import TlsSection
from gateway.files import FileRefusedError, read_regular_file

LARGEST_PASSWORD: Final = 4096
LARGEST_CERTIFICATES: Final = 4_000_000
"""Bytes. All authorities of a system are about 200 000."""


class MqttFileError(Exception):
    """A file that cannot be used: the key that names it, what was found and what to do; never its content."""

    def __init__(self, key: tuple[str, ...], found: str, remedy: str) -> None:
        super().__init__(f"{'.'.join(key)}: {found}; {remedy}")
        self.key = key
        self.found = found
        self.remedy = remedy


def read_password(path: Path) -> str:
    """Return the password that is all a file holds; the end of its line does not count.

    Raises:
        MqttFileError: it cannot be read, or holds anything else.
    """
    key = ("mqtt", "password_file")
    try:
        content = read_regular_file(path, LARGEST_PASSWORD, "a file with the password")
    except FileRefusedError as error:
        raise MqttFileError(key, f"{path}: {error.found}", error.remedy) from None
    try:
        password = content.decode().rstrip("\r\n")
    except UnicodeDecodeError:
        raise MqttFileError(key, f"{path}: not UTF-8", "save it as UTF-8 text") from None
    if not password or any(character in password for character in "\r\n\0"):
        found = "empty" if not password else "more than one line"
        raise MqttFileError(
            key, f"{path}: {found}", "write the password into it, on one line, and nothing else"
        )
    return password


def may_be_read_by_others(path: Path) -> str | None:
    """Return the mode of a file that every user of the machine may read, else None."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return None
    return f"{stat.S_IMODE(mode):04o}" if mode & stat.S_IROTH else None


def tls_context(tls: TlsSection, folder: Path) -> ssl.SSLContext:
    """Return what a client needs to trust a broker, and to be trusted. Reads files: it may block.

    Raises:
        MqttFileError: a file is missing, is something else, or the key is not that of the certificate.
    """
    for name in ("ca", "cert", "key"):
        named = getattr(tls, name)
        if named is not None:
            _check_readable(("mqtt", "tls", name), folder / named)
    try:
        # Without a name of our own the system's authorities hold; a file that is named replaces them.
        context = ssl.create_default_context(cafile=None if tls.ca is None else os.fspath(folder / tls.ca))
    except (ssl.SSLError, OSError) as error:
        key, remedy = ("mqtt", "tls", "ca"), "give a file with certificates in PEM"
        raise MqttFileError(key, f"{tls.ca}: no certificates ({_reason(error)})", remedy) from None
    if tls.cert is not None and tls.key is not None:
        try:
            # OpenSSL would ask a terminal for the password of an encrypted key.
            context.load_cert_chain(folder / tls.cert, folder / tls.key, password=lambda: "")
        except (ssl.SSLError, OSError) as error:
            raise MqttFileError(
                ("mqtt", "tls", "cert"),
                f"{tls.cert} and {tls.key} cannot be used together ({_reason(error)})",
                "give a certificate and its own key, both in PEM, the key not encrypted",
            ) from None
    return context


def _check_readable(key: tuple[str, ...], path: Path) -> None:
    try:
        read_regular_file(path, LARGEST_CERTIFICATES, "a file in PEM")
    except FileRefusedError as error:
        raise MqttFileError(key, f"{path}: {error.found}", error.remedy) from None


def _reason(error: OSError) -> str:
    reason = getattr(error, "reason", None) or error.strerror or str(error)
    return str(reason).lower().replace("_", " ")
