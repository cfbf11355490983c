"""Files that a configuration names beside its tables: secrets and certificates."""

import os
from pathlib import Path
from typing import Final

from gateway.config.findings import Findings
from gateway.config.toml_lines import KeyPath
from gateway.files import FileRefusedError, read_regular_file
from gateway.secret_files import (
    CREDENTIAL,
    CREDENTIALS_FOLDER,
    is_credential_name,
    refuse_open_to_others,
    secret_path,
)

LARGEST_SECRET: Final = 4096
LARGEST_CERTIFICATES: Final = 4_000_000
"""Bytes. All authorities of a system are about 200 000."""


class NamedFileError(Exception):
    """A file that cannot be used: the key that names it, what was found and what to do; never its content."""

    def __init__(self, key: KeyPath, found: str, remedy: str) -> None:
        super().__init__(f"{'.'.join(map(str, key))}: {found}; {remedy}")
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
        read_regular_file(path, LARGEST_CERTIFICATES, "a file in PEM")
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


def why_unusable(error: OSError) -> str:
    """Return what OpenSSL, or the system, says of a file."""
    reason = getattr(error, "reason", None) or error.strerror or str(error)
    return str(reason).lower().replace("_", " ")
