"""The two halves of every transport: a channel that takes bytes, and a receiver that gets them."""

from typing import Final, Protocol

from gateway.compiled import mypyc_attr

CLOSED: Final = "connection closed"
"""Reason of a channel that this side closed after all bytes were sent."""
CLOSED_BY_PEER: Final = "closed by its peer"
"""Reason of a channel that the other end closed in order: nothing broke."""
IN_ORDER: Final = frozenset({CLOSED, CLOSED_BY_PEER})
"""Reasons of channels that did not break."""


@mypyc_attr(allow_interpreted_subclasses=True)
class Channel:
    """One open connection or port. It is used once: after closing, another one is opened.

    A class and no protocol, because it is called for each frame: see ``exchange.ports``.
    """

    peer = "?"
    """The other end, for logs and the status."""
    wire_ns_per_byte = 0
    """Nanoseconds of one byte on the wire; 0 without a wire (TCP, pseudo terminals)."""

    def write(self, data: bytes) -> None:
        """Send immediately; never blocks, never raises. ``Receiver.closed`` reports a loss later."""
        raise NotImplementedError

    def count_received(self) -> int:
        """Return how many bytes have come; counted over TCP only."""
        return 0

    def has_gone(self, *, asks: bool) -> bool:
        """Whether the other end has closed or reset the connection, as far as the system knows.

        ``asks``: query the system again, because what it said with the last bytes may be old.
        """
        raise NotImplementedError

    def close(self) -> None:
        """Close after the written bytes were sent."""
        raise NotImplementedError


class Receiver(Protocol):
    """Takes the bytes. ``now_ns`` is CLOCK_BOOTTIME, taken right after the read."""

    def opened(self, channel: Channel, now_ns: int) -> None:
        """Begin with a new channel."""
        ...

    def received(self, data: bytes, now_ns: int) -> None:
        """Take bytes as they came; they may be split and joined in any way."""
        ...

    def closed(self, reason: str, now_ns: int) -> None:
        """End: the channel of the last ``opened`` is gone."""
        ...
