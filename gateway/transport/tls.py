"""The TLS of a listener: TLS 1.2 or newer, forward secrecy and authenticated encryption only."""

import os
import ssl
from collections.abc import Callable
from pathlib import Path
from typing import Final

from gateway.files import FileRefusedError, mark_of, read_regular_file
from gateway.secret_files import refuse_open_to_others
from gateway.transport.certificates import LARGEST_FILE, CertificateInForce, TlsFileError, TlsFiles, read_held

MOST_SESSIONS: Final = 64
"""OpenSSL keeps every session of TLS 1.2 for two hours, about 16 KiB each, and Python cannot switch that off.
A context with this many sessions is replaced by a new one."""
CIPHERS: Final = "ECDHE+AESGCM:ECDHE+CHACHA20"
"""For TLS 1.2; all ciphers of 1.3 are of this kind."""


def bare_server_context() -> ssl.SSLContext:
    """Return the context for any listener of the gateway, without certificates yet."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.set_ciphers(CIPHERS)
    # A client that resumes an old session is not checked again. For TLS 1.2 that cannot be switched off: such
    # a session is valid as long as its context, and new files make a new context.
    context.options |= ssl.OP_NO_RENEGOTIATION | ssl.OP_NO_COMPRESSION | ssl.OP_NO_TICKET
    context.num_tickets = 0
    return context


# --- Modbus/TCP Security


def server_context(files: TlsFiles) -> ssl.SSLContext:
    """Return the context of a controller's listener; a certificate is required. It reads files and may block.

    Raises:
        TlsFileError: a file is missing or of another kind, or a key is encrypted, open to others, or does not
            match.
    """
    paths = files.paths
    for key, path in paths.items():
        check_pem(key, path)
    context = bare_server_context()
    context.verify_mode = ssl.CERT_REQUIRED
    _load_own(context, paths)
    _load_clients(context, paths)
    return context


class ServerContexts:
    """The context of a listener, made again when its files change; a bad change keeps the last good one.

    Not for the loop: :meth:`current` reads files.
    """

    def __init__(
        self,
        files: TlsFiles,
        on_renewed: Callable[[], object],
        on_refused: Callable[[TlsFileError], object],
    ) -> None:
        self._files = files
        self._on_renewed = on_renewed
        self._on_refused = on_refused
        self._context: ssl.SSLContext | None = None
        self._seen: object = None
        self.held: tuple[CertificateInForce, ...] = ()
        """The content of the context's files, with the validity."""

    def open(self) -> None:
        """Make the first one.

        Raises:
            TlsFileError: as :func:`server_context`.
        """
        self._seen = self._file_states()
        self._context = server_context(self._files)
        self.held = read_held(self._files.paths)

    def current(self) -> ssl.SSLContext:
        """Return the context for a new connection."""
        assert self._context is not None, "opened first"
        seen = self._file_states()
        is_new, self._seen = seen != self._seen, seen
        if is_new or self._context.session_stats()["number"] >= MOST_SESSIONS:
            try:
                self._context = server_context(self._files)
            except TlsFileError as error:
                if is_new:
                    self._on_refused(error)
            else:
                if is_new:
                    self.held = read_held(self._files.paths)
                    self._on_renewed()
        return self._context

    def _file_states(self) -> object:
        try:
            paths = self._files.paths
        except TlsFileError as error:
            return str(error)
        return tuple(map(_file_state, paths.values()))


def _file_state(path: Path) -> object:
    try:
        status = path.stat()
    except OSError as error:
        return error.errno
    return mark_of(status), status.st_mode


def check_pem(key: str, path: Path) -> None:
    """Check that a PEM file can be read; the file of ``key`` not by every user.

    Raises:
        TlsFileError: it cannot be read, or every user may read the key.
    """
    try:
        read_regular_file(path, LARGEST_FILE, "a file in PEM")
        if key == "key":
            refuse_open_to_others(path)
    except FileRefusedError as error:
        raise TlsFileError(key, f"{path}: {error.found}", error.remedy) from None


def _load_own(context: ssl.SSLContext, paths: dict[str, Path]) -> None:
    is_encrypted = False

    def password() -> str:  # OpenSSL would ask a terminal for it
        nonlocal is_encrypted
        is_encrypted = True
        return ""

    try:
        context.load_cert_chain(paths["certificate"], paths["key"], password=password)
    except (ssl.SSLError, OSError) as error:
        if is_encrypted:
            raise TlsFileError(
                "key",
                f"{paths['key']}: the key is encrypted",
                "give it without a password, as openssl pkey writes it, readable by this user only",
            ) from None
        if "mismatch" in reason_of(error):
            raise TlsFileError(
                "key",
                f"{paths['key']} is not the key of {paths['certificate']}",
                "give the key that the certificate was made for",
            ) from None
        raise TlsFileError(
            "certificate",
            f"{paths['certificate']} and {paths['key']} cannot be used ({reason_of(error)})",
            "give a certificate, followed by the intermediate ones, and its own key, both in PEM",
        ) from None


def _load_clients(context: ssl.SSLContext, paths: dict[str, Path]) -> None:
    try:
        context.load_verify_locations(os.fspath(paths["clients"]))
    except (ssl.SSLError, OSError) as error:
        found = f"{paths['clients']}: no certificates ({reason_of(error)})"
        raise TlsFileError("clients", found, "give the authority's certificate in PEM") from None
    if "revoked" in paths:
        load_revoked(context, paths["revoked"])


def load_revoked(context: ssl.SSLContext, path: Path) -> None:
    """Make a context refuse the certificates of a revocation list, and all once the list has expired.

    Raises:
        TlsFileError: it is no such list.
    """
    lists_before = context.cert_store_stats()["crl"]
    try:
        context.load_verify_locations(os.fspath(path))
    except (ssl.SSLError, OSError) as error:
        found = f"{path}: not a list of revoked certificates ({reason_of(error)})"
        raise TlsFileError("revoked", found, "give the authority's list (CRL) in PEM") from None
    if context.cert_store_stats()["crl"] == lists_before:
        found = f"{path}: not a list of revoked certificates"
        raise TlsFileError("revoked", found, "give the authority's list (CRL) in PEM")
    context.verify_flags |= ssl.VERIFY_CRL_CHECK_LEAF


def reason_of(error: OSError) -> str:
    """Return the reason of an OpenSSL or system error in plain words."""
    reason = getattr(error, "reason", None) or error.strerror or str(error)
    return str(reason).lower().replace("_", " ")
