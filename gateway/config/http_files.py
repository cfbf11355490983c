"""The files that ``[http]`` names: tokens, a certificate with its key, authorities of clients."""

import os
import re
import ssl
from pathlib import Path
from typing import Final

from gateway.config.http_model import HttpTlsSection
from gateway.config.named_files import (
    NamedFileError,
    certificates_path,
    load_pair,
    no_certificates,
    path_of,
    read_secret_line,
)
from gateway.config.toml_lines import KeyPath
from gateway.transport.tls import CIPHERS, load_revoked
from gateway.transport.tls_files import TlsFileError

SHORTEST_TOKEN: Final = 32
FEWEST_CHARACTERS: Final = 8
"""Different ones. Of 32 random hexadecimal digits there are 14 as a rule, and hardly ever fewer than 9; a
letter that was held down has one."""
_TOKEN: Final = re.compile(rf"[A-Za-z0-9._~+/=-]{{{SHORTEST_TOKEN},512}}")
TLS_KEY: Final = ("http", "tls")


def read_token(key: KeyPath, name: str, folder: Path) -> str:
    """Return the token that is all a file holds.

    Raises:
        NamedFileError: it cannot be read, every user may read it, or nobody would call that random.
    """
    token = read_secret_line(key, name, folder, "token")
    if not _TOKEN.fullmatch(token) or len(set(token)) < FEWEST_CHARACTERS:
        raise NamedFileError(
            key,
            f"{name} holds no {SHORTEST_TOKEN} random characters or more (A-Z a-z 0-9 . _ ~ + / = -)",
            f"make one with pitch-gateway token {path_of(key, name, folder)} --force",
        )
    return token


def server_context(tls: HttpTlsSection, folder: Path, *, needs_client: bool) -> ssl.SSLContext:
    """Return what the page needs to speak TLS. Reads files: it may block.

    ``needs_client``: whoever has no certificate is not even answered.

    Raises:
        NamedFileError: a file is missing, is something else, every user may read the key, or it is not that
            of the certificate.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.set_ciphers(CIPHERS)
    # Without tickets: who is let in is decided anew each time, and a certificate may have ended since.
    context.options |= ssl.OP_NO_RENEGOTIATION | ssl.OP_NO_COMPRESSION | ssl.OP_NO_TICKET
    context.num_tickets = 0
    load_pair(context, (*TLS_KEY, "certificate"), (tls.certificate, tls.key), folder)
    if tls.clients is not None:
        _trust(context, certificates_path((*TLS_KEY, "clients"), tls.clients, folder), tls.clients)
        context.verify_mode = ssl.CERT_REQUIRED if needs_client else ssl.CERT_OPTIONAL
    if tls.revoked is not None:
        _turn_away(context, certificates_path((*TLS_KEY, "revoked"), tls.revoked, folder))
    return context


def _trust(context: ssl.SSLContext, authorities: Path, name: str) -> None:
    try:
        context.load_verify_locations(os.fspath(authorities))
    except (ssl.SSLError, OSError) as error:
        raise no_certificates((*TLS_KEY, "clients"), name, error) from None


def _turn_away(context: ssl.SSLContext, revoked: Path) -> None:
    try:
        load_revoked(context, revoked)
    except TlsFileError as error:
        raise NamedFileError((*TLS_KEY, "revoked"), error.found, error.remedy) from None
