"""Files that a configuration names beside its tables: secrets and certificates."""

import os
import ssl
from pathlib import Path
from typing import Final

from gateway.config.findings import Findings
from gateway.config.problems import key_text
from gateway.config.toml_lines import KeyPath
from gateway.files import FileRefusedError, read_regular_file
from gateway.secret_files import (
    CREDENTIAL,
    CREDENTIALS_FOLDER,
    is_credential_name,
    refuse_open_to_others,
    secret_path,
)
from gateway.transport.tls import reason_of
from gateway.transport.tls_files import LARGEST_FILE

LARGEST_SECRET: Final = 4096


class NamedFileError(Exception):
    """A file that cannot be used: the key that names it, what was found and what to do; never its content."""

    def __init__(self, key: KeyPath, found: str, remedy: str) -> None:
        super().__init__(f"{key_text(key)}: {found}; {remedy}")
        self.key = key
        self.found = found
        self.remedy = remedy


def is_out_of_reach(name: str) -> bool:
    """Whether a file is a credential that this process was not given: only a service that was can look.

    A name that no credential can have is not: it is refused everywhere.
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
        pass  # handed over, and what is wrong with it is said when it is read
    return False


def warn_out_of_reach(findings: Findings, key: KeyPath, name: str) -> None:
    """Say that a credential was not looked at."""
    findings.warn(
        key,
        f"{name} was not looked at: only the service that is given it can",
        f"give it with LoadCredential={name.removeprefix(CREDENTIAL)}:PATH in the unit of the supervisor",
    )


def path_of(key: KeyPath, name: str, folder: Path) -> Path:
    """Return the path of a file that the key at ``key`` names, relative to ``folder`` or a credential.

    Raises:
        NamedFileError: a credential that was not handed over.
    """
    try:
        return secret_path(name, folder)
    except FileRefusedError as error:
        raise NamedFileError(key, error.found, error.remedy) from None


def read_secret_line(key: KeyPath, name: str, folder: Path, what: str) -> str:
    """Return the one line that a secret's file holds; the end of the line does not count.

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
        remedy = f"write the {what} into it, on one line, and nothing else"
        raise NamedFileError(key, f"{path}: {found}", remedy)
    return secret


def certificates_path(key: KeyPath, name: str, folder: Path) -> Path:
    """Return the path of a file in PEM that can be read.

    Raises:
        NamedFileError: it cannot.
    """
    path = path_of(key, name, folder)
    try:
        read_regular_file(path, LARGEST_FILE, "a file in PEM")
    except FileRefusedError as error:
        raise NamedFileError(key, f"{path}: {error.found}", error.remedy) from None
    return path


def key_path(key: KeyPath, name: str, folder: Path) -> Path:
    """Return the path of a private key that can be read, and not by every user.

    Raises:
        NamedFileError: it is missing, no regular file, or every user may read it.
    """
    path = certificates_path(key, name, folder)
    try:
        refuse_open_to_others(path)
    except FileRefusedError as error:
        raise NamedFileError(key, f"{path}: {error.found}", error.remedy) from None
    return path


def load_pair(context: ssl.SSLContext, key: KeyPath, names: tuple[str, str], folder: Path) -> None:
    """Have a context show a certificate; ``names`` are those of it and of its key, ``key`` names the first.

    Raises:
        NamedFileError: one of them cannot be read, every user may read the key, or they do not belong
            together.
    """
    certificate = certificates_path(key, names[0], folder)
    private_key = key_path((*key[:-1], "key"), names[1], folder)
    try:
        # OpenSSL would ask a terminal for the password of an encrypted key.
        context.load_cert_chain(certificate, private_key, password=lambda: "")
    except (ssl.SSLError, OSError) as error:
        raise NamedFileError(
            key,
            f"{names[0]} and {names[1]} cannot be used together ({reason_of(error)})",
            "give a certificate and its own key, both in PEM, the key not encrypted",
        ) from None


def no_certificates(key: KeyPath, name: str, error: OSError) -> NamedFileError:
    """Return what is said of a file of authorities that OpenSSL does not take."""
    found = f"{name}: no certificates ({reason_of(error)})"
    return NamedFileError(key, found, "give a file with certificates in PEM")
