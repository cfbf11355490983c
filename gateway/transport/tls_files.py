"""The files that Modbus/TCP Security needs on a listener. Light: every plan has this module loaded."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.files import FileRefusedError
from gateway.secret_files import secret_path

LARGEST_FILE: Final = 4_000_000
"""Bytes. A list of revoked certificates may be long."""


class TlsFileError(Exception):
    """A file that TLS cannot be had with: the key that names it, what was found, what to do; no content."""

    def __init__(self, key: str, found: str, remedy: str) -> None:
        super().__init__(f"{key}: {found}; {remedy}")
        self.key = key
        self.found = found
        self.remedy = remedy


@dataclass(frozen=True, slots=True)
class TlsFiles:
    """Paths from the root; ``key`` may be ``credential:NAME``. ``revoked`` "": no list is looked at."""

    certificate: str
    key: str
    clients: str
    revoked: str = ""

    @property
    def paths(self) -> dict[str, Path]:
        """Where they are, each by the key that names it.

        Raises:
            TlsFileError: a credential, and none were handed over.
        """
        names = {"certificate": self.certificate, "clients": self.clients, "revoked": self.revoked}
        paths = {key: Path(name) for key, name in names.items() if name}
        try:
            return {**paths, "key": secret_path(self.key, Path())}
        except FileRefusedError as error:
            raise TlsFileError("key", error.found, error.remedy) from None
