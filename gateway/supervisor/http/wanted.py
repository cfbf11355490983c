"""Where the page is wanted, and for whom: what a configuration says, with the files that it names."""

import ssl
from dataclasses import dataclass
from pathlib import Path

from gateway.config.files import TLS_KEY, NamedFileError, path_of, server_context
from gateway.config.http_model import HttpSection, HttpTlsSection, TokenSection
from gateway.transport.certificate_ends import Held, read_held
from gateway.transport.endpoints import TcpEndpoint


@dataclass(frozen=True, slots=True)
class Wanted:
    """Two that are equal need nothing to be done."""

    endpoint: TcpEndpoint
    tokens: tuple[TokenSection, ...]
    tls: HttpTlsSection | None
    gateway: str
    """Its name."""
    folder: Path
    """That the files are relative to."""
    seen: tuple[tuple[int, int, int] | None, ...]
    """How the files of TLS looked: renewed ones are others."""

    @property
    def asks_who(self) -> bool:
        """Whether requests have to show who asks; where certificates say it, the handshake sees to that."""
        return bool(self.tokens)

    @property
    def address(self) -> str:
        """Where it is, for people."""
        return f"{'http' if self.tls is None else 'https'}://{self.endpoint}"

    @property
    def cookie(self) -> str:
        """Name of a session's cookie: a browser has one store for all gateways behind one host.

        On one machine they differ by port, behind one proxy by name.
        """
        return f"{'' if self.tls is None else '__Host-'}pitch-gateway-{self.gateway}-{self.endpoint.port}"

    def context(self) -> ssl.SSLContext | None:
        """Return what TLS needs, None without; blocks. Raises NamedFileError."""
        if self.tls is None:
            return None
        return server_context(self.tls, self.folder, needs_client=not self.tokens)

    def held(self) -> tuple[Held, ...]:
        """Return what is in the files of TLS, with its times; blocks. Raises NamedFileError."""
        if self.tls is None:
            return ()
        named = {
            "certificate": self.tls.certificate,
            "clients": self.tls.clients,
            "revoked": self.tls.revoked,
        }
        return read_held(
            {
                key: path_of((*TLS_KEY, key), file, self.folder).absolute()
                for key, file in named.items()
                if file is not None
            }
        )


def wanted_by(section: HttpSection, gateway: str, folder: Path) -> Wanted | None:
    """Return what a section wants for the gateway of that name; None: no page over TCP.

    Its files are relative to ``folder``.
    """
    endpoint, tls = section.endpoint, section.tls
    if endpoint is None:
        return None
    files = () if tls is None else (tls.certificate, tls.key, tls.clients, tls.revoked)
    seen = tuple(_look_at(file, folder) for file in files)
    return Wanted(endpoint, section.tokens, tls, gateway, folder, seen)


def _look_at(file: str | None, folder: Path) -> tuple[int, int, int] | None:
    try:
        status = path_of(TLS_KEY, file, folder).stat() if file is not None else None
    except (NamedFileError, OSError):
        return None
    return None if status is None else (status.st_ino, status.st_size, status.st_mtime_ns)
