"""The loop and the log of a simulated process.

The loop is the relay's own, with its selector; sockets come from the simulated network, and what would run in
a thread runs at once. The log is written at once too: ``tests/ipc`` tests its thread.
"""

import asyncio
from collections.abc import Callable
from typing import Any

from gateway.ipc.log import LogEntry
from gateway.ipc.log_thread import LogThread
from gateway.transport.loop import RelayLoop
from tests.year.machine import S
from tests.year.network import HOST, Listening, Network, Socket, Stream
from tests.year.system import MACHINE, boot_ns


class SimulatedLoop(RelayLoop):
    """The relay's loop on the simulated machine."""

    def __init__(self, network: Network) -> None:
        self._network = network
        super().__init__()

    def time(self) -> float:
        """See ``asyncio``."""
        return boot_ns() / S

    def add_signal_handler(  # type: ignore[override]
        self, sig: int, callback: Callable[..., object], *args: Any
    ) -> None:
        """See ``asyncio``; the machine sends signals."""
        MACHINE.signals[sig] = lambda: self.call_soon(callback, *args)

    def remove_signal_handler(self, sig: int) -> bool:
        """See ``asyncio``."""
        return MACHINE.signals.pop(sig, None) is not None

    def run_in_executor(  # type: ignore[override]
        self, executor: Any, func: Callable[..., Any], *args: Any
    ) -> "asyncio.Future[Any]":
        """See ``asyncio``: no thread."""
        future = self.create_future()
        try:
            future.set_result(func(*args))
        except Exception as error:  # noqa: BLE001 - it is handed on
            future.set_exception(error)
        return future

    async def getaddrinfo(self, host: Any, port: Any, **_: Any) -> Any:
        """See ``asyncio``: addresses only, no names."""
        return [(Socket.family, Socket.type, Socket.proto, "", (host, port))]

    async def create_connection(
        self, protocol_factory: Any, host: Any = None, port: Any = None, **_: Any
    ) -> Any:
        """See ``asyncio``."""
        sock = Socket(self._network, Stream(self._network, (HOST, self._network.own_port()), (host, port)))
        try:
            await self.sock_connect(sock, (host, port))  # type: ignore[arg-type]
        except BaseException:
            sock.close()
            raise
        return await super().create_connection(protocol_factory, sock=sock)  # type: ignore[call-overload]

    async def create_server(self, protocol_factory: Any, host: Any = None, port: Any = None, **_: Any) -> Any:
        """See ``asyncio``: bound, and not listening yet."""
        return _Bound(Socket(self._network, Listening(self._network, (host, port))))


class _Bound:
    """What ``create_server`` returns."""

    def __init__(self, sock: Socket) -> None:
        self.sockets = [sock]

    def close(self) -> None:
        """Close it; its socket was taken before."""


class LogAtOnce(LogThread):
    """Writes each entry as it comes, without a thread: the account must know of a flag before the frame."""

    def __init__(self, write: Callable[[LogEntry], None]) -> None:
        super().__init__(write)
        self._write_entry = write

    def start(self) -> None:
        """No thread."""

    async def __aexit__(self, *_: object) -> None:
        """See ``LogThread``; a killed process comes here too, with no loop any more."""

    def put(self, entry: LogEntry) -> None:
        """See ``LogThread``."""
        self._write_entry(entry)

    def wake(self) -> None:
        """Nothing waits."""

    def write(self, entry: LogEntry) -> None:
        """See ``LogThread``."""
        self._write_entry(entry)

    def close(self, wait_s: float = 0.0) -> None:
        """Nothing waits."""
