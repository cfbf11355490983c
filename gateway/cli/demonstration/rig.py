"""The simulated machine on real sockets and pseudo terminals, with the controllers that command it."""

import random
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Final, Self

from gateway.cli.demonstration.spec import AxisSpec, Cable
from gateway.simulator.axis import SimulatedAxis
from gateway.simulator.bus import DriveBus
from gateway.simulator.clock import SimulationClock
from gateway.simulator.controller import AxisController
from gateway.simulator.drive import SimulatedDrive
from gateway.simulator.endpoints import SerialDriveServer, TcpDriveServer
from gateway.simulator.laser import Laser
from gateway.simulator.mechanics import Encoder, Mechanics
from gateway.simulator.motion import Dynamics
from gateway.simulator.pty import Pty
from gateway.simulator.screw import worn_screw
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.master import ModbusMaster
from gateway.transport.null_modem import NullModem

LOOPBACK: Final = "127.0.0.1"
PATIENCE_MS: Final = 10_000.0
"""Nobody gives up early: a busy computer may make a whole demonstration stand still for seconds."""
LASER_NOISE_UM: Final = 0.1
BACKLASH_UM: Final = (25.0, 45.0)
DYNAMICS: Final = Dynamics(speed_mm_s=200.0, acceleration_mm_s2=4000.0)


class RigAxis:
    """One axis of the machine, and both of its cables."""

    def __init__(self, spec: AxisSpec, seed: int, clock: SimulationClock) -> None:
        rng = random.Random(f"{seed}/{spec.name}")
        self.spec = spec
        self.clock = clock
        self.mechanics = Mechanics(
            worn_screw(rng, spec.low * spec.mm, (spec.high - spec.low) * spec.mm, spec.lead_mm),
            Encoder(spec.counts_per_unit / spec.mm, spec.zero_counts),
            backlash_mm=rng.uniform(*BACKLASH_UM) / 1000.0,
            dynamics=DYNAMICS,
        )
        self.laser = Laser(self.mechanics, noise_um=LASER_NOISE_UM, seed=rng.getrandbits(32))
        self.target_rng = rng
        self.drive_address = ""
        """Where the gateway finds the drive: HOST:PORT, or the path of a port."""
        self.controller_address = ""
        """What the gateway opens for the controller."""
        self._controller_end: TcpEndpoint | SerialEndpoint | None = None
        self._exits = AsyncExitStack()

    async def open(self) -> None:
        """Bring the drive onto its cable and lay the controller's."""
        axis = SimulatedAxis(self.spec.name, self.spec.registers, self.mechanics)
        bus = DriveBus([SimulatedDrive(self.spec.unit_id, [axis])])
        if self.spec.drive is Cable.TCP:
            tcp = TcpDriveServer(bus, self.clock, host=LOOPBACK)
            await tcp.start()
            self._exits.push_async_callback(tcp.stop)
            self.drive_address = f"{LOOPBACK}:{tcp.port}"
        else:
            pty = Pty()
            self._exits.callback(pty.close)
            self._exits.callback(SerialDriveServer(bus, self.clock, pty.master_fd).close)
            self.drive_address = pty.path
        if self.spec.controller is Cable.TCP:
            self._controller_end = TcpEndpoint(LOOPBACK, free_port())
            self.controller_address = str(self._controller_end)
        else:
            cable = NullModem()
            self._exits.callback(cable.close)
            self._controller_end = SerialEndpoint(cable.far)
            self.controller_address = cable.near

    async def close(self) -> None:
        """Take everything away."""
        await self._exits.aclose()

    @asynccontextmanager
    async def controller(self) -> AsyncIterator[AxisController]:
        """Connect the controller to the gateway, which must be running."""
        assert self._controller_end is not None
        async with ModbusMaster(self._controller_end, PATIENCE_MS) as master:
            yield AxisController(master, self.spec.wiring)


class Rig:
    """All axes; enter it to have them on their cables."""

    def __init__(self, specs: tuple[AxisSpec, ...], seed: int, clock: Callable[[], float]) -> None:
        self.axes = tuple(RigAxis(spec, seed, clock) for spec in specs)

    async def __aenter__(self) -> Self:
        """Open everything."""
        for axis in self.axes:
            await axis.open()
        return self

    async def __aexit__(self, *exc_info: object) -> None:
        """Close everything."""
        for axis in self.axes:
            await axis.close()


def free_port() -> int:
    """Return a TCP port that nobody listens on now."""
    with socket.create_server((LOOPBACK, 0)) as listener:
        port: int = listener.getsockname()[1]
    return port
