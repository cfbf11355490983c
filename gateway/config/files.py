"""Files that a configuration names: passwords, tokens and certificates."""

import os
import re
import ssl
from datetime import datetime
from pathlib import Path
from typing import Final

from gateway.config.findings import Findings
from gateway.config.http_model import HttpTlsSection
from gateway.config.mqtt_model import TlsSection
from gateway.config.problems import key_text
from gateway.config.toml import KeyPath
from gateway.files import FileRefusedError, read_regular_file
from gateway.secret_files import (
    CREDENTIAL,
    CREDENTIALS_FOLDER,
    is_credential_name,
    refuse_open_to_others,
    secret_path,
)
from gateway.transport.certificates import (
    TlsFileError,
    list_ends,
    list_problem,
    read_facts,
    time_problem,
)
from gateway.transport.tls import bare_server_context, check_pem, load_revoked, reason_of

# --- Files that a configuration names beside its tables: secrets and certificates

LARGEST_SECRET: Final = 4096


class NamedFileError(Exception):
    """A file that cannot be used: the key that names it, what was found and what to do; never its content."""

    def __init__(self, key: KeyPath, found: str, remedy: str) -> None:
        super().__init__(f"{key_text(key)}: {found}; {remedy}")
        self.key = key
        self.found = found
        self.remedy = remedy


def is_out_of_reach(name: str) -> bool:
    """Whether a file is a credential that this process did not get: only the service can read it.

    A name that no credential can have returns False: it is refused everywhere.
    """
    if not name.startswith(CREDENTIAL) or not is_credential_name(name):
        return False
    handed_over = os.environ.get(CREDENTIALS_FOLDER)
    if not handed_over:
        return True
    try:
        (Path(handed_over) / name.removeprefix(CREDENTIAL)).stat()
    except FileNotFoundError:
        return True
    except OSError:
        pass  # passed to this process; reading it reports what is wrong
    return False


def warn_out_of_reach(findings: Findings, key: KeyPath, name: str) -> None:
    """Warn that a credential was not checked."""
    findings.warn(
        key,
        f"{name} was not checked: only the service receives it",
        f"give it with LoadCredential={name.removeprefix(CREDENTIAL)}:PATH in the unit of the supervisor",
    )


def path_of(key: KeyPath, name: str, folder: Path) -> Path:
    """Return the path of the file that ``key`` names, relative to ``folder`` or as a credential.

    Raises:
        NamedFileError: a credential that this process did not get.
    """
    try:
        return secret_path(name, folder)
    except FileRefusedError as error:
        raise NamedFileError(key, error.found, error.remedy) from None


def read_secret_line(key: KeyPath, name: str, folder: Path, what: str) -> str:
    """Return the one line in a secret's file, without its line end.

    Raises:
        NamedFileError: it cannot be read, every user may read it, or it holds anything else.
    """
    path = path_of(key, name, folder)
    try:
        refuse_open_to_others(path)
        content = read_regular_file(path, LARGEST_SECRET, f"a file with the {what}")
    except FileRefusedError as error:
        raise NamedFileError(key, f"{path}: {error.found}", error.remedy) from None
    try:
        secret = content.decode().rstrip("\r\n")
    except UnicodeDecodeError:
        raise NamedFileError(key, f"{path}: not UTF-8", "save it as UTF-8 text") from None
    if not secret or any(character in secret for character in "\r\n\0"):
        found = "empty" if not secret else "more than one line"
        remedy = f"write only the {what} into it, on one line"
        raise NamedFileError(key, f"{path}: {found}", remedy)
    return secret


def pem_path(key: KeyPath, name: str, folder: Path) -> Path:
    """Return the path of a readable PEM file; a private key must not be readable by every user.

    Raises:
        NamedFileError: it is missing, not a regular file, or every user may read the key.
    """
    path = path_of(key, name, folder)
    try:
        check_pem(str(key[-1]), path)
    except TlsFileError as error:
        raise NamedFileError(key, error.found, error.remedy) from None
    return path


def load_pair(context: ssl.SSLContext, key: KeyPath, names: tuple[str, str], folder: Path) -> None:
    """Load a certificate and its key into a context; ``names`` are the two files, ``key`` names the first.

    Raises:
        NamedFileError: a file cannot be read, every user may read the key, or the two do not match.
    """
    certificate = pem_path(key, names[0], folder)
    private_key = pem_path((*key[:-1], "key"), names[1], folder)
    try:
        # OpenSSL would ask on the terminal for the password of an encrypted key.
        context.load_cert_chain(certificate, private_key, password=lambda: "")
    except (ssl.SSLError, OSError) as error:
        raise NamedFileError(
            key,
            f"{names[0]} and {names[1]} cannot be used together ({reason_of(error)})",
            "give a certificate and its own key, both in PEM, the key not encrypted",
        ) from None


def no_certificates(key: KeyPath, name: str, error: OSError) -> NamedFileError:
    """Return the error for a file of authorities that OpenSSL refuses."""
    found = f"{name}: no certificates ({reason_of(error)})"
    return NamedFileError(key, found, "give a file with certificates in PEM")


# --- The files that ``[http]`` names: tokens, a certificate with its key, client authorities

SHORTEST_TOKEN: Final = 32
FEWEST_CHARACTERS: Final = 8
"""Different ones. 32 random hexadecimal digits usually have 14 and hardly ever fewer than 9. A letter that
was held down has one."""
_TOKEN: Final = re.compile(rf"[A-Za-z0-9._~+/=-]{{{SHORTEST_TOKEN},512}}")
TLS_KEY: Final = ("http", "tls")


def read_token(key: KeyPath, name: str, folder: Path) -> str:
    """Return the token that is the whole content of a file.

    Raises:
        NamedFileError: it cannot be read, every user may read it, or the token is not random enough.
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
    """Return the TLS context of the page. Reads files: it may block.

    ``needs_client``: a client without a certificate is refused in the handshake.

    Raises:
        NamedFileError: a file is missing or of another kind, every user may read the key, or it does not
            match the certificate.
    """
    context = bare_server_context()
    load_pair(context, (*TLS_KEY, "certificate"), (tls.certificate, tls.key), folder)
    if tls.clients is not None:
        _trust(context, pem_path((*TLS_KEY, "clients"), tls.clients, folder), tls.clients)
        context.verify_mode = ssl.CERT_REQUIRED if needs_client else ssl.CERT_OPTIONAL
    if tls.revoked is not None:
        _load_revocations(context, pem_path((*TLS_KEY, "revoked"), tls.revoked, folder))
    return context


def _trust(context: ssl.SSLContext, authorities: Path, name: str) -> None:
    try:
        context.load_verify_locations(os.fspath(authorities))
    except (ssl.SSLError, OSError) as error:
        raise no_certificates((*TLS_KEY, "clients"), name, error) from None


def _load_revocations(context: ssl.SSLContext, revoked: Path) -> None:
    try:
        load_revoked(context, revoked)
    except TlsFileError as error:
        raise NamedFileError((*TLS_KEY, "revoked"), error.found, error.remedy) from None


# --- The files that ``[mqtt]`` names: a password, certificates, a key

PASSWORD_KEY = ("mqtt", "password_file")


def read_password(name: str, folder: Path) -> str:
    """Return the password that is the whole content of a file, without its line end.

    Raises:
        NamedFileError: it cannot be read, every user may read it, or it holds anything else.
    """
    return read_secret_line(PASSWORD_KEY, name, folder, "password")


def tls_context(tls: TlsSection, folder: Path) -> ssl.SSLContext:
    """Return the TLS context of an MQTT client. Reads files: it may block.

    Raises:
        NamedFileError: a file is missing or of another kind, every user may read the key, or it does not
            match the certificate.
    """
    key = ("mqtt", "tls")
    # If no file is named, the system's authorities apply; a named file replaces them.
    authorities = None if tls.ca is None else pem_path((*key, "ca"), tls.ca, folder)
    try:
        context = ssl.create_default_context(cafile=None if authorities is None else os.fspath(authorities))
    except (ssl.SSLError, OSError) as error:
        raise no_certificates((*key, "ca"), str(tls.ca), error) from None
    if tls.cert is not None and tls.key is not None:
        load_pair(context, (*key, "cert"), (tls.cert, tls.key), folder)
    return context


# --- Warnings for certificates that are not valid, or not for long


def warn_of_times(findings: Findings, key: KeyPath, path: Path, now: datetime) -> None:
    """Warn of every certificate of a loadable file that is not valid, or not for long.

    It is only a warning: clients or the broker refuse such a certificate, but axes are still corrected.
    """
    try:
        certificates = read_facts(path)
    except FileRefusedError as error:
        findings.warn(key, f"{path}: its last day could not be read ({error.found})", error.remedy)
        return
    for facts in certificates:
        problem = time_problem(facts, now)
        if problem is not None:
            findings.warn(key, problem.found, problem.remedy)


def warn_of_list(findings: Findings, key: KeyPath, path: Path, now: datetime) -> None:
    """Warn of a revocation list that has expired or expires soon: then every client is refused."""
    try:
        _, ends, _ = list_ends(path)
    except FileRefusedError as error:
        findings.warn(key, f"{path}: its last day could not be read ({error.found})", error.remedy)
        return
    problem = list_problem(str(path), ends, now)
    if problem is not None:
        findings.warn(key, problem.found, problem.remedy)
