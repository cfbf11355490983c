"""A simulated machine around a gateway: every drive of its configuration, at its own address."""

import random
from collections.abc import Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

from gateway.compensation.units import Units
from gateway.drives.motion import Form
from gateway.exchange.plan import AxisPlan
from gateway.simulator.bus import DriveBus
from gateway.simulator.clock import SimulationClock
from gateway.simulator.drive import SimulatedAxis, SimulatedDrive
from gateway.simulator.drives.catalogue import DRIVES
from gateway.simulator.drives.motor_drive import Motor
from gateway.simulator.endpoints import Delay, SerialDriveServer, TcpDriveServer
from gateway.simulator.gauge import VirtualGauge
from gateway.simulator.mechanics import Mechanics, encoder_of, unit_mm
from gateway.simulator.motion import Dynamics
from gateway.simulator.pty import PortLinks
from gateway.simulator.screw import worn_screw
from gateway.simulator.server import MAX_READ_REGISTERS, MAX_WRITE_REGISTERS, RegisterServer
from gateway.simulator.wire import PLAIN, Cable, SerialWire
from gateway.state.plan import ControllerLink, GatewayPlan, LinePlan
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint

CONTROLLER_SUFFIX: Final = ".controller"
LEAD_MM: Final = 5.0
MOST_UM_PER_M: Final = 200.0
"""Below the limit at which `table build` suspects a wrong scale, so that measuring can be practised."""
DEFAULT_TRAVEL_MM: Final = (0.0, 500.0)
DEFAULT_SPEED_MM_S: Final = 100.0
ACCELERATION_S: Final = 0.05
"""Every simulated axis reaches its full speed in this time."""


@dataclass(frozen=True, slots=True)
class ServedAxis:
    """One simulated axis, as printed."""

    name: str
    unit_id: int
    backlash_um: float
    drive: str = ""
    """Make of its drive; empty for the generic drive, which moves when a position is written."""


@dataclass(frozen=True, slots=True)
class ControllerPath:
    """Where a controller connects, and what the gateway opens for it."""

    name: str
    gateway_opens: str
    controller_opens: str


@dataclass(frozen=True, slots=True)
class ServedLine:
    """One line's drives and controllers, as printed."""

    name: str
    kind: str
    address: str
    axes: tuple[ServedAxis, ...]
    controllers: tuple[ControllerPath, ...]


def simulated_axis(plan: AxisPlan, seed: int) -> SimulatedAxis:
    """Return an axis of the generic drive, with the registers of its plan."""
    return SimulatedAxis.from_plan(plan, simulated_mechanics(plan, seed))


def simulated_mechanics(plan: AxisPlan, seed: int) -> Mechanics:
    """Return a worn screw with 20 to 45 µm of backlash, the same for the same seed and name.

    The axis is at machine position 0, or at the end of travel nearest to it.
    """
    rng = random.Random(f"{seed}/{plan.name}")
    settings = plan.settings
    mm = unit_mm(settings.units)
    low, high = (end * mm for end in settings.travel) if settings.travel else DEFAULT_TRAVEL_MM
    speed = settings.max_speed * mm or DEFAULT_SPEED_MM_S
    return Mechanics(
        worn_screw(rng, low, high - low, LEAD_MM, most_um_per_m=MOST_UM_PER_M),
        encoder_of(settings),
        backlash_mm=rng.uniform(0.020, 0.045),
        dynamics=Dynamics(speed, speed / ACCELERATION_S),
        start_mm=min(max(0.0, low), high),
    )


def simulated_bus(axes: Sequence[AxisPlan], seed: int) -> DriveBus:
    """Return the drives of one line: axes with the same unit id share a drive.

    Raises:
        SimulatorError: more axes with one unit id than their drive can have.
    """
    units = dict.fromkeys(axis.unit_id for axis in axes)
    return DriveBus(_drive([axis for axis in axes if axis.unit_id == unit], seed) for unit in units)


def _drive(axes: Sequence[AxisPlan], seed: int) -> RegisterServer:
    make = DRIVES.get(axes[0].drive)
    if make is not None:
        return make(axes[0].unit_id, [Motor(a.name, simulated_mechanics(a, seed)) for a in axes])
    most = min(axis.max_registers for axis in axes)
    return SimulatedDrive(
        axes[0].unit_id,
        [simulated_axis(axis, seed) for axis in axes],
        max_registers=most if most < MAX_WRITE_REGISTERS else MAX_READ_REGISTERS,
        without=(16,) if axes[0].writes_with is Form.FC06 else (),
    )


class World:
    """Everything outside the gateway. Entering it opens every endpoint; leaving it removes ports and links.

    With ``paced`` serial bytes take the time that they need at the baud rate of their port, and drives of a
    known make have that make's response delay. ``cable`` describes its serial lines beyond their baud rate.
    """

    def __init__(
        self,
        plan: GatewayPlan,
        clock: SimulationClock,
        *,
        seed: int = 0,
        paced: bool = True,
        cable: Cable = PLAIN,
    ) -> None:
        self.served: tuple[ServedLine, ...] = ()
        self.buses: dict[str, DriveBus] = {}
        self._plan = plan
        self._clock = clock
        self._seed = seed
        self._paced = paced
        self._cable = cable
        self._exits = AsyncExitStack()
        self._ports = PortLinks()

    async def __aenter__(self) -> Self:
        """Open every endpoint.

        Raises:
            SimulatorError: an address or a port that cannot be served; nothing stays open.
        """
        try:
            self._exits.callback(self._ports.close)
            self.served = tuple([await self._serve(line) for line in self._plan.lines])
        except BaseException:  # also when cancelled: no endpoint may stay open
            await self._exits.aclose()
            raise
        return self

    async def __aexit__(self, *exc_info: object) -> None:
        """Close everything."""
        await self._exits.aclose()

    def add_gauges(self) -> dict[str, VirtualGauge]:
        """Put a laser at each axis that measures a length; return them by the paths of their ports.

        Raises:
            SimulatorError: a port that cannot be made.
        """
        gauges = {}
        plans = {plan.name: plan for line in self._plan.lines for plan in line.axes}
        for axis in (axis for bus in self.buses.values() for drive in bus.drives for axis in drive.axes):
            plan = plans[axis.name]
            if plan.settings.units is Units.DEGREE:
                continue  # measure takes lengths only
            path = f"gauge-{axis.name}"
            port = self._ports.make(Path(path)).master_fd
            gauges[path] = VirtualGauge(plan, axis.mechanics, port, self._clock, seed=self._seed)
            self._exits.callback(gauges[path].close)
        return gauges

    async def _serve(self, line: LinePlan) -> ServedLine:
        bus = self.buses[line.name] = simulated_bus(line.axes, self._seed)
        if isinstance(line.drives, TcpEndpoint):
            await self._serve_tcp(bus, line.drives)
            kind = "rtu_over_tcp" if line.drives.rtu else "tcp"
        else:
            self._serve_serial(bus, line.drives)
            kind = "rtu"
        makes = {axis.name: axis.drive for axis in line.axes if axis.drive in DRIVES}
        axes = [
            ServedAxis(
                axis.name,
                drive.unit_id,
                round(axis.mechanics.backlash_mm * 1000.0, 1),
                makes.get(axis.name, ""),
            )
            for drive in bus.drives
            for axis in drive.axes
        ]
        controllers = [self._controller(link) for link in line.controllers]
        return ServedLine(line.name, kind, str(line.drives), tuple(axes), tuple(controllers))

    async def _serve_tcp(self, bus: DriveBus, endpoint: TcpEndpoint) -> None:
        server = TcpDriveServer(
            bus,
            self._clock,
            host=endpoint.host,
            port=endpoint.port,
            rtu=endpoint.rtu,
            response_delay_s=self._delay(bus, 0),
        )
        await server.start()
        self._exits.push_async_callback(server.stop)

    def _serve_serial(self, bus: DriveBus, endpoint: SerialEndpoint) -> None:
        pty = self._ports.make(Path(endpoint.device))
        wire = endpoint if self._paced else None
        delay = self._delay(bus, endpoint.baudrate)
        server = SerialDriveServer(
            bus, self._clock, pty.master_fd, wire=wire, response_delay_s=delay, cable=self._cable
        )
        self._exits.callback(server.close)

    def _delay(self, bus: DriveBus, baudrate: int) -> Delay:
        return (
            (lambda unit_id: bus.response_delay_s(unit_id, baudrate)) if self._paced else lambda _unit_id: 0.0
        )

    def _controller(self, link: ControllerLink) -> ControllerPath:
        endpoint = link.endpoint
        if isinstance(endpoint, TcpEndpoint):
            return ControllerPath(link.plan.name, str(endpoint), str(endpoint))
        controller_path = Path(endpoint.device + CONTROLLER_SUFFIX)
        gateway_side = self._ports.make(Path(endpoint.device))
        controller_side = self._ports.make(controller_path)
        wire = SerialWire(
            gateway_side.master_fd,
            controller_side.master_fd,
            endpoint if self._paced else None,
            self._cable,
        )
        self._exits.callback(wire.close)
        return ControllerPath(link.plan.name, endpoint.device, str(controller_path))
