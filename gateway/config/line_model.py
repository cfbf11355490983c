"""``[line.NAME]``: one bus of drives and the controllers that may use it."""

from collections.abc import Collection
from enum import Enum
from typing import Annotated, Self

from pydantic import Field, model_validator

from gateway.config.rights_model import RightsKeys, RoleKeys
from gateway.config.tls_model import ControllerTls, RoleName
from gateway.config.values import (
    Device,
    Milliseconds,
    MillisecondsOrZero,
    Name,
    Network,
    RtuOverTcp,
    Tcp,
    UnitId,
)
from gateway.drives.strict import ByName, ListOf, StrictModel
from gateway.exchange.plan import LineTiming, Role
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.limits import DEFAULT_LIMITS, ConnectionLimits

SERIAL_KEYS = frozenset({"baudrate", "parity", "stop_bits", "data_bits", "echo", "low_latency", "rs485"})
TCP_KEYS = frozenset({"allow", "max_connections", "connects_per_s", "idle_timeout_s"})
_TIMING = LineTiming()
_SERIAL = SerialEndpoint("")


class Parity(Enum):
    """Parity of a serial character."""

    NONE = "none"
    EVEN = "even"
    ODD = "odd"

    @property
    def letter(self) -> str:
        """The letter that serial ports know it by."""
        return self.value[0].upper()


class _SerialSettings(StrictModel):
    """The character format of a serial port, and the rule that it belongs to one."""

    rtu: Device | None = Field(default=None, description="path of a serial port that carries Modbus RTU")
    tcp: Tcp | None = Field(default=None, description="HOST:PORT of Modbus TCP")
    baudrate: Annotated[int, Field(ge=50, le=12_000_000)] = Field(
        default=_SERIAL.baudrate, description="bits per second of the serial port"
    )
    parity: ByName[Parity] = Field(default=Parity.NONE, description="parity of the serial port")
    stop_bits: Annotated[int, Field(ge=1, le=2)] = Field(
        default=_SERIAL.stop_bits, description="stop bits of the serial port"
    )
    # RTU carries whole bytes (Modbus over serial line V1.02, 2.5.1).
    data_bits: Annotated[int, Field(ge=8, le=8)] = Field(
        default=_SERIAL.data_bits, description="data bits of the serial port; RTU needs 8"
    )

    low_latency: bool = Field(
        default=_SERIAL.low_latency,
        description="make the serial port's driver hand bytes over at once, where it can",
    )
    echo: bool = Field(
        default=_SERIAL.echo,
        description="the RS-485 adapter hears what it sends: it comes back, and is taken out",
    )
    rs485: bool = Field(
        default=_SERIAL.rs485, description="set the RS-485 mode of the serial port's driver: it switches RTS"
    )

    def serial_endpoint(self, device: str) -> SerialEndpoint:
        """Return the serial port with its character format."""
        return SerialEndpoint(
            device,
            self.baudrate,
            self.parity.letter,
            self.data_bits,
            self.stop_bits,
            echo=self.echo,
            low_latency=self.low_latency,
            rs485=self.rs485,
        )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        rule = broken_rule(type(self), self.model_fields_set)
        if rule:
            raise ValueError(rule)
        return self


WAYS = ("rtu", "tcp", "rtu_over_tcp")


def broken_rule(model: type[_SerialSettings], keys: Collection[str]) -> str:
    """Say which rule about its keys a table breaks, "" for none; values are not looked at.

    >>> broken_rule(ControllerSection, {"name", "rtu", "tcp"})
    'allowed: exactly one of rtu, tcp, rtu_over_tcp'
    """
    ways = [way for way in WAYS if way in model.model_fields]
    given = [way for way in ways if way in keys]
    if len(given) != 1:
        return f"allowed: exactly one of {', '.join(ways)}"
    stray = sorted(SERIAL_KEYS & set(keys))
    if stray and given != ["rtu"]:
        return f"{', '.join(stray)} belong to a serial port (rtu): leave out beside {given[0]}"
    stray = sorted(TCP_KEYS & set(keys))
    if stray and given == ["rtu"]:
        return f"{', '.join(stray)} {'belongs' if len(stray) == 1 else 'belong'} to tcp: leave out beside rtu"
    return ""


class DrivesEndpoint(_SerialSettings):
    """Where the drives are."""

    rtu_over_tcp: RtuOverTcp | None = Field(
        default=None, description="HOST:PORT of a serial device server that carries raw RTU frames"
    )

    @property
    def endpoint(self) -> TcpEndpoint | SerialEndpoint:
        """The place in plain data."""
        place = self.tcp or self.rtu_over_tcp
        if place is not None:
            return place
        return self.serial_endpoint(self.rtu or "")


class ControllerSection(RightsKeys, _SerialSettings):
    """One controller: where it connects and what it may do."""

    rtu_over_tcp: RtuOverTcp | None = Field(
        default=None, description="HOST:PORT to listen on for who sends raw RTU frames over TCP"
    )
    name: Name = Field(description="name of the controller, once in its line")
    timeout_ms: Milliseconds = Field(
        default=1000.0, description="milliseconds after which this controller gives up on a request"
    )
    allow: ListOf[Network] = Field(
        default=(), description="networks that may connect; none named: whoever reaches the port"
    )
    max_connections: Annotated[int, Field(ge=1, le=1024)] = Field(
        default=DEFAULT_LIMITS.max_connections, description="connections at once over tcp"
    )
    connects_per_s: Annotated[float, Field(gt=0.0, le=1e6)] = Field(
        default=DEFAULT_LIMITS.connects_per_s,
        description="connections without an answer that one host may open in a second over tcp, in the mean",
    )
    idle_timeout_s: Annotated[float, Field(gt=0.0, le=1e6)] | None = Field(
        default=None,
        description="seconds after which a connection over tcp is closed that asks for nothing; none: never",
    )
    silent_after_s: Annotated[float, Field(ge=0.0, le=1e7)] | None = Field(
        default=None,
        description="seconds without a request after which this controller is missed and its axes are not "
        "healthy; 0: it comes and goes",
    )
    tls: ControllerTls | None = Field(
        default=None, description="speak TLS only, with those who have a certificate (Modbus/TCP Security)"
    )
    roles: dict[RoleName, RoleKeys] = Field(
        default_factory=dict, description="with tls: what each role that a certificate may have gives"
    )

    @property
    def limits(self) -> ConnectionLimits:
        """The limits of its connections in plain data."""
        return ConnectionLimits(self.max_connections, self.connects_per_s, self.idle_timeout_s or 0.0)

    @property
    def roles_in_use(self) -> tuple[Role, ...]:
        """What its connections may be, the one that may do most first."""
        found = {each.role for each in self.roles.values()} if self.tls is not None else {self.role}
        return tuple(role for role in Role if role in found) or (self.role,)

    @property
    def listens(self) -> TcpEndpoint | None:
        """Where it is listened for, unless it is wired to a serial port."""
        return self.tcp or self.rtu_over_tcp

    @property
    def way(self) -> str:
        """The key that says where it is."""
        return next(way for way in WAYS if getattr(self, way) is not None)

    @property
    def endpoint(self) -> TcpEndpoint | SerialEndpoint:
        """The place in plain data."""
        return self.listens or self.serial_endpoint(self.rtu or "")


class Connect(Enum):
    """When there is a connection to the drives."""

    ALWAYS = "always"
    ON_DEMAND = "on-demand"


class LineSection(StrictModel):
    """One bus of drives."""

    drives: DrivesEndpoint = Field(description="where the drives are: rtu, tcp or rtu_over_tcp")
    controllers: Annotated[ListOf[ControllerSection], Field(min_length=1)] = Field(
        description="one [[line.NAME.controllers]] for each controller"
    )
    response_timeout_ms: Milliseconds = Field(
        default=_TIMING.response_timeout_ms, description="milliseconds that a drive has for its answer"
    )
    drain_ms: Milliseconds | None = Field(
        default=None,
        description="milliseconds of silence after a time-out before the next request, on RTU drives; "
        "response_timeout_ms when not given",
    )
    retry_ms: MillisecondsOrZero = Field(
        default=_TIMING.retry_ms,
        description="milliseconds after which a unit id that left three requests unanswered is tried again, "
        "doubling to 10 s; 0: it is always asked",
    )
    connect: ByName[Connect] = Field(
        default=Connect.ALWAYS,
        description="when there is a connection to the drives, over tcp: always, or on-demand",
    )
    connect_delay_ms: MillisecondsOrZero = Field(
        default=_TIMING.connect_delay_ms,
        description="milliseconds between a connection to the drives and the first request on it, over tcp",
    )
    max_connection_s: Annotated[float, Field(ge=0.0, le=1e6)] = Field(
        default=_TIMING.max_connection_s,
        description="seconds after which a connection to the drives is made anew, over tcp; 0: never",
    )
    turnaround_ms: MillisecondsOrZero = Field(
        default=_TIMING.turnaround_ms, description="milliseconds of pause after a broadcast"
    )
    gap_ms: MillisecondsOrZero = Field(
        default=_TIMING.gap_ms, description="milliseconds of silence before each request"
    )
    quiet_ms: MillisecondsOrZero = Field(
        default=_TIMING.quiet_ms,
        description="milliseconds without a motion exchange after which a monitor's exchange may start",
    )
    other_units: ListOf[UnitId] = Field(
        default=(), description="unit ids of further devices on the line, which have no axis"
    )
    answers_as: UnitId | None = Field(
        default=None,
        description="the unit id that the one Modbus/TCP drive answers with, where it is not its own",
    )
    cut_through: bool = Field(
        default=False,
        description="let frames leave while they still arrive, between serial ports (RTU to RTU)",
    )
    monitor_max_wait_ms: Milliseconds = Field(
        default=_TIMING.monitor_max_wait_ms,
        description="milliseconds after which a monitor's request no longer waits for a gap that it fits",
    )
