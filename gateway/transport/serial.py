"""Serial ports that are kept open: the loop reads and writes their descriptors."""

import asyncio
from collections.abc import Callable

from gateway.status.line import LatencySettings
from gateway.transport.channel import Receiver
from gateway.transport.devices import open_port
from gateway.transport.endpoints import SerialEndpoint
from gateway.transport.errors import AbsentError
from gateway.transport.reconnector import Reconnector
from gateway.transport.serial_channel import SerialChannel


class SerialPort:
    """Keeps the port of ``endpoint`` open; an adapter may be unplugged and come back.

    The configured path is resolved again each time: a link under ``/dev/serial/by-id`` finds its adapter
    under any new number.
    """

    def __init__(
        self,
        endpoint: SerialEndpoint,
        receiver: Receiver,
        on_failure: Callable[[str], None],
        on_slow: Callable[[str], None] | None = None,
    ) -> None:
        self._endpoint = endpoint
        self._receiver = receiver
        self._reconnector = Reconnector(self._attempt, self._was_heard, on_failure)
        self._on_slow = on_slow
        self._slow: tuple[str, ...] = ()
        self._settings = LatencySettings()
        self._channel: SerialChannel | None = None
        self.notes: tuple[str, ...] = ()
        """Requested settings that the port does not have."""
        self.kept: int | None = None
        """A descriptor of the port that is already open: the first opening takes it."""
        self.on_open: Callable[[int], None] = _ignore_descriptor
        """Gets the descriptor of each opening, before the first byte."""
        self.on_lost: Callable[[], None] = _drop_nothing
        """Called when the port was lost; not when it is closed."""

    @property
    def latency(self) -> LatencySettings:
        """The driver settings that delay bytes, as read back at the last opening."""
        return self._settings

    @property
    def is_open(self) -> bool:
        """Whether the port is open now."""
        return self._channel is not None and not self._channel.lost.done()

    @property
    def is_kept_up(self) -> bool:
        """Whether it is still kept open: only a bug of this program ends that."""
        return self._reconnector.is_running

    @property
    def failure(self) -> str:
        """Why the last attempt to open the port failed; empty while it is open."""
        return self._reconnector.failure

    @property
    def opens(self) -> int:
        """How often the port was opened."""
        return self._reconnector.opens

    async def open(self) -> None:
        """Open the port; if it is absent, open it as soon as it appears.

        Raises:
            RefusedError: in use, no permission, not a serial port. Later these are only retried.
        """
        lost: asyncio.Future[None] | None = None
        try:
            lost = self._open()
        except AbsentError as error:
            self._reconnector.failed(error.detail)
        self._reconnector.start(lost)

    async def close(self) -> None:
        """Close, and stop retrying."""
        await self._reconnector.stop()
        self.on_lost = _drop_nothing
        if self._channel is not None:
            await self._channel.drained()
            self._channel.close()

    def _was_heard(self) -> bool:
        return self._channel is not None and self._channel.bytes_received > 0

    async def _attempt(self) -> "asyncio.Future[None]":
        return self._open()

    def _open(self) -> "asyncio.Future[None]":
        self._channel = None
        kept, self.kept = self.kept, None
        port, opened = open_port(self._endpoint, kept)
        self.notes, self._settings = (*opened.notes, *opened.slow), opened.settings
        self._report_slow(opened.slow)
        self._channel = SerialChannel(port, self._endpoint, self._receiver)
        self.on_open(port.fileno())
        self._channel.lost.add_done_callback(lambda _: self.on_lost())
        self._channel.begin()
        return self._channel.lost

    def _report_slow(self, slow: tuple[str, ...]) -> None:
        """Report what delays bytes; not again when an adapter comes back with the same settings."""
        is_news, self._slow = slow != self._slow, slow
        if slow and is_news and self._on_slow is not None:
            self._on_slow("; ".join(slow))


def _ignore_descriptor(_descriptor: int) -> None:
    pass


def _drop_nothing() -> None:
    pass
