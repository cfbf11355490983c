"""Ask the system whether the far end of a TCP connection is still there: silence does not show it.

A peer without power sends nothing, and neither does an idle one. The peer without power leaves a keep-alive
probe, or data, unacknowledged. The system of the idle one acknowledges it, whatever its program does.
"""

import socket
from enum import Enum
from struct import Struct
from typing import Final, NamedTuple

from gateway.times import NS_PER_MS, NS_PER_S

AT_ONCE_S: Final = 1
"""A probe is sent this long after the peer was last heard, or immediately if that is longer ago."""
LEAST_PATIENCE_NS: Final = 3 * NS_PER_S // 2
"""The shortest time for any peer. Linux acknowledges one probe in half a second (``tcp_invalid_ratelimit``),
and the interval between the automatic probes of a full window doubles each time."""
PROBES: Final = 100
PROBED_FOR_MS: Final = 60_000
"""While a probe runs, the system does not end the connection before the peer had its time to acknowledge."""
LONGEST_NS: Final = 15 * NS_PER_S
"""A verdict that is still unknown after this time is given up. The system sends no probe while it waits to
repeat unacknowledged data, and ends such a connection itself."""

_INFO: Final = Struct("=8B13I")
"""The beginning of ``struct tcp_info`` (linux/tcp.h)."""
_RETRANSMITS, _PROBES, _UNACKED = 2, 3, 12
_LAST_DATA_SENT, _LAST_DATA_RECEIVED, _LAST_ACK_RECEIVED = 17, 19, 20


class PeerVerdict(Enum):
    """The result of probing a peer so far."""

    UNKNOWN = "unknown"
    """No data sent to it has been unacknowledged for long enough, and nothing came from it."""
    THERE = "there"
    """Something came from it since the probe began."""
    GONE = "gone"
    """It did not acknowledge in time."""


class PeerState(NamedTuple):
    """The system's data about a connection at one moment; monotonic, in ns."""

    now_ns: int
    sent_ns: int
    """When data was last sent, for the first time or repeated."""
    heard_ns: int
    """When anything came from the peer."""
    is_repeated: bool
    """Sent data is unacknowledged and was repeated. The first acknowledgement may be delayed; a repetition is
    acknowledged immediately."""
    is_probed: bool
    """A probe is not acknowledged."""


def verdict(seen: PeerState, began_ns: int, probed_ns: int | None, patience_ns: int) -> PeerVerdict:
    """Judge the state of a peer.

    Args:
        seen: the system's data.
        began_ns: when the probing began.
        probed_ns: since when a probe has been seen unacknowledged; None: none has.
        patience_ns: time that the peer may take to acknowledge.
    """
    if seen.heard_ns >= began_ns:
        return PeerVerdict.THERE
    if seen.is_repeated and seen.heard_ns < seen.sent_ns and seen.now_ns - seen.sent_ns >= patience_ns:
        return PeerVerdict.GONE
    if probed_ns is not None and seen.now_ns - probed_ns >= patience_ns:
        return PeerVerdict.GONE
    return PeerVerdict.THERE if seen.now_ns - began_ns >= LONGEST_NS else PeerVerdict.UNKNOWN


class PeerProbe:
    """Probes the peer of one connection: call :meth:`check` regularly, and :meth:`end` after the verdict."""

    def __init__(self, connection: socket.socket, patience_ns: int, now_ns: int) -> None:
        self._connection = connection
        self._patience_ns = max(patience_ns, LEAST_PATIENCE_NS)
        self._began_ns = now_ns
        self._probed_ns: int | None = None
        self._before = [(option, connection.getsockopt(socket.IPPROTO_TCP, option)) for option in _OPTIONS]
        self._set(socket.TCP_KEEPCNT, PROBES)
        self._set(socket.TCP_USER_TIMEOUT, PROBED_FOR_MS)
        self._ask()

    def check(self, now_ns: int) -> PeerVerdict:
        """Return the verdict so far. While it is unknown, probe once more: a probe may be lost."""
        seen = _seen(self._connection, now_ns)
        if not seen.is_probed:
            self._probed_ns = None
        elif self._probed_ns is None:
            self._probed_ns = now_ns
        found = verdict(seen, self._began_ns, self._probed_ns, self._patience_ns)
        if found is PeerVerdict.UNKNOWN:
            self._ask()
        return found

    def end(self) -> None:
        """Restore the options of the socket."""
        for option, value in self._before:
            self._set(option, value)

    def _ask(self) -> None:
        """Have a probe sent: setting this makes the system check immediately whether one is due."""
        self._set(socket.TCP_KEEPIDLE, AT_ONCE_S)

    def _set(self, option: int, value: int) -> None:
        self._connection.setsockopt(socket.IPPROTO_TCP, option, value)


_OPTIONS: Final = (socket.TCP_KEEPIDLE, socket.TCP_KEEPCNT, socket.TCP_USER_TIMEOUT)


def _seen(connection: socket.socket, now_ns: int) -> PeerState:
    info = _INFO.unpack(connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _INFO.size))
    heard_ms_ago = min(info[_LAST_DATA_RECEIVED], info[_LAST_ACK_RECEIVED])
    return PeerState(
        now_ns,
        now_ns - info[_LAST_DATA_SENT] * NS_PER_MS,
        now_ns - heard_ms_ago * NS_PER_MS,
        is_repeated=info[_UNACKED] > 0 and info[_RETRANSMITS] > 0,
        is_probed=info[_PROBES] > 0,
    )
