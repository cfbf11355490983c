"""What a user may not open: low ports, serial ports of a group. The only source of these messages."""

import errno
import grp
import os
from pathlib import Path
from typing import Final

from gateway.catalogue import starts
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint

STATUS: Final = Path("/proc/self/status")
FIRST_FREE_PORT: Final = Path("/proc/sys/net/ipv4/ip_unprivileged_port_start")
"""The first port that needs no capability (ip(7)); it applies to IPv6 too."""
CAP_NET_BIND_SERVICE: Final = 10
"""Number of the capability (capabilities(7))."""


def why_no_port(endpoint: TcpEndpoint) -> tuple[str, str] | None:
    """Return why this process may not listen there, and the remedy; None if it may."""
    if endpoint.port >= first_free_port() or has_capability(CAP_NET_BIND_SERVICE):
        return None
    return no_port(endpoint)


def no_port(endpoint: TcpEndpoint) -> tuple[str, str]:
    """Return the problem of a port that this process may not listen on, and the remedy."""
    return (
        starts.MAY_NOT_LISTEN.begin(endpoint=endpoint),
        (
            f"ports below {first_free_port()} need CAP_NET_BIND_SERVICE: pitch-gateway service CONFIG "
            "--systemd /etc/systemd/system gives it to the unit; or choose a higher port"
        ),
    )


def why_no_device(endpoint: SerialEndpoint) -> tuple[str, str] | None:
    """Return why this process may not open a serial port, and the remedy; None if it may, or it is absent."""
    try:
        os.stat(endpoint.device)  # noqa: PTH116 - follows the link, as open does
    except PermissionError:
        return no_device(endpoint)
    except OSError:
        return None
    may_open = os.access(endpoint.device, os.R_OK | os.W_OK, effective_ids=True)
    return None if may_open else no_device(endpoint)


def no_device(endpoint: SerialEndpoint) -> tuple[str, str]:
    """Return the problem of a serial port that this process may not open, and the remedy."""
    device = endpoint.device
    group = _group_of(device)
    if group is None:
        return starts.MAY_NOT_OPEN.begin(
            device=device
        ), f"add the user to the group that owns it (ls -lL {device})"
    return (
        starts.MAY_NOT_OPEN.begin(device=device),
        f"add the user to the group {group} (sudo usermod -aG {group} USER, then log in again)",
    )


def is_permission(error: BaseException) -> bool:
    """Whether the system refused it for lack of permission."""
    return isinstance(error, OSError) and error.errno in (errno.EACCES, errno.EPERM)


def has_capability(number: int) -> bool:
    """Whether this process has a capability now."""
    try:
        lines = STATUS.read_text().splitlines()
    except OSError:
        return os.geteuid() == 0
    effective = next((line.split()[1] for line in lines if line.startswith("CapEff:")), "0")
    return bool(int(effective, 16) >> number & 1)


def first_free_port() -> int:
    """Return the first port that needs no capability."""
    try:
        return int(FIRST_FREE_PORT.read_text())
    except (OSError, ValueError):
        return 1024


def _group_of(device: str) -> str | None:
    """Return the named group that may use a device; None if there is none, or it is root's."""
    try:
        status = os.stat(device)  # noqa: PTH116 - follows the link, as open does
        name = grp.getgrgid(status.st_gid).gr_name
    except (OSError, KeyError):
        return None
    return name if status.st_gid != 0 and status.st_mode & 0o060 == 0o060 else None
