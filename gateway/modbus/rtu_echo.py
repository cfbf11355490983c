"""The echo of replies: an RS-485 adapter that receives what it sends returns each reply to the gateway.

The acknowledgement of a write of one register or coil is equal to the request. Taken for a request, its echo
would repeat the write, be acknowledged, and come back again: a relative move would run without end.
"""

from enum import Enum
from typing import Final

from gateway.modbus.pdu import FunctionCode
from gateway.times import NS_PER_MS

LATEST_NS: Final = 50 * NS_PER_MS
"""No adapter returns a reply later than this after its last bit: the slowest delay bytes by 16 ms."""
_ONLY_REPLIES: Final = frozenset({FunctionCode.READ_HOLDING_REGISTERS, FunctionCode.READ_INPUT_REGISTERS})
"""Function codes whose replies are never requests: a request has another length."""
MOST_BYTES: Final = 1024
"""Most bytes that are awaited; with more the replies did not come back."""


class Echo(Enum):
    """Whether sent bytes come back."""

    UNKNOWN = "unknown"
    """Nothing was sent yet, or the returned bytes were damaged: the next reply decides."""
    ABSENT = "absent"
    PRESENT = "present"


class ReplyEcho:
    """Removes the echo of replies from the bytes that a serial port receives.

    With ``is_configured`` the configuration declares an echo. Otherwise the first reply decides. If it comes
    back byte for byte within :data:`LATEST_NS`, that is its echo. Any other byte, or none: there is no echo.
    """

    __slots__ = ("_held", "_is_configured", "_pending", "_until_ns", "echo", "echoes", "is_expected")

    def __init__(self, *, is_configured: bool = False) -> None:
        self._is_configured = is_configured
        self.echoes = 0
        """Replies that came back and were removed."""
        self.echo = Echo.UNKNOWN
        self.is_expected = False
        """Whether the next bytes may be an echo."""
        self._pending = self._held = b""
        self._until_ns = 0
        self.begin_anew()

    def begin_anew(self) -> None:
        """Start again: the port was opened, perhaps with another adapter."""
        self._enter(Echo.PRESENT if self._is_configured else Echo.UNKNOWN)

    @property
    def is_undeclared(self) -> bool:
        """Whether there is an echo that the configuration does not declare."""
        return self.echo is Echo.PRESENT and not self._is_configured

    def sent(self, data: bytes, now_ns: int, wire_ns: int) -> None:
        """Record that a reply, or a piece of one, is being sent, which takes ``wire_ns`` on its wire."""
        if self.echo is Echo.ABSENT:
            return
        if self.echo is Echo.UNKNOWN and self._pending and now_ns > self._until_ns:
            self._enter(Echo.ABSENT)
            return
        if len(self._pending) > MOST_BYTES:
            self._pending = self._held = b""
        self._pending += data
        self.is_expected = True
        self._until_ns = now_ns + wire_ns + LATEST_NS

    def take(self, data: bytes, now_ns: int, *, has_slept: bool = False) -> bytes:
        """Return received bytes without the echo; nothing while they may still become one.

        ``has_slept``: the process has not read for a while, so the arrival time of the bytes is unknown. A
        known echo is removed whenever it is read.
        """
        heard, pending = self._held + data, self._pending
        is_late = now_ns > self._until_ns and not has_slept
        if is_late and self.echo is Echo.UNKNOWN:
            self._enter(Echo.ABSENT)
            return heard
        if pending.startswith(heard) and len(heard) < len(pending):
            self._held = heard
            return b""
        if not heard.startswith(pending):
            is_half_echo = is_late and bool(self._held)
            self._miss()
            return data if is_half_echo else heard
        self.echoes += 1
        self._enter(Echo.PRESENT)
        return heard[len(pending) :]

    def came_back(self, reply: bytes, now_ns: int, soonest_ns: int) -> bool:
        """Return whether the newest reply, which came back although no echo was expected, is an echo.

        A reply to a read is never a request. Any other is one, unless it came before ``soonest_ns``: no
        controller could have received the reply and sent the same bytes by then.
        """
        if reply[1] not in _ONLY_REPLIES and now_ns >= soonest_ns:
            return False
        self.echoes += 1
        self._enter(Echo.PRESENT)
        return True

    def _miss(self) -> None:
        """Record that other bytes came: they may have collided with an echo on the wire."""
        if self._is_configured:
            self._enter(Echo.PRESENT)
        else:
            self._enter(Echo.UNKNOWN if self.echo is Echo.PRESENT else Echo.ABSENT)

    def _enter(self, echo: Echo) -> None:
        self.echo = echo
        self.is_expected = False
        self._pending = self._held = b""
