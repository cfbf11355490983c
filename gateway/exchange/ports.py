"""What the exchange needs from outside: small base classes for the code that frames bytes.

The exchange uses unit ids and PDUs. The relay does the framing (RTU with its CRC, MBAP with its transaction
id). These are classes and not protocols: access for each frame is then one attribute and one call, also when
compiled.
"""

from gateway.compiled import mypyc_attr
from gateway.exchange.gate import UNSEEN, Gate
from gateway.exchange.plan import ControllerPlan, Role
from gateway.times import NS_PER_MS


class Alarm:
    """Wakes a line at its deadline."""

    def arm(self, deadline_ns: int | None) -> None:
        """Call ``tick`` at this time, and at no other; None: not at all."""
        raise NotImplementedError


class Stamps:
    """When the newest frame was sent, over a controller's port or a drive link. Monotonic, in ns."""

    def __init__(self) -> None:
        self.ready_ns = 0
        """When it was ready to be written; only kept for requests."""
        self.sent_ns = 0
        """When the system had taken it; while it is held back, when it was ready; 0: not measured."""
        self.next_ns = 0
        """The earliest time for the next frame: the wire or the other end needs a silence before it."""
        self.wire_ns_per_byte = 0
        """Time of one byte on its wire; 0: there is no wire."""


def writer_name(controller: str, peer: str) -> str:
    """Return the identity of a controller at a host: it stays the same after a reconnection.

    >>> writer_name("cnc", "192.168.0.7"), writer_name("cnc", "")
    ('cnc (192.168.0.7)', 'cnc')
    """
    return f"{controller} ({peer})" if peer else controller


@mypyc_attr(allow_interpreted_subclasses=True)
class ControllerPort:
    """One connection of one controller: a serial port, or one accepted TCP connection."""

    def __init__(self, plan: ControllerPlan, peer: str = "") -> None:
        self.plan = plan
        """The controller's configuration; connections share it, one for each role if certificates give
        roles."""
        # --- values of the plan that each request needs
        self.name = plan.name
        self.is_serial = plan.serial
        self.is_motion = plan.role is Role.MOTION
        self.patience_ns = int(plan.timeout_ms * NS_PER_MS)
        """After so long the controller gives up on a request."""
        self.peer = peer
        """The host from which it connects; empty on a serial port."""
        self.writer = writer_name(plan.name, peer)
        """See :func:`writer_name`."""
        self.stamps = Stamps()
        """When its newest frame was sent."""
        self.newest_ns = 0
        """When its newest request came. Owned by the exchange."""
        self.ends_by_silence = False
        """Whether its frames may be odd: on a serial port silence marks their end."""
        self.gate: Gate | None = UNSEEN
        """Its rights; None: everything that its role allows. Owned by the exchange."""
        self.number = 0
        """Its number in a recording; 0: it has sent nothing yet. Owned by the tap."""

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        """Frame and send a reply. ``transaction_id`` is the request's own (0 on serial lines)."""
        raise NotImplementedError

    # --- cut-through replies, and replies to cut-through requests (``cut_through``); serial ports only

    def may_forward(self, now_ns: int) -> bool:
        """Whether the forwarding of a reply may begin now."""
        return False

    def forward(self, piece: bytes) -> None:
        """Send bytes of a reply; the last bytes of its CRC may come later or not at all."""
        raise NotImplementedError

    def forward_last(self, transaction_id: int, unit_id: int, pdu: bytes, rest: bytes) -> None:
        """Send the rest of a reply; the complete reply is this one."""
        raise NotImplementedError


@mypyc_attr(allow_interpreted_subclasses=True)
class OwnUnit:
    """A unit id at which the gateway itself answers: requests to it never reach a drive."""

    def __init__(self, unit_id: int) -> None:
        self.unit_id = unit_id

    def answer(self, pdu: bytes, now_ns: int) -> bytes:
        """Return the reply to a request."""
        raise NotImplementedError


@mypyc_attr(allow_interpreted_subclasses=True)
class DriveLink:
    """The link to the drives of one line.

    ``is_serial``: replies carry no transaction id: RTU, over a wire or over TCP (W6).
    ``connects``: it is a connection, which can be renewed; a serial port is not.
    """

    def __init__(self, *, is_serial: bool, connects: bool = False) -> None:
        self.is_serial = is_serial
        self.connects = connects
        self.stamps = Stamps()
        """When its newest frame was sent."""

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        """Frame and send a request, and expect the reply that fits it."""
        raise NotImplementedError

    def abandon(self) -> None:
        """Expect nothing any more: whatever arrives now is late and is reported as stray bytes."""
        raise NotImplementedError

    def came_instead(self, unit_id: int) -> str:
        """Return what came instead of a reply when a unit id last did not answer; "": unknown."""
        return ""

    # --- connections only: the exchange decides how they end, and treats the link as down immediately

    def want(self) -> None:
        """A request waits for the link: connect, if another attempt is already allowed."""

    def renew(self) -> None:
        """Abort the connection, with everything not sent yet, and make another one."""

    def hang_up(self, *, returns: bool) -> None:
        """Close the connection in order; ``returns``: make another one immediately."""

    # --- requests under cut-through (``cut_through``); serial links only

    def may_forward(self, now_ns: int) -> bool:
        """Whether the forwarding of a request may begin now."""
        return False

    def forward(self, piece: bytes) -> None:
        """Send bytes of a request that is not valid yet, and may never be."""
        raise NotImplementedError

    def forward_last(self, unit_id: int, pdu: bytes, rest: bytes) -> None:
        """Send the rest of a request; the complete request is this one. Expect the reply that fits it."""
        raise NotImplementedError
