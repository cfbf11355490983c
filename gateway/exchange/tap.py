"""The interface for monitoring a line: for a recording, or the trace of its last minutes.

A tap is called with bytes that come in, bytes that are sent, deadlines that pass, and commands. It is called
before the line acts on an input. A line without a tap makes only one check for each input.
"""

from collections.abc import Sequence

from gateway.compensation.table import CorrectionTable
from gateway.compiled import mypyc_attr
from gateway.exchange.commands import Command
from gateway.exchange.ports import ControllerPort


@mypyc_attr(allow_interpreted_subclasses=True)
class Tap:
    """Receives everything; a subclass overrides what it needs. Times are monotonic, in ns."""

    # --- in: from controllers

    def request(
        self,
        port: ControllerPort,
        transaction_id: int,
        unit_id: int,
        pdu: bytes,
        now_ns: int,
        *,
        why_given_up: str = "",
    ) -> None:
        """A complete request comes in; arguments as for ``LineExchange.request``."""

    def gone(self, port: ControllerPort, now_ns: int, *, is_broken: bool) -> None:
        """A controller's connection or port is lost."""

    # --- in: from the drives

    def reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """A complete reply comes in."""

    def stray(self, now_ns: int, unit_id: int) -> None:
        """Bytes come in that answer nothing; ``unit_id`` of the complete frame in them, or -1."""

    def unframed(self, now_ns: int) -> None:
        """Bytes come in that form no frame yet."""

    def link_up(self, now_ns: int) -> None:
        """The drives can be reached."""

    def link_down(self, now_ns: int, reason: str, *, is_orderly: bool) -> None:
        """The drives cannot be reached; arguments as for ``LineExchange.link_down``."""

    # --- out

    def sent(self, unit_id: int, pdu: bytes) -> None:
        """A request is sent to the drives."""

    def abandoned(self) -> None:
        """Its reply is not awaited any longer."""

    def answered(self, port: ControllerPort, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        """A reply is sent to a controller."""

    def answered_early(self, port: ControllerPort, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        """A reply was forwarded while the drive's still came in: :meth:`reply` comes after it."""

    def paced(self, until_ns: int) -> None:
        """What waits is not sent before then, because the wire needs a silence."""

    # --- time and commands

    def timer(self, now_ns: int) -> None:
        """A deadline has passed."""

    def rest_first(self, now_ns: int) -> None:
        """The line begins with a silence."""

    def stop(self, now_ns: int) -> None:
        """The line stops."""

    def command(self, command: Command, tables: Sequence[CorrectionTable], now_ns: int) -> None:
        """A command comes in, with its tables."""
