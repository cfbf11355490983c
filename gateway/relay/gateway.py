"""The relay: every line of a checked configuration, started, watched and stopped."""

import asyncio
import time
from collections.abc import Callable

import gateway
from gateway.ipc.plan import GatewayPlan
from gateway.relay.errors import StartError
from gateway.relay.journal import Journal, Note
from gateway.relay.line import Line
from gateway.times import NS_PER_S
from gateway.transport.endpoints import TcpEndpoint


class Relay:
    """Runs a plan on the loop of whoever starts it.

    ``write`` gets what happened, a few times a second, off the hot path; without it the newest notes can be
    looked at with :meth:`recent`. A relay lives once: make another one to start again.
    """

    def __init__(self, plan: GatewayPlan, write: Callable[[Note], None] | None = None) -> None:
        self._plan = plan
        self._journal = Journal(write)
        self._lines: list[Line] = []
        self._started_ns = 0

    @property
    def addresses(self) -> dict[tuple[str, str], tuple[TcpEndpoint, ...]]:
        """Where controllers connect, by line and controller: with the ports that the system chose for 0."""
        return {
            (line.plan.name, name): addresses
            for line in self._lines
            for name, addresses in line.addresses.items()
        }

    def address(self, line: str, controller: str) -> TcpEndpoint:
        """Return the (first) address of one controller's listener."""
        return self.addresses[line, controller][0]

    async def start(self) -> None:
        """Open all listeners and ports. Drives that cannot be reached yet are waited for, in the background.

        Raises:
            StartError: with every listener and port that cannot be opened; nothing is left open then.
        """
        self._started_ns = time.monotonic_ns()
        self._journal.start()
        self._lines = [Line(plan, self._journal) for plan in self._plan.lines]
        problems: list[str] = []
        for line in self._lines:
            problems += await line.open()
        if problems:
            for line in self._lines:
                await line.close()
            await self._journal.stop()
            raise StartError(problems)

    async def stop(self) -> None:
        """Take no new requests, let the exchanges on the wires end, close everything."""
        await asyncio.gather(*(line.stop() for line in self._lines))
        await self._journal.stop()

    @property
    def busy_lines(self) -> dict[str, float]:
        """Lines with an exchange on the wire, each with the seconds that a stop waits for it at most."""
        return {line.plan.name: line.longest_stop_s for line in self._lines if not line.is_idle}

    def flush(self) -> None:
        """Write the notes of all that happened until now."""
        self._journal.flush()

    def recent(self) -> tuple[Note, ...]:
        """Return the notes that nobody has written yet, oldest first."""
        return self._journal.recent()

    def status(self) -> dict[str, dict[str, object]]:
        """Return the status model: the gateway, its lines, its axes."""
        axes: dict[str, object] = {}
        for line in self._lines:
            axes.update(line.axes_status())
        uptime_s = (time.monotonic_ns() - self._started_ns) / NS_PER_S
        return {
            "gateway": {
                "name": self._plan.name,
                "version": gateway.__version__,
                "uptime_s": round(uptime_s, 3),
                "relay": "up",
                "snapshot_age_s": 0.0,
            },
            "lines": {line.plan.name: line.status() for line in self._lines},
            "axes": axes,
        }
