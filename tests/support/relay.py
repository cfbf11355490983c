"""A relay in the process of the test, between a controller and drives that it plays.

Real sockets and pseudo terminals; ``gateway.py`` has the same as processes.
"""

import asyncio
import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from gateway.compensation.settings import AxisSettings
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.plan import (
    NO_OTHER_UNITS,
    AxisPlan,
    CompensationMode,
    ControllerPlan,
    LineTiming,
    OtherUnits,
    Reference,
    Role,
)
from gateway.ipc.log import LogEntry
from gateway.modbus.registers import PositionField, RegisterType
from gateway.relay.gateway import Relay
from gateway.state.plan import ControllerLink, GatewayPlan, LinePlan
from gateway.transport.channel import Channel
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.null_modem import NullModem
from gateway.transport.serial import SerialPort
from gateway.transport.tcp import TcpConnector, TcpListener
from tests.support.status_models import plain

PATIENCE_S = 30.0
LOOPBACK = TcpEndpoint("127.0.0.1", 0)
KINDS = ("tcp", "rtu")
TIMING = LineTiming(response_timeout_ms=200.0, drain_ms=20.0, turnaround_ms=5.0)
COMMAND, ACTUAL, OTHER = 100, 110, 200
"""Addresses: where a position is commanded, where it is reported, and registers that mean nothing to us."""
QUICK = LineTiming(response_timeout_ms=20.0, drain_ms=5.0, turnaround_ms=1.0)
Script = Callable[[bytes], bytes | None]


def axis_plan(compensation: CompensationMode = CompensationMode.ON) -> AxisPlan:
    """1000 counts/mm; +0.05 mm at 50 mm, so 50 000 counts are sent as 50 050."""
    return AxisPlan(
        name="x",
        unit_id=1,
        settings=AxisSettings(units=Units.MM, counts_per_unit=1000.0, travel=(-1.0, 101.0)),
        table=make_table([0.0, 100.0], [0.0, 0.1], [0.0, 0.1], Units.MM),
        compensation=compensation,
        referenced=Reference.ABSOLUTE,
        command=(PositionField(COMMAND, RegisterType.INT32),),
        actual=(PositionField(ACTUAL, RegisterType.INT32),),
    )


class RawEnd:
    """A receiver that keeps all bytes; with a script it answers like a drive."""

    def __init__(self, script: Script | None = None) -> None:
        self.channel: Channel | None = None
        self.data = b""
        self.opens = 0
        self.closes = 0
        self.script = script
        self._changed = asyncio.Event()

    def opened(self, channel: Channel, now_ns: int) -> None:
        self.channel = channel
        self.opens += 1
        self._changed.set()

    def received(self, data: bytes, now_ns: int) -> None:
        self.data += data
        self._changed.set()
        answer = None if self.script is None else self.script(data)
        if answer:
            self.write(answer)

    def closed(self, reason: str, now_ns: int) -> None:
        self.closes += 1
        self._changed.set()

    def write(self, data: bytes) -> None:
        assert self.channel is not None
        self.channel.write(data)

    async def until(self, condition: Callable[["RawEnd"], bool]) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while not condition(self):
                self._changed.clear()
                await self._changed.wait()

    async def receives(self, data: bytes) -> None:
        """Wait for as many bytes as ``data`` has; they must be just those."""
        await self.until(lambda end: len(end.data) >= len(data))
        assert self.data == data
        self.data = b""


def _no_failure(why: str) -> None:
    pass


@dataclass
class Bench:
    """Everything around one relay. Closed from the outside in by ``aclose``."""

    stack: contextlib.AsyncExitStack = field(default_factory=contextlib.AsyncExitStack)
    notes: list[LogEntry] = field(default_factory=list)

    def cable(self) -> NullModem:
        cable = NullModem()
        self.stack.callback(cable.close)
        return cable

    async def drive(
        self, kind: str, script: Script | None = None
    ) -> tuple[RawEnd, TcpEndpoint | SerialEndpoint]:
        """Open a drive that answers by its script; returns it and where the relay reaches it."""
        end = RawEnd(script)
        if kind == "rtu":
            cable = self.cable()
            await self._open(SerialPort(SerialEndpoint(cable.far, 115200), end, _no_failure))
            return end, SerialEndpoint(cable.near, 115200, "E")
        listener = TcpListener(LOOPBACK, (), lambda: end, lambda host, why: None)
        await self._open(listener)
        where = listener.addresses[0]
        return end, TcpEndpoint(where.host, where.port, rtu=kind == "rtu_over_tcp")

    async def relay(
        self,
        drives: TcpEndpoint | SerialEndpoint,
        controllers: tuple[ControllerLink, ...],
        axes: tuple[AxisPlan, ...] = (),
        timing: LineTiming | None = None,
        status_unit: int = 0,
        *,
        other_units: OtherUnits = NO_OTHER_UNITS,
        tape_bytes: int = 0,
    ) -> Relay:
        line = LinePlan(
            "line",
            drives,
            controllers,
            axes,
            timing or TIMING,
            other_units=other_units,
            tape_bytes=tape_bytes,
        )
        return await self.start(GatewayPlan("bench", (line,), status_unit=status_unit))

    async def start(self, plan: GatewayPlan, **options: Any) -> Relay:
        """Start a relay; it is stopped with the bench."""
        relay = Relay(plan, self.notes.append, **options)
        await relay.start()
        self.stack.push_async_callback(relay.stop)
        return relay

    async def connect(self, endpoint: TcpEndpoint) -> RawEnd:
        """Connect a raw Modbus/TCP controller."""
        end = RawEnd()
        await self._open(TcpConnector(endpoint, end, _no_failure))
        await end.until(lambda each: each.opens == 1)
        return end

    async def plug(self, device: str, script: Script | None = None) -> RawEnd:
        """Open a serial device as a raw RTU controller; ``script``: what it sends for what it hears."""
        end = RawEnd(script)
        await self._open(SerialPort(SerialEndpoint(device, 115200), end, _no_failure))
        return end

    async def raw_pair(
        self,
        controller: str,
        drives: str,
        script: Script | None = None,
        timeout_ms: float = 2000.0,
        role: Role = Role.MOTION,
        **options: Any,
    ) -> tuple[RawEnd, RawEnd, Relay]:
        """A raw controller, a raw drive, and a relay between them; ``options`` are those of ``relay``."""
        drive, where = await self.drive(drives, script)
        link, device = self.controller_link(controller, role=role, timeout_ms=timeout_ms)
        relay = await self.relay(where, (link,), **options)
        await until_up(relay)
        if device:
            return await self.plug(device), drive, relay
        return await self.connect(relay.address("line", "cnc")), drive, relay

    def controller_link(
        self, kind: str, name: str = "cnc", role: Role = Role.MOTION, timeout_ms: float = 2000.0
    ) -> tuple[ControllerLink, str]:
        """A controller of the relay; with the device of its other end where it is a serial one."""
        plan = ControllerPlan(name, role, timeout_ms=timeout_ms, serial=kind == "rtu")
        if kind == "rtu":
            cable = self.cable()
            return ControllerLink(plan, SerialEndpoint(cable.near, 115200, "E")), cable.far
        return ControllerLink(plan, LOOPBACK), ""

    async def _open(self, way: SerialPort | TcpConnector | TcpListener) -> None:
        self.stack.push_async_callback(way.close)
        await way.open()


async def eventually(condition: Callable[[], bool]) -> None:
    """Let the loop run until something holds that tells nobody when it begins to."""
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110 - see above
            await asyncio.sleep(0)


def line_status(relay: Relay) -> dict[str, object]:
    status: dict[str, object] = plain(relay.status().lines["line"])
    return status


def first_controller(relay: Relay) -> dict[str, object]:
    controllers = line_status(relay)["controllers"]
    assert isinstance(controllers, list)
    status = controllers[0]
    assert isinstance(status, dict)
    return status


async def until_up(relay: Relay) -> None:
    await eventually(lambda: line_status(relay)["state"] == "up")
