"""What the exchange asks of the world around it: two small interfaces that the relay implements.

The exchange speaks in unit ids and PDUs. Framing (RTU with its CRC, MBAP with its transaction id) is done by
whoever implements these.
"""

from typing import Protocol

from gateway.exchange.gate import UNSEEN, Gate
from gateway.exchange.plan import ControllerPlan


class Stamps:
    """When the newest frame left, over a controller's port or a drive link. Monotonic, in ns."""

    ready_ns = 0
    """When it was ready to be written; only kept of requests."""
    sent_ns = 0
    """When the system had taken it, or, while it is held back, when it was ready; 0 where nobody measures."""
    paced_ns = 0
    """How long it was held back, for the silence that a wire or a drive wants before it."""


class Unmeasured:
    """What keeps no time: traffic that is only played."""

    stamps = Stamps()
    wire_ns_per_byte = 0
    peer = ""
    writer = ""
    gate: Gate | None = UNSEEN


def writer_name(controller: str, peer: str) -> str:
    """Return what a controller at a host is known by: it stays the same when it connects again.

    >>> writer_name("cnc", "192.168.0.7"), writer_name("cnc", "")
    ('cnc (192.168.0.7)', 'cnc')
    """
    return f"{controller} ({peer})" if peer else controller


class ControllerPort(Protocol):
    """One connection of one controller: a serial port, or one accepted TCP connection."""

    gate: Gate | None
    """What it may ask for; None: whatever its role allows. The exchange's own; a new port has ``UNSEEN``."""

    @property
    def plan(self) -> ControllerPlan:
        """The controller's configuration; connections share it, where certificates give roles by role."""
        ...

    @property
    def stamps(self) -> Stamps:
        """When its newest frame left."""
        ...

    @property
    def peer(self) -> str:
        """The host that it connects from; empty on a serial port."""
        ...

    @property
    def writer(self) -> str:
        """See :func:`writer_name`."""
        ...

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        """Frame and send a reply. ``transaction_id`` is the request's own (0 on serial lines)."""
        ...


class DriveLink(Protocol):
    """The link to the drives of one line."""

    @property
    def stamps(self) -> Stamps:
        """When its newest frame left."""
        ...

    @property
    def wire_ns_per_byte(self) -> int:
        """How long a byte takes on the wire; 0 where there is none."""
        ...

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
