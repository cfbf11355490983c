"""The state of many gateways: each is asked over HTTP for its status. The worst comes first."""

import contextlib
import http.client
import ipaddress
import json
import socket
import ssl
import threading
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final
from urllib.parse import SplitResult, urlsplit

import msgspec

from gateway.config.files import NamedFileError, read_token
from gateway.files import FileRefusedError, read_regular_file
from gateway.status.model import Model
from gateway.transport.certificates import LARGEST_FILE

ANSWER_WITHIN_S: Final = 5.0
"""For a whole status, from the first byte sent."""
AT_ONCE: Final = 256
"""So many are asked at the same time: two hundred that are all off take the time of one."""
LARGEST_ANSWER: Final = 8_000_000
NO_STATUS: Final = "its answer is no status of a gateway"
_PIECE: Final = 1 << 16
UNREACHABLE: Final = "unreachable"
EXIT_OF: Final = {UNREACHABLE: 1, "error": 3, "warning": 4, "waiting": 0, "healthy": 0}
"""Exit code of a command by the worst gateway."""
WORST_FIRST: Final = tuple(EXIT_OF)
"""States of a gateway: that it gave no status, and its verdicts."""
COMPENSATED: Final = frozenset({"active", "blending"})
"""States of an axis whose positions are corrected."""


class FleetError(Exception):
    """The gateways cannot be asked as requested; the reason, with a remedy."""


class GatewaySeen(msgspec.Struct, frozen=True, kw_only=True):
    """One gateway as its status shows it. Without a status only ``url``, ``state`` and ``problem`` count."""

    url: str
    state: str
    """One of ``WORST_FIRST``."""
    problem: str = ""
    """Why there is no status, with a remedy."""
    name: str = ""
    version: str = ""
    since: str = ""
    """Of the state; ISO 8601."""
    errors: int = 0
    warnings: int = 0
    worst: str = ""
    """The first alarm: where and what."""
    axes: int = 0
    compensated: int = 0
    """Number of these whose positions are corrected."""

    @property
    def address(self) -> str:
        """Host and port."""
        return urlsplit(self.url).netloc


class Fleet(msgspec.Struct, frozen=True, kw_only=True):
    """The gateways, the worst first."""

    gateways: list[GatewaySeen]
    states: dict[str, int]
    """Number of gateways in each state, the worst state first."""

    def as_data(self) -> Any:
        """Return it as plain data."""
        return msgspec.to_builtins(self)


@dataclass(frozen=True, slots=True)
class Access:
    """How a page is asked that wants a token, or certificates.

    ``token`` is sent to every gateway. ``context`` has the trusted authorities, and a certificate of ours.
    """

    token: str = ""
    context: ssl.SSLContext | None = None


def access_by(
    token_file: Path | None = None,
    ca: Path | None = None,
    certificate: Path | None = None,
    key: Path | None = None,
) -> Access:
    """Read the files that gateways are asked with.

    Raises:
        FleetError: one is missing or unusable.
    """
    token = ""
    if token_file is not None:
        try:
            token = read_token(("--token-file",), str(token_file), Path())
        except NamedFileError as error:
            raise FleetError(str(error)) from None
    if key is not None and certificate is None:
        raise FleetError("--key needs --certificate: the certificate that it belongs to")
    for option, file in (("--ca", ca), ("--certificate", certificate), ("--key", key)):
        _check_readable(option, file)
    try:
        context = ssl.create_default_context(cafile=ca)
    except (OSError, ssl.SSLError) as error:
        raise FleetError(f"--ca: {ca}: {_reason(error)}; name a PEM file of certificates") from None
    if certificate is not None:
        try:
            context.load_cert_chain(certificate, key)
        except (OSError, ssl.SSLError) as error:
            remedy = "name a PEM certificate, and its key with --key"
            raise FleetError(f"--certificate: {certificate}: {_reason(error)}; {remedy}") from None
    return Access(token, context)


def _check_readable(option: str, file: Path | None) -> None:
    """Check that a file can be read: OpenSSL would wait for a FIFO for ever."""
    if file is None:
        return
    try:
        read_regular_file(file, LARGEST_FILE, "a file in PEM")
    except FileRefusedError as error:
        raise FleetError(f"{option}: {file}: {error}") from None


def look_at(urls: Sequence[str], access: Access) -> Fleet:
    """Ask each gateway once for its status, ``AT_ONCE`` at the same time.

    Raises:
        FleetError: an address is none of a page, or the token would be sent unencrypted.
    """
    pages = list(dict.fromkeys(map(_page_of, urls)))
    for page in pages:
        if access.token and page.scheme != "https" and not _is_here(page):
            raise FleetError(f"{page.scheme}://{page.netloc}: a token is sent encrypted only; use https")
    with ThreadPoolExecutor(min(AT_ONCE, len(pages))) as threads:
        seen = list(threads.map(lambda page: _ask(page, access), pages))
    seen.sort(key=lambda each: (WORST_FIRST.index(each.state), -each.errors, -each.warnings, each.address))
    counted = Counter(each.state for each in seen)
    return Fleet(gateways=seen, states={state: counted[state] for state in WORST_FIRST if counted[state]})


def _is_here(page: SplitResult) -> bool:
    """Whether an address is one of this computer."""
    host = page.hostname or ""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False  # also 127.0.0.1.example: a name


def _page_of(url: str) -> SplitResult:
    """Return the address of a status."""
    try:
        page = urlsplit(url)
        is_page = page.scheme in ("http", "https") and page.hostname and page.port != 0
        # What http.client cannot send.
        is_page = is_page and bool((page.hostname or "").encode("idna")) and page.path.isascii()
        is_page = is_page and page.path.isprintable() and " " not in page.path
    except ValueError:
        is_page = False
    if not is_page:
        raise FleetError(f"{url}: no address of a gateway's page, such as http://192.168.0.7:8480")
    if page.username is not None or page.query or page.fragment:
        raise FleetError(f"{url}: give the address alone; a token comes from --token-file")
    path = page.path.rstrip("/")
    return page._replace(path=path if path.endswith("/status") else f"{path}/status")


def _ask(page: SplitResult, access: Access) -> GatewaySeen:
    url = page._replace(path=page.path.removesuffix("/status")).geturl()
    try:
        return _seen(url, _status_at(page, access))
    except FleetError as error:
        return GatewaySeen(url=url, state=UNREACHABLE, problem=str(error))


def _seen(url: str, status: Model) -> GatewaySeen:
    verdict, alarms = status.verdict, status.troubles
    if verdict.state not in WORST_FIRST[1:]:
        raise FleetError("its release is older than 1.0: it says no verdict; upgrade it")
    try:
        datetime.fromisoformat(verdict.since or "2000-01-01").astimezone()
    except (ValueError, OverflowError):
        raise FleetError(NO_STATUS) from None
    return GatewaySeen(
        url=url,
        state=verdict.state,
        name=status.gateway.name,
        version=status.gateway.version,
        since=verdict.since,
        errors=verdict.errors,
        warnings=verdict.warnings,
        worst=f"{alarms[0].where}: {alarms[0].what}" if alarms else "",
        axes=len(status.axes),
        compensated=sum(axis.compensation in COMPENSATED for axis in status.axes.values()),
    )


def _status_at(page: SplitResult, access: Access) -> Model:
    """Ask for a status.

    Raises:
        FleetError: there is none; why, with a remedy.
    """
    try:
        code, body = _get(page, access)
    except TimeoutError:
        raise FleetError(f"no answer within {ANSWER_WITHIN_S:g} s") from None
    except socket.gaierror:
        raise FleetError(f"no address is known for {page.hostname}; check the name") from None
    except ConnectionRefusedError:
        raise FleetError("nothing listens there; by default the page is at port 8480") from None
    except ssl.SSLCertVerificationError as error:
        why = error.verify_message or error
        raise FleetError(f"its certificate is not trusted ({why}); name its authority with --ca") from None
    except http.client.HTTPException:
        raise FleetError("its answer is no HTTP; check host and port") from None
    except OSError as error:
        raise FleetError(_reason(error)) from None
    if code == http.client.UNAUTHORIZED:
        raise FleetError("it wants a token that it knows; name its file with --token-file")
    try:
        data = json.loads(body)
        if code != http.client.OK:
            raise FleetError(f"{data['problem']} (HTTP {code})")
        return msgspec.convert(data, Model)
    except (ValueError, KeyError, TypeError, RecursionError, msgspec.ValidationError):
        raise FleetError(f"{NO_STATUS} (HTTP {code})") from None


def _get(page: SplitResult, access: Access) -> tuple[int, bytes]:
    """Return code and body of the answer. A redirection is not followed: it would take the token along."""
    until_s = time.monotonic() + ANSWER_WITHIN_S
    assert page.hostname is not None
    connection: http.client.HTTPConnection
    if page.scheme == "https":
        connection = http.client.HTTPSConnection(
            page.hostname, page.port, timeout=ANSWER_WITHIN_S, context=access.context
        )
    else:
        connection = http.client.HTTPConnection(page.hostname, page.port, timeout=ANSWER_WITHIN_S)
    headers = {"Authorization": f"Bearer {access.token}"} if access.token else {}
    end: threading.Timer | None = None
    try:
        connection.connect()
        # The time-out of a socket begins anew with each byte.
        end = threading.Timer(until_s - time.monotonic(), _cut, (connection.sock,))
        end.start()
        connection.request("GET", page.path, headers=headers)
        response = connection.getresponse()
        body = bytearray()
        while piece := response.read1(_PIECE):
            body += piece
            if len(body) > LARGEST_ANSWER:
                raise FleetError(f"{NO_STATUS}: it is too long")
        is_late = time.monotonic() >= until_s
    except (OSError, http.client.HTTPException):
        if time.monotonic() < until_s:
            raise
        is_late = True
    finally:
        if end is not None:
            end.cancel()
        connection.close()
    if is_late:
        raise TimeoutError
    return response.status, bytes(body)


def _cut(connection: socket.socket) -> None:
    """End a connection that a thread reads from."""
    with contextlib.suppress(OSError):
        socket.socket.shutdown(connection, socket.SHUT_RDWR)  # that of TLS would change what the thread uses


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error) or type(error).__name__
