"""What the exchange asks of the world around it: two small interfaces that the relay implements.

The exchange speaks in unit ids and PDUs. Framing (RTU with its CRC, MBAP with its transaction id) is done by
whoever implements these.
"""

from typing import Protocol

from gateway.exchange.plan import ControllerPlan


class ControllerPort(Protocol):
    """One connection of one controller: a serial port, or one accepted TCP connection."""

    @property
    def plan(self) -> ControllerPlan:
        """The controller's configuration; two connections of one controller share it."""
        ...

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        """Frame and send a reply. ``transaction_id`` is the request's own (0 on serial lines)."""
        ...


class DriveLink(Protocol):
    """The way to the drives of one line."""

    @property
    def is_serial(self) -> bool:
        """Whether replies carry no transaction id: RTU, over a wire or over TCP (W6)."""
        ...

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        """Frame and send a request, and expect the reply that fits it."""
        ...

    def abandon(self) -> None:
        """Expect nothing any more: whatever arrives now is late and is reported as stray bytes."""
        ...
