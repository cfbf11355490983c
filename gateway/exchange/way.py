"""How a request goes out and its reply comes back where nothing about them needs to be judged."""

from typing import TYPE_CHECKING

from gateway.exchange.axis import AxisExchange

if TYPE_CHECKING:
    from gateway.exchange.life import Exchange


class Way:
    """Frames that hold nothing the gateway cares for: both directions pass as they are."""

    __slots__ = ("_size", "axes")

    def __init__(self, size: int, axes: tuple[AxisExchange, ...] = ()) -> None:
        self._size = size
        """Bytes of the PDU: of a request whose length contradicts its head nobody knows what it writes."""
        self.axes = axes
        """Axes of its unit, of which something may have been learned."""

    def sent(self, exchange: "Exchange", now_ns: int) -> bytes | None:
        """Return what is sent for a request; None: it goes the long way."""
        for axis in self.axes:
            if axis.silent_since_ns is not None:
                return None
        pdu = exchange.pdu
        return pdu if len(pdu) == self._size else None

    def answered(self, exchange: "Exchange", reply: bytes, now_ns: int) -> bytes | None:
        """Return what the controller gets for a drive's reply; None: it goes the long way."""
        return reply

    def left(self, exchange: "Exchange") -> None:
        """Take note that a target is on its way."""

    def settle(self, exchange: "Exchange", now_ns: int) -> None:
        """Take note of what the reply proved, once it was passed on."""
