"""The two halves that every transport has: a channel that takes bytes, and a receiver that gets them."""

from typing import Final, Protocol

from gateway.compiled import mypyc_attr

CLOSED: Final = "connection closed"
"""Why a channel ended that was closed here, when all was said."""
CLOSED_BY_PEER: Final = "closed by its peer"
"""Why a channel ended that its other end closed in order: nothing broke."""
IN_ORDER: Final = frozenset({CLOSED, CLOSED_BY_PEER})
"""Why a channel ended that did not break off."""


@mypyc_attr(allow_interpreted_subclasses=True)
class Channel:
    """One open connection or port. It lives once: after it was closed, another one is opened.

    A class and no protocol, because it is called for each frame: see ``exchange.ports``.
    """

    peer = "?"
    """Who is at the other end, for logs and the status."""
    wire_ns_per_byte = 0
    """Nanoseconds that one byte takes on the wire; 0 where there is none (TCP, pseudo terminals)."""

    def write(self, data: bytes) -> None:
        """Send at once; never blocks, never raises. A loss is told by ``Receiver.closed``, later."""
        raise NotImplementedError

    def count_received(self) -> int:
        """Return how many bytes have come, where they are counted: over TCP."""
        return 0

    def has_gone(self, *, asks: bool) -> bool:
        """Whether the other end has closed or broken off the connection, as far as the system knows.

        ``asks``: what it said with the bytes that were read last may be old, so it is asked anew.
        """
        raise NotImplementedError

    def close(self) -> None:
        """Close after what was written has left."""
        raise NotImplementedError


class Receiver(Protocol):
    """Whoever takes the bytes. ``now_ns`` is CLOCK_BOOTTIME, taken right after the read."""

    def opened(self, channel: Channel, now_ns: int) -> None:
        """Begin with a new channel."""
        ...

    def received(self, data: bytes, now_ns: int) -> None:
        """Take bytes as they came; any split and any glue is possible."""
        ...

    def closed(self, reason: str, now_ns: int) -> None:
        """End: the channel of the last ``opened`` is gone."""
        ...
