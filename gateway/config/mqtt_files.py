"""The files that ``[mqtt]`` names: a password, certificates, a key."""

import os
import ssl
from pathlib import Path

from gateway.config.mqtt_model import TlsSection
from gateway.config.named_files import certificates_path, load_pair, no_certificates, read_secret_line

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
        raise no_certificates((*key, "ca"), str(tls.ca), error) from None
    if tls.cert is not None and tls.key is not None:
        load_pair(context, (*key, "cert"), (tls.cert, tls.key), folder)
    return context
