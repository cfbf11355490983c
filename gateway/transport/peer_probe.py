"""Whether the far end of a TCP connection is still there: asked of the system, and never told by its quiet.

A peer that lost its power says nothing; one that has nothing to say says nothing either. The first leaves a
keep-alive probe, or what was sent to it, unacknowledged. The system of the second acknowledges it, whatever
its program does.
"""

import socket
from enum import Enum
from struct import Struct
from typing import Final, NamedTuple

from gateway.times import NS_PER_MS, NS_PER_S

AT_ONCE_S: Final = 1
"""A probe leaves so long after the peer was heard last, and at once where that is longer ago."""
LEAST_PATIENCE_NS: Final = 3 * NS_PER_S // 2
"""No peer is given less time. Linux acknowledges one probe in half a second (``tcp_invalid_ratelimit``), and
the probes of a full window, which leave by themselves, are twice as far apart each time."""
PROBES: Final = 100
PROBED_FOR_MS: Final = 60_000
"""While it is asked the system does not end the connection before its peer had its time to acknowledge."""
LONGEST_NS: Final = 15 * NS_PER_S
"""What is not known by then is not asked any longer. The system sends no probe while it waits to repeat what
was not acknowledged, and ends such a connection by itself."""

_INFO: Final = Struct("=8B13I")
"""The beginning of ``struct tcp_info`` (linux/tcp.h)."""
_RETRANSMITS, _PROBES, _UNACKED = 2, 3, 12
_LAST_DATA_SENT, _LAST_DATA_RECEIVED, _LAST_ACK_RECEIVED = 17, 19, 20


class PeerVerdict(Enum):
    """What is known of a peer that is asked."""

    UNKNOWN = "unknown"
    """Nothing that was sent to it has been unacknowledged for long enough, and nothing came from it."""
    THERE = "there"
    """Something came from it since it is asked."""
    GONE = "gone"
    """It did not acknowledge in its time."""


class PeerState(NamedTuple):
    """What the system says of a connection in one moment; monotonic, in ns."""

    now_ns: int
    sent_ns: int
    """When data left last, for the first time or once more."""
    heard_ns: int
    """When anything came from the peer."""
    is_repeated: bool
    """Data that left is not acknowledged and was sent once more. The first time its acknowledgement may be
    held back; a repetition is acknowledged at once."""
    is_probed: bool
    """A probe is not acknowledged."""


def verdict(seen: PeerState, began_ns: int, probed_ns: int | None, patience_ns: int) -> PeerVerdict:
    """Judge what is seen of a peer.

    Args:
        seen: what the system says.
        began_ns: since when it is asked.
        probed_ns: since when a probe has been seen unacknowledged; None: none has.
        patience_ns: so long it may take to acknowledge.
    """
    if seen.heard_ns >= began_ns:
        return PeerVerdict.THERE
    if seen.is_repeated and seen.heard_ns < seen.sent_ns and seen.now_ns - seen.sent_ns >= patience_ns:
        return PeerVerdict.GONE
    if probed_ns is not None and seen.now_ns - probed_ns >= patience_ns:
        return PeerVerdict.GONE
    return PeerVerdict.THERE if seen.now_ns - began_ns >= LONGEST_NS else PeerVerdict.UNKNOWN


class PeerProbe:
    """Asks the peer of one connection: :meth:`check` now and then, :meth:`end` when it is known."""

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
        """Return what is known by now. Where that is nothing it is asked once more: a probe may be lost."""
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
        """Set everything as it was."""
        for option, value in self._before:
            self._set(option, value)

    def _ask(self) -> None:
        """Have a probe leave: the system looks at once whether its time has come when that is set."""
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
