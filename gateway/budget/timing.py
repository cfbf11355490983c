"""How long one exchange takes, leg by leg, and how long a round of them. Spans are integers of nanoseconds.

The route is the relay's: a request goes on as soon as its last byte is in (its length is predicted, silence
is waited for only where it cannot be), each side keeps its silence from the last byte on that side, and the
controller sends its next request as soon as the standard lets it. Drives and controllers are taken to answer
at once where nobody knows better.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields

from gateway.budget.frames import Frame
from gateway.budget.wire import Wire
from gateway.times import NS_PER_MS, US_PER_MS

NS_PER_US = NS_PER_MS // US_PER_MS


@dataclass(frozen=True, slots=True)
class Route:
    """The way from one controller to the drives and back."""

    controller: Wire
    drives: Wire
    drive_gap_ns: int
    """Silence that the drives want before a request, beyond what their wire wants."""

    @property
    def gap_ns(self) -> int:
        """Silence before each request to the drives."""
        return max(self.drive_gap_ns, self.drives.silence_ns)

    @property
    def direct(self) -> Wire | None:
        """The one wire that there would be without the gateway; None where no time on it is known.

        It is the controller's own; a controller on TCP would have some converter before the drives' wire.
        """
        return next((wire for wire in (self.controller, self.drives) if wire.is_serial), None)


@dataclass(frozen=True, slots=True)
class Legs:
    """One exchange on a line that was quiet, in the order of its legs."""

    request_in_ns: int
    """Controller to gateway."""
    request_tail_ns: int
    """Silence that ends a request of unknown length."""
    gateway_ns: int
    """The gateway's share, both ways together: its budget."""
    request_out_ns: int
    """Gateway to drive."""
    drive_ns: int
    """The drive's own time; 0 where it is not known."""
    reply_in_ns: int
    """Drive to gateway."""
    reply_tail_ns: int
    """Silence that ends a reply of unknown length."""
    silence_ns: int
    """What is left of the silence that the controller's wire wants between request and reply."""
    reply_out_ns: int
    """Gateway to controller."""

    @property
    def total_ns(self) -> int:
        """From the first byte that the controller sends to the last that it gets."""
        return sum(getattr(self, leg.name) for leg in fields(self))

    @property
    def waited_ns(self) -> int:
        """From the last byte that the controller sends to the last that it gets: what its time-out sees."""
        return self.total_ns - self.request_in_ns

    @property
    def least_ns(self) -> int:
        """As :attr:`waited_ns` with a gateway that takes no time: what no software can save."""
        return self.waited_ns - self.gateway_ns


def legs_of(route: Route, frame: Frame, gateway_ns: int, drive_ns: int = 0) -> Legs:
    """Return the legs of one exchange."""
    controller, drives = route.controller, route.drives
    request_tail_ns = controller.tail_ns if frame.ends_by_silence else 0
    reply_tail_ns = drives.tail_ns if frame.ends_by_silence else 0
    request_out_ns = drives.frame_ns(frame.request_bytes)
    reply_in_ns = drives.frame_ns(frame.reply_bytes)
    passed_ns = request_tail_ns + gateway_ns + request_out_ns + drive_ns + reply_in_ns + reply_tail_ns
    return Legs(
        request_in_ns=controller.frame_ns(frame.request_bytes),
        request_tail_ns=request_tail_ns,
        gateway_ns=gateway_ns,
        request_out_ns=request_out_ns,
        drive_ns=drive_ns,
        reply_in_ns=reply_in_ns,
        reply_tail_ns=reply_tail_ns,
        silence_ns=max(controller.silence_ns - passed_ns, 0),
        reply_out_ns=controller.frame_ns(frame.reply_bytes),
    )


def drive_side_ns(route: Route, frames: Iterable[Frame], drive_ns: int = 0) -> int:
    """Return how long frames of the gateway's own hold up what follows: each with a silence after it."""
    return sum(
        route.drives.frame_ns(frame.request_bytes)
        + drive_ns
        + route.drives.frame_ns(frame.reply_bytes)
        + (route.drives.tail_ns if frame.ends_by_silence else 0)
        + route.gap_ns
        for frame in frames
    )


def round_ns(route: Route, exchanges: Sequence[tuple[Frame, Legs]]) -> int:
    """Return how long one round takes when one follows the other without end.

    A silence on the drive side costs only what is not hidden behind the controller's own wire.
    """
    free_ns = quiet_ns = started_ns = 0
    for _ in range(2):  # in the first round the line was quiet; from the second on every round is the same
        started_ns = free_ns
        for frame, legs in exchanges:
            free_ns, quiet_ns = _after(route, frame, legs, free_ns, quiet_ns)
    return free_ns - started_ns


def _after(route: Route, frame: Frame, legs: Legs, free_ns: int, quiet_ns: int) -> tuple[int, int]:
    """Return when the controller may send again, and when the last byte was on the drives' wire."""
    heard_ns = free_ns + legs.request_in_ns
    there_ns = legs.gateway_ns // 2  # both ways together; the share of each is not known
    ready_ns = heard_ns + legs.request_tail_ns + there_ns
    sent_ns = max(ready_ns, quiet_ns + route.gap_ns) if quiet_ns else ready_ns
    answered_ns = sent_ns + legs.request_out_ns + legs.drive_ns + legs.reply_in_ns
    passed_ns = answered_ns + legs.reply_tail_ns + legs.gateway_ns - there_ns
    back_ns = max(passed_ns, heard_ns + route.controller.silence_ns)
    done_ns = back_ns + route.controller.frame_ns(frame.reply_bytes)
    return done_ns + route.controller.silence_ns, answered_ns


@dataclass(frozen=True, slots=True)
class Direct:
    """The same exchange on one wire, without a gateway."""

    total_ns: int
    waited_ns: int


def direct_of(route: Route, frame: Frame, drive_ns: int = 0) -> Direct:
    """Return what an exchange would take without the gateway."""
    wire = route.direct or Wire()
    waited_ns = drive_ns + wire.frame_ns(frame.reply_bytes)
    return Direct(wire.frame_ns(frame.request_bytes) + waited_ns, waited_ns)


def direct_round_ns(route: Route, exchanges: Sequence[Direct]) -> int:
    """Return what a round would take without the gateway: every frame waits for the drive's silence."""
    wire = route.direct or Wire()
    return sum(each.total_ns + max(wire.silence_ns, route.drive_gap_ns) for each in exchanges)
