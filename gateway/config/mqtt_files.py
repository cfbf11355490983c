"""The files that ``[mqtt]`` names: a password, certificates, a key."""

import os
import ssl
from pathlib import Path

from gateway.config.mqtt_model import TlsSection
from gateway.config.named_files import (
    NamedFileError,
    certificates_path,
    key_path,
    read_secret_line,
    why_unusable,
)

PASSWORD_KEY = ("mqtt", "password_file")


def read_password(name: str, folder: Path) -> str:
    """Return the password that is all a file holds; the end of its line does not count.

    Raises:
        NamedFileError: it cannot be read, every user may read it, or it holds anything else.
    """
    return read_secret_line(PASSWORD_KEY, name, folder, "password")


def tls_context(tls: TlsSection, folder: Path) -> ssl.SSLContext:
    """Return what a client needs to trust a broker, and to be trusted. Reads files: it may block.

    Raises:
        NamedFileError: a file is missing, is something else, every user may read the key, or it is not that
            of the certificate.
    """
    key = ("mqtt", "tls")
    # Without a name of our own the system's authorities hold; a file that is named replaces them.
    authorities = None if tls.ca is None else certificates_path((*key, "ca"), tls.ca, folder)
    try:
        context = ssl.create_default_context(cafile=None if authorities is None else os.fspath(authorities))
    except (ssl.SSLError, OSError) as error:
        found, remedy = (
            f"{tls.ca}: no certificates ({why_unusable(error)})",
            "give a file with certificates in PEM",
        )
        raise NamedFileError((*key, "ca"), found, remedy) from None
    if tls.cert is not None and tls.key is not None:
        certificate = certificates_path((*key, "cert"), tls.cert, folder)
        private_key = key_path((*key, "key"), tls.key, folder)
        try:
            # OpenSSL would ask a terminal for the password of an encrypted key.
            context.load_cert_chain(certificate, private_key, password=lambda: "")
        except (ssl.SSLError, OSError) as error:
            raise NamedFileError(
                (*key, "cert"),
                f"{tls.cert} and {tls.key} cannot be used together ({why_unusable(error)})",
                "give a certificate and its own key, both in PEM, the key not encrypted",
            ) from None
    return context
