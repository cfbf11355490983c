"""What the exchange asks of the world around it: small classes that whoever frames derives its own from.

The exchange speaks in unit ids and PDUs. Framing (RTU with its CRC, MBAP with its transaction id) is done by
the relay. These are classes and not protocols, because what is asked for with each frame is then a look into
an object and a call, also where it is compiled.
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
    """When the newest frame left, over a controller's port or a drive link. Monotonic, in ns."""

    def __init__(self) -> None:
        self.ready_ns = 0
        """When it was ready to be written; only kept of requests."""
        self.sent_ns = 0
        """When the system had taken it, or, while it is held back, when it was ready; 0: nobody measures."""
        self.paced_ns = 0
        """How long it was held back, for the silence that a wire or a drive wants before it."""
        self.wire_ns_per_byte = 0
        """How long a byte takes on its wire; 0 where there is none."""


def writer_name(controller: str, peer: str) -> str:
    """Return what a controller at a host is known by: it stays the same when it connects again.

    >>> writer_name("cnc", "192.168.0.7"), writer_name("cnc", "")
    ('cnc (192.168.0.7)', 'cnc')
    """
    return f"{controller} ({peer})" if peer else controller


@mypyc_attr(allow_interpreted_subclasses=True)
class ControllerPort:
    """One connection of one controller: a serial port, or one accepted TCP connection."""

    def __init__(self, plan: ControllerPlan, peer: str = "") -> None:
        self.plan = plan
        """The controller's configuration; connections share it, where certificates give roles by role."""
        # --- what of the plan is asked for with each request
        self.name = plan.name
        self.is_serial = plan.serial
        self.is_motion = plan.role is Role.MOTION
        self.patience_ns = int(plan.timeout_ms * NS_PER_MS)
        """After so long the controller gives up on a request."""
        self.peer = peer
        """The host that it connects from; empty on a serial port."""
        self.writer = writer_name(plan.name, peer)
        """See :func:`writer_name`."""
        self.stamps = Stamps()
        """When its newest frame left."""
        self.newest_ns = 0
        """When its newest request came. The exchange's own."""
        self.ends_by_silence = False
        """Whether its frames may be odd: it is a serial port, on which silence says where they end."""
        self.gate: Gate | None = UNSEEN
        """What it may ask for; None: whatever its role allows. The exchange's own."""
        self.number = 0
        """Its number in a recording; 0: it has asked for nothing yet. The tap's own."""

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        """Frame and send a reply. ``transaction_id`` is the request's own (0 on serial lines)."""
        raise NotImplementedError

    # --- replies that leave while they arrive, and requests that did (``cut_through``); serial ports alone

    def may_forward(self, now_ns: int) -> bool:
        """Whether a reply may begin to leave now."""
        return False

    def forward(self, piece: bytes) -> None:
        """Send bytes of a reply, of which the last ones of its check sum may come later or not at all."""
        raise NotImplementedError

    def forward_last(self, transaction_id: int, unit_id: int, pdu: bytes, rest: bytes) -> None:
        """Send the rest of a reply; what has left with it is this one."""
        raise NotImplementedError


@mypyc_attr(allow_interpreted_subclasses=True)
class OwnUnit:
    """A unit id at which the gateway itself answers: what is asked there never reaches a drive."""

    def __init__(self, unit_id: int) -> None:
        self.unit_id = unit_id

    def answer(self, pdu: bytes, now_ns: int) -> bytes:
        """Return the reply to a request."""
        raise NotImplementedError


@mypyc_attr(allow_interpreted_subclasses=True)
class DriveLink:
    """The link to the drives of one line.

    ``is_serial``: replies carry no transaction id: RTU, over a wire or over TCP (W6).
    ``connects``: it is a connection, which can be made anew; a serial port is not.
    """

    def __init__(self, *, is_serial: bool, connects: bool = False) -> None:
        self.is_serial = is_serial
        self.connects = connects
        self.stamps = Stamps()
        """When its newest frame left."""

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        """Frame and send a request, and expect the reply that fits it."""
        raise NotImplementedError

    def abandon(self) -> None:
        """Expect nothing any more: whatever arrives now is late and is reported as stray bytes."""
        raise NotImplementedError

    def came_instead(self, unit_id: int) -> str:
        """Say what came in the place of the newest reply that a unit id did not give; "": nothing known."""
        return ""

    # --- connections alone: how they end is up to the exchange, which takes the link for down at once

    def want(self) -> None:
        """A request waits for the link: connect, if that may be tried again yet."""

    def renew(self) -> None:
        """Break the connection off, with what was not sent yet, and make another one."""

    def hang_up(self, *, returns: bool) -> None:
        """Close the connection in order; ``returns``: make another one at once."""

    # --- requests that leave while they arrive (``cut_through``); serial links alone

    def may_forward(self, now_ns: int) -> bool:
        """Whether a request may begin to leave now."""
        return False

    def forward(self, piece: bytes) -> None:
        """Send bytes of a request that is none yet, and may never be one."""
        raise NotImplementedError

    def forward_last(self, unit_id: int, pdu: bytes, rest: bytes) -> None:
        """Send the rest of a request; what has left with it is this one. Expect the reply that fits it."""
        raise NotImplementedError
