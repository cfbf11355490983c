"""A drive on its own kind of cable, and controllers that speak to it."""

from contextlib import AsyncExitStack
from pathlib import Path
from typing import Final

from gateway.simulator.bus import DriveBus
from gateway.simulator.drives.catalogue import DRIVES
from gateway.simulator.drives.motor_drive import Motor
from gateway.simulator.endpoints import SerialDriveServer, TcpDriveServer
from gateway.simulator.ledger import MoveKind
from gateway.simulator.mechanics import Encoder, Mechanics
from gateway.simulator.motion import Dynamics
from gateway.simulator.pty import Pty
from gateway.simulator.screw import Screw
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.master import ModbusMaster
from tests.contract.script import MachineClock, Session

LOOPBACK: Final = "127.0.0.1"
PATIENCE_S: Final = 10.0
COUNTS_PER_MM: Final = 1000.0
FOLDER: Final = Path(__file__).parent / "sessions"
SESSIONS: Final = tuple(map(Session.read, sorted(FOLDER.glob("*.toml"))))


class DriveBench:
    """One drive behind a port of its own, standing at ``start_mm``; leave the stack to take it away."""

    def __init__(self, session: Session, exits: AsyncExitStack, start_mm: float = 0.0) -> None:
        self.session = session
        self.clock = MachineClock()
        mechanics = Mechanics(
            Screw(), Encoder(COUNTS_PER_MM), dynamics=Dynamics(100.0, 1000.0), start_mm=start_mm
        )
        self.bus = DriveBus([DRIVES[session.drive](session.unit_id, [Motor("x", mechanics)])])
        self._exits = exits

    @property
    def moves(self) -> tuple[tuple[MoveKind, int | None], ...]:
        """What the drive was made to do; it knew all that it was told."""
        assert not self.bus.ledger.unheard_of
        return tuple(self.bus.ledger.moves_of(self.session.unit_id))

    async def serve(self) -> TcpEndpoint | SerialEndpoint:
        """Bring the drive onto its cable; return where it is reached."""
        if self.session.kind == "tcp":
            server = TcpDriveServer(self.bus, self.clock)
            await server.start()
            self._exits.push_async_callback(server.stop)
            return TcpEndpoint(LOOPBACK, server.port)
        pty = self.pty()
        self._exits.callback(SerialDriveServer(self.bus, self.clock, pty.master_fd).close)
        return SerialEndpoint(pty.path, 115200)

    async def master(self, endpoint: TcpEndpoint | SerialEndpoint) -> ModbusMaster:
        """Open a controller's end."""
        return await self._exits.enter_async_context(ModbusMaster(endpoint, PATIENCE_S * 1000.0))

    def pty(self) -> Pty:
        """Make a serial port."""
        pty = Pty()
        self._exits.callback(pty.close)
        return pty
