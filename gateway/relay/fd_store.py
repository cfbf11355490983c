"""Sockets and ports that outlive this process: the service manager keeps them over the next start.

Each has a name made of where it belongs and of the address or device, so that what is elsewhere now is not
found again: it is closed, here and by the manager. (The settings of a port are set anew in any case.)
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
"""So many addresses are named in a note."""


class FdStore:
    """What the manager handed over, and what it is to keep. ``handed``: names and descriptors."""

    def __init__(self, manager: ServiceManager, handed: Iterable[tuple[str, int]]) -> None:
        self._manager = manager
        self._handed: dict[str, list[int]] = defaultdict(list)
        for name, descriptor in handed:
            self._handed[name].append(descriptor)

    def slot(self, line: str, controller: str, endpoint: TcpEndpoint | SerialEndpoint) -> "FdSlot":
        """Return the place of one listener or port; ``controller`` is empty for the drives of a line."""
        kind, opened_with = (
            ("tcp", repr(endpoint)) if isinstance(endpoint, TcpEndpoint) else ("tty", str(endpoint))
        )
        belongs = repr((line, controller, opened_with)).encode()
        name = f"{kind}-{hashlib.sha256(belongs).hexdigest()[:24]}"
        return FdSlot(self._manager, name, self._handed.pop(name, []))

    def drop_rest(self) -> int:
        """Close what nobody has a place for any more, also at the manager's; returns how many there were."""
        number = 0
        for name, descriptors in self._handed.items():
            self._manager.drop(name)
            for descriptor in descriptors:
                release(descriptor)
                number += 1
        self._handed.clear()
        return number


class FdSlot:
    """The place of one listener, which may have several sockets, or of one port."""

    def __init__(self, manager: ServiceManager, name: str, handed: list[int]) -> None:
        self._manager = manager
        self._name = name
        self._handed = handed

    def take(self) -> list[int]:
        """Return what was kept here; the caller owns it. A second time there is nothing."""
        handed, self._handed = self._handed, []
        return handed

    def store(self, descriptors: Iterable[int]) -> None:
        """Have these kept instead of what was kept here before."""
        self.drop()
        for descriptor in descriptors:
            self._manager.store(self._name, descriptor)

    def drop(self) -> None:
        """Have nothing kept here any more."""
        self._manager.drop(self._name)


async def open_kept(
    listener: TcpListener, endpoint: TcpEndpoint, slot: FdSlot, log: Callable[[EventEntry, str], None]
) -> None:
    """Open a listener with the sockets that were kept of it, else anew; and have them kept.

    Who connected while no gateway ran is turned away and may connect again: what it had sent is not done.

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
    """Give a port what was kept of it, and have each opening kept; returns whether there was something."""
    port.kept = adopted_port(slot.take(), endpoint.device)
    port.on_open = lambda descriptor: slot.store([descriptor])
    # An adapter that comes back gets its name only when nobody has the old one open.
    port.on_lost = slot.drop
    return port.kept is not None
