"""The supervisor's connection to the relay: subscribes, keeps the newest snapshot, reconnects."""

import asyncio
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from gateway.backoff import Backoff
from gateway.ipc.client import NoGatewayError, check_owner
from gateway.ipc.messages import (
    MAX_REPLY_BYTES,
    SELDOM_S,
    Happened,
    Refused,
    Snapshot,
    Subscribe,
    Subscribed,
    WrongMessageError,
    decode_reply,
    encode,
)
from gateway.status.model import RelayModel

FIRST_WAIT_S: Final = 0.1
LONGEST_WAIT_S: Final = 5.0
QUIET_TRIES: Final = 4
"""Attempts without a message, 1.5 s: a starting relay needs a moment."""


class RelayLink:
    """Keeps a connection to the relay.

    ``on_up`` is called when the relay is connected. ``on_lost`` is called with a sentence when the connection
    is lost or the relay cannot be understood. ``on_event`` is called with every event of the relay, and
    ``on_snapshot`` when there is a newer :attr:`snapshot`.
    """

    def __init__(
        self,
        path: Path,
        on_up: Callable[[], None],
        on_lost: Callable[[str], None],
        on_event: Callable[[Happened], None],
        on_snapshot: Callable[[], None],
    ) -> None:
        self.snapshot: RelayModel | None = None
        """The newest status model. It stays when the relay is lost."""
        self.dropped = 0
        """Number of snapshots and events that were lost because this process was too slow."""
        self._path = path
        self._on_up = on_up
        self._on_lost = on_lost
        self._on_event = on_event
        self._on_snapshot = on_snapshot
        self._snapshot_s: float | None = None
        self._reported = ""
        self._is_up = False
        self._interval_s = SELDOM_S
        self._writer: asyncio.StreamWriter | None = None

    @property
    def snapshot_age_s(self) -> float | None:
        """Age of the snapshot."""
        return None if self._snapshot_s is None else time.monotonic() - self._snapshot_s

    @property
    def is_up(self) -> bool:
        """Whether the relay is connected."""
        return self._is_up

    def want(self, interval_s: float) -> None:
        """Request snapshots at this interval."""
        if interval_s != self._interval_s:
            self._interval_s = interval_s
            self._subscribe()

    async def run(self) -> None:
        """Connect repeatedly; never returns."""
        backoff = Backoff(FIRST_WAIT_S, LONGEST_WAIT_S)
        while True:
            try:
                reader, writer = await self._connect()
            except NoGatewayError as error:
                self._lose(str(error))
            except OSError as error:
                if backoff.failures >= QUIET_TRIES:
                    self._lose(f"{self._path}: {error.strerror or error}")
            else:
                self._writer = writer
                try:
                    why = await self._listen(reader)
                finally:
                    self._writer = None
                    writer.close()
                if self._is_up:
                    self._is_up = False
                    backoff.reset()
                self._lose(why)
            await asyncio.sleep(backoff.next_s())

    async def _connect(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            connection.setblocking(False)
            await asyncio.get_running_loop().sock_connect(connection, str(self._path))
            check_owner(self._path, connection)
        except BaseException:  # also when cancelled: the socket must not stay open
            connection.close()
            raise
        return await asyncio.open_unix_connection(sock=connection, limit=MAX_REPLY_BYTES)

    def _subscribe(self) -> None:
        if self._writer is not None:
            self._writer.write(encode(Subscribe(interval_s=self._interval_s)))

    async def _listen(self, reader: asyncio.StreamReader) -> str:
        """Listen until the connection ends; return why it ended."""
        self._subscribe()
        try:
            while line := await reader.readline():
                message = decode_reply(line)
                match message:
                    case Snapshot():
                        self._take(message)
                    case Happened():
                        self.dropped += message.dropped
                        self._on_event(message)
                    case Refused():
                        return f"the relay refused: {message.reason}"
                    case Subscribed() if self._is_up:
                        pass  # answer to a change of the interval
                    case _:
                        self._is_up, self._reported = True, ""
                        self._on_up()
        except WrongMessageError as error:
            return str(error)
        except (OSError, ValueError) as error:
            return str(error)
        return "the connection was closed"

    def _take(self, message: Snapshot) -> None:
        self.dropped += message.dropped
        self.snapshot = message.status
        self._snapshot_s = time.monotonic()
        self._on_snapshot()

    def _lose(self, why: str) -> None:
        """Report the loss once, not with every attempt."""
        if why != self._reported:
            self._reported = why
            self._on_lost(why)
