"""Sockets and ports that outlive this process: the service manager keeps them until the next start.

The name of each is made of its line, controller and address or device. If one of these changes, the old
descriptor is not found again: it is closed, here and at the manager. (The settings of a port are set again in
any case.)
"""

import hashlib
from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import Final

from gateway.catalogue import starts
from gateway.catalogue.entry import EventEntry
from gateway.catalogue.line_events import WAITING_TURNED_AWAY
from gateway.ipc.service_manager import ServiceManager
from gateway.transport.adopting import adopted_listeners, adopted_port, release
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.errors import RefusedError
from gateway.transport.serial import SerialPort
from gateway.transport.tcp import TcpListener

NAMED: Final = 3
"""Number of addresses that a log entry names."""


class FdStore:
    """What the manager handed over and what it must keep. ``handed``: names and descriptors."""

    def __init__(self, manager: ServiceManager, handed: Iterable[tuple[str, int]]) -> None:
        self._manager = manager
        self._handed: dict[str, list[int]] = defaultdict(list)
        for name, descriptor in handed:
            self._handed[name].append(descriptor)

    def slot(self, line: str, controller: str, endpoint: TcpEndpoint | SerialEndpoint) -> "FdSlot":
        """Return the slot of one listener or port; ``controller`` is empty for the drives of a line."""
        kind, opened_with = (
            ("tcp", repr(endpoint)) if isinstance(endpoint, TcpEndpoint) else ("tty", str(endpoint))
        )
        belongs = repr((line, controller, opened_with)).encode()
        name = f"{kind}-{hashlib.sha256(belongs).hexdigest()[:24]}"
        return FdSlot(self._manager, name, self._handed.pop(name, []))

    def drop_rest(self) -> int:
        """Close every descriptor without a slot, also at the manager; return how many there were."""
        number = 0
        for name, descriptors in self._handed.items():
            self._manager.drop(name)
            for descriptor in descriptors:
                release(descriptor)
                number += 1
        self._handed.clear()
        return number


class FdSlot:
    """The slot of one listener, which may have several sockets, or of one port."""

    def __init__(self, manager: ServiceManager, name: str, handed: list[int]) -> None:
        self._manager = manager
        self._name = name
        self._handed = handed

    def take(self) -> list[int]:
        """Return the stored descriptors; the caller owns them. A second call returns none."""
        handed, self._handed = self._handed, []
        return handed

    def store(self, descriptors: Iterable[int]) -> None:
        """Store these instead of the previous ones."""
        self.drop()
        for descriptor in descriptors:
            self._manager.store(self._name, descriptor)

    def drop(self) -> None:
        """Store nothing any more."""
        self._manager.drop(self._name)


async def open_kept(
    listener: TcpListener, endpoint: TcpEndpoint, slot: FdSlot, log: Callable[[EventEntry, str], None]
) -> None:
    """Open a listener with its stored sockets, else with new ones, and store them.

    Clients that connected while no gateway ran are rejected and may connect again: their requests are not
    carried out.

    Raises:
        RefusedError: as of ``TcpListener.open``.
    """
    try:
        sockets, waited = await adopted_listeners(slot.take(), endpoint)
    except OSError as error:
        slot.drop()
        raise RefusedError(f"{starts.CANNOT_REJECT_WAITING.begin(endpoint=endpoint)}: {error}") from error
    if waited:
        log(
            WAITING_TURNED_AWAY,
            f"{len(waited)} connected while no gateway ran ({', '.join(sorted(set(waited))[:NAMED])}): "
            "closed, and what they had sent was not done",
        )
    await listener.open(sockets)
    slot.store(each.fileno() for each in listener.sockets)


def store_port(port: SerialPort, endpoint: SerialEndpoint, slot: FdSlot) -> bool:
    """Give a port its stored descriptor and store each new one; return whether there was one."""
    port.kept = adopted_port(slot.take(), endpoint.device)
    port.on_open = lambda descriptor: slot.store([descriptor])
    # A returning adapter gets its old name only if no process has the old device open.
    port.on_lost = slot.drop
    return port.kept is not None
