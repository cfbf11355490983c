"""What may listen at a line: a recording, or the trace of its last minutes.

A tap is called with bytes that come in, bytes that go out, deadlines that pass, and commands. It is called
before the line acts on what comes in. A line without one asks once for each whether there is one.
"""

from collections.abc import Sequence

from gateway.compensation.table import CorrectionTable
from gateway.compiled import mypyc_attr
from gateway.exchange.commands import Command
from gateway.exchange.ports import ControllerPort


@mypyc_attr(allow_interpreted_subclasses=True)
class Tap:
    """Hears everything, and does nothing with what a subclass does not take. Times are monotonic, in ns."""

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
        """A whole request comes in; arguments as those of ``LineExchange.request``."""

    def gone(self, port: ControllerPort, now_ns: int, *, is_broken: bool) -> None:
        """A controller's connection or port is lost."""

    # --- in: from the drives

    def reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """A whole reply comes in."""

    def stray(self, now_ns: int, unit_id: int) -> None:
        """Bytes come in that answer nothing; ``unit_id`` of the whole frame among them, or -1."""

    def unframed(self, now_ns: int) -> None:
        """Bytes come in of which no frame was made yet."""

    def link_up(self, now_ns: int) -> None:
        """The drives can be reached."""

    def link_down(self, now_ns: int, reason: str, *, is_orderly: bool) -> None:
        """The drives cannot be reached; arguments as those of ``LineExchange.link_down``."""

    # --- out

    def sent(self, unit_id: int, pdu: bytes) -> None:
        """A request goes out to the drives."""

    def abandoned(self) -> None:
        """Its reply is not waited for any longer."""

    def answered(self, port: ControllerPort, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        """A reply goes out to a controller."""

    def answered_early(self, port: ControllerPort, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        """A reply has gone out while that of the drive still came in: :meth:`reply` comes after it."""

    # --- time and commands

    def timer(self, now_ns: int) -> None:
        """A deadline has passed."""

    def rest_first(self, now_ns: int) -> None:
        """The line begins with a silence."""

    def stop(self, now_ns: int) -> None:
        """The line stops."""

    def command(self, command: Command, tables: Sequence[CorrectionTable], now_ns: int) -> None:
        """A command comes in, with the tables that it hands over."""
