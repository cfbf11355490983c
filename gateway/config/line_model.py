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
from gateway.drives.strict import ByName, ListOf, Live, Planned, StrictModel, documented, planned
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
        """The letter that serial ports use for it."""
        return self.value[0].upper()


class _SerialSettings(StrictModel):
    """The character format of a serial port, and the rule that only a serial port has one."""

    rtu: Device | None = Field(default=None, description="path of a serial port that carries Modbus RTU")
    tcp: Tcp | None = Field(default=None, description="HOST:PORT of Modbus TCP")
    baudrate: Planned[Annotated[int, Field(ge=50, le=12_000_000)]] = Field(
        default=_SERIAL.baudrate,
        description="bits per second of the serial port",
        json_schema_extra=documented(more="Only with `rtu`"),
    )
    parity: ByName[Parity] = Field(
        default=Parity.NONE,
        description="parity of the serial port",
        json_schema_extra=documented(more="Only with `rtu`"),
    )
    stop_bits: Planned[Annotated[int, Field(ge=1, le=2)]] = Field(
        default=_SERIAL.stop_bits,
        description="stop bits of the serial port",
        json_schema_extra=documented(more="Only with `rtu`"),
    )
    # RTU carries whole bytes (Modbus over serial line V1.02, 2.5.1).
    data_bits: Planned[Annotated[int, Field(ge=8, le=8)]] = Field(
        default=_SERIAL.data_bits,
        description="data bits of the serial port; RTU needs 8",
        json_schema_extra=documented(more="Only with `rtu`"),
    )

    low_latency: Planned[bool] = Field(
        default=_SERIAL.low_latency,
        description="make the serial port's driver hand bytes over immediately, if it can",
        json_schema_extra=documented(
            text=(
                "only with `rtu`: the port's driver passes bytes on immediately, if it can "
                "([operations.md](operations.md)); `false`: left unchanged, only shown"
            )
        ),
    )
    echo: Planned[bool] = Field(
        default=_SERIAL.echo,
        description="the RS-485 adapter hears what it sends: it comes back, and is taken out",
    )
    rs485: Planned[bool] = Field(
        default=_SERIAL.rs485,
        description="set the RS-485 mode of the serial port's driver: it switches RTS",
        json_schema_extra=documented(
            text=(
                "only with `rtu`: the kernel switches the line's direction with RTS around each frame "
                "(TIOCSRS485), with the delays of the device tree. The gateway does not start if the "
                "driver cannot; most USB adapters cannot, and switch automatically. `false`: unchanged"
            )
        ),
    )

    def serial_endpoint(self, device: str) -> SerialEndpoint:
        """Return the serial port with its character format."""
        return SerialEndpoint(**planned(SerialEndpoint, self), device=device, parity=self.parity.letter)

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        rule = broken_rule(type(self), self.model_fields_set)
        if rule:
            raise ValueError(rule)
        return self


WAYS = ("rtu", "tcp", "rtu_over_tcp")


def broken_rule(model: type[_SerialSettings], keys: Collection[str]) -> str:
    """Return the rule about its keys that a table breaks, "" for none; values are not checked.

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
    """The endpoint of the drives."""

    rtu: Device | None = Field(
        default=None,
        description="path of a serial port that carries Modbus RTU",
        json_schema_extra=documented(
            text=("serial port with Modbus RTU. A name in `/dev/serial/by-id` survives replugging")
        ),
    )
    echo: Planned[bool] = Field(
        default=_SERIAL.echo,
        description="the RS-485 adapter hears what it sends: it comes back, and is taken out",
        json_schema_extra=documented(
            text=(
                "only with `rtu`: the RS-485 adapter hears what it sends; the echo is removed. On a "
                "controller's port the gateway detects it from the first reply"
            )
        ),
    )
    rtu_over_tcp: RtuOverTcp | None = Field(
        default=None, description="HOST:PORT of a serial device server that carries raw RTU frames"
    )

    @property
    def endpoint(self) -> TcpEndpoint | SerialEndpoint:
        """The endpoint in plain data."""
        tcp_endpoint = self.tcp or self.rtu_over_tcp
        if tcp_endpoint is not None:
            return tcp_endpoint
        return self.serial_endpoint(self.rtu or "")


class ControllerSection(RightsKeys, _SerialSettings):
    """One controller: where it connects and what it may do."""

    rtu: Device | None = Field(
        default=None,
        description="path of a serial port that carries Modbus RTU",
        json_schema_extra=documented(text=("serial port of the controller")),
    )
    tcp: Tcp | None = Field(
        default=None,
        description="HOST:PORT of Modbus TCP",
        json_schema_extra=documented(
            text=(
                "address to listen on. `0.0.0.0`: all IPv4 addresses of this machine; `[::]`: all IPv6 "
                "addresses only. For both, write two controllers, each with its `allow` networks"
            )
        ),
    )

    rtu_over_tcp: RtuOverTcp | None = Field(
        default=None,
        description="HOST:PORT to listen on for who sends raw RTU frames over TCP",
        json_schema_extra=documented(
            text=(
                "address to listen on for RTU frames over TCP, from a device server that connects (often "
                "called TCP client) or a program. Each connection has one request at a time"
            )
        ),
    )
    name: Planned[Name] = Field(description="name of the controller, once in its line")
    timeout_ms: Planned[Milliseconds] = Field(
        default=1000.0, description="milliseconds after which this controller gives up on a request"
    )
    allow: ListOf[Network] = Field(
        default=(),
        description="networks that may connect; none named: every host that reaches the port",
        json_schema_extra=documented(
            text=(
                'networks that may connect, as in `["192.168.0.0/24", "fd00::/8"]`; `[]`: all. Not with `rtu`'
            )
        ),
    )
    max_connections: Planned[Annotated[int, Field(ge=1, le=1024)]] = Field(
        default=DEFAULT_LIMITS.max_connections,
        description="most open connections over tcp",
        json_schema_extra=documented(more="Not with `rtu`"),
    )
    connects_per_s: Planned[Annotated[float, Field(gt=0.0, le=1e6)]] = Field(
        default=DEFAULT_LIMITS.connects_per_s,
        description="connections without an answer that one host may open in a second over tcp, in the mean",
        json_schema_extra=documented(
            text=(
                "average connections that one host may open per second; after a pause up to "
                "`max_connections`. Answered connections do not count, up to a thousand a second; with "
                "`tls` all count. Not with `rtu`"
            )
        ),
    )
    idle_timeout_s: Annotated[float, Field(gt=0.0, le=1e6)] | None = Field(
        default=None,
        description="seconds after which a connection over tcp is closed that asks for nothing; none: never",
        json_schema_extra=documented(
            text=("time without a whole request after which a connection is closed. Not with `rtu`"),
            default="never",
        ),
    )
    silent_after_s: Live[Annotated[float, Field(ge=0.0, le=1e7)] | None] = Field(
        default=None,
        description="seconds without a request after which this controller is missed and its axes are not "
        "healthy; 0: it comes and goes",
        json_schema_extra=documented(
            text=(
                "seconds without a request after which the axes are no longer healthy "
                "(`controller-absent`, `controller-silent`). Set it longer than the controller's longest "
                "pause: `90000` if it polls once a day. `0`: no warning. Applies on reload"
            ),
            default=("5 for the motion controllers of a line together: one that asks is enough. Others: `0`"),
        ),
    )
    tls: ControllerTls | None = Field(
        default=None,
        description=("accept only TLS with a client certificate (Modbus/TCP Security)"),
        json_schema_extra=documented(more="Only with `tcp`, see below"),
    )
    roles: dict[RoleName, RoleKeys] = Field(
        default_factory=dict,
        description="with tls: what each role that a certificate may have gives",
        json_schema_extra=documented(more="See below", kind="tables", default="none"),
    )

    @property
    def limits(self) -> ConnectionLimits:
        """The limits of its connections in plain data."""
        return ConnectionLimits(**planned(ConnectionLimits, self), idle_timeout_s=self.idle_timeout_s or 0.0)

    @property
    def roles_in_use(self) -> tuple[Role, ...]:
        """Possible roles of its connections, the one with most rights first."""
        found = {each.role for each in self.roles.values()} if self.tls is not None else {self.role}
        return tuple(role for role in Role if role in found) or (self.role,)

    @property
    def listens(self) -> TcpEndpoint | None:
        """Address of its listener; None for a serial port."""
        return self.tcp or self.rtu_over_tcp

    @property
    def way(self) -> str:
        """The key that names its endpoint."""
        return next(way for way in WAYS if getattr(self, way) is not None)

    @property
    def endpoint(self) -> TcpEndpoint | SerialEndpoint:
        """The endpoint in plain data."""
        return self.listens or self.serial_endpoint(self.rtu or "")


class Connect(Enum):
    """When the gateway is connected to the drives."""

    ALWAYS = "always"
    ON_DEMAND = "on-demand"


class LineSection(StrictModel):
    """One bus of drives."""

    drives: DrivesEndpoint = Field(
        description="where the drives are: rtu, tcp or rtu_over_tcp",
        json_schema_extra=documented(more="See below"),
    )
    controllers: Annotated[ListOf[ControllerSection], Field(min_length=1)] = Field(
        description="one [[line.NAME.controllers]] for each controller"
    )
    response_timeout_ms: Planned[Milliseconds] = Field(
        default=_TIMING.response_timeout_ms,
        description="milliseconds that a drive has for its answer",
        json_schema_extra=documented(
            text=(
                "time for a drive's answer. The gateway never gives up before its controllers, except in "
                "trials (`retry_ms`)"
            ),
        ),
    )
    drain_ms: Milliseconds | None = Field(
        default=None,
        description="milliseconds of silence after a time-out before the next request, on RTU drives; "
        "response_timeout_ms when not given",
        json_schema_extra=documented(
            text=(
                "RTU drives: silence after a time-out before the unit id is asked again, so that a late "
                "reply answers nothing else ([W6](wire-rules.md#w6-late-replies)). A request that would "
                "come too late after it gets 0x0B (counter `too_late`). Refused with `tcp` drives, whose "
                "replies are numbered"
            ),
            default="`response_timeout_ms`",
        ),
    )
    retry_ms: Planned[MillisecondsOrZero] = Field(
        default=_TIMING.retry_ms,
        description="milliseconds after which a unit id that left three requests unanswered is tried again, "
        "doubling to 10 s; 0: it is always asked",
        json_schema_extra=documented(
            text=(
                "a unit id that left three requests in a row unanswered is dead: requests for it or its "
                "group get 0x0B immediately, on RTU too ([W11](wire-rules.md#w11-silent-drives)). After "
                "`retry_ms`, then twice as long each time up to 10 s, the next request is a trial. A stop "
                "to a silent drive is repeated once in `retry_ms`. `0`: the drive is always asked"
            )
        ),
    )
    connect: ByName[Connect] = Field(
        default=Connect.ALWAYS,
        description="when there is a connection to the drives, over tcp: always, or on-demand",
        json_schema_extra=documented(
            text=(
                '`"on-demand"`, for servers with few connections: connect for a request, disconnect '
                "after one idle second if nothing is staged, moving or unacknowledged. The next "
                "connection first reads homed bits and actual positions. Refused if `referenced` of an "
                'axis is `"homing"` or `"set-position"`: a drive that was switched off would go unnoticed'
            )
        ),
    )
    connect_delay_ms: Planned[MillisecondsOrZero] = Field(
        default=_TIMING.connect_delay_ms,
        description="milliseconds between a connection to the drives and the first request on it, over tcp",
        json_schema_extra=documented(
            text=(
                "pause before the first request on a connection, for servers that are mute right after "
                "accepting. Delays stops too: keep it below half of the controllers' `timeout_ms`"
            )
        ),
    )
    max_connection_s: Planned[Annotated[float, Field(ge=0.0, le=1e6)]] = Field(
        default=_TIMING.max_connection_s,
        description="seconds after which a connection to the drives is made anew, over tcp; 0: never",
        json_schema_extra=documented(
            text=(
                "for servers that end long connections: reconnect after this time, once nothing is "
                "outstanding, staged, moving or unacknowledged. `0`: never"
            )
        ),
    )
    turnaround_ms: Planned[MillisecondsOrZero] = Field(
        default=_TIMING.turnaround_ms,
        description="milliseconds of pause after a broadcast",
        json_schema_extra=documented(
            text=("pause after a broadcast (Modbus over serial line V1.02, 2.4.1)"),
        ),
    )
    gap_ms: MillisecondsOrZero = Field(
        default=_TIMING.gap_ms,
        description="milliseconds of silence before each request",
        json_schema_extra=documented(
            text=(
                "silence before each request, beyond the standard's 3.5 characters. The longest of this "
                "and `registers.gap_ms` of its axes applies"
            )
        ),
    )
    quiet_ms: Planned[MillisecondsOrZero] = Field(
        default=_TIMING.quiet_ms,
        description="milliseconds without a motion exchange after which a monitor's exchange may start",
        json_schema_extra=documented(
            text=(
                "a `monitor`'s request is sent directly after a motion exchange, or after `quiet_ms` "
                "without one. Make it longer than the pauses within a cycle of the motion controller, "
                "and shorter than the cycle"
            )
        ),
    )
    other_units: ListOf[UnitId] = Field(
        default=(),
        description="unit ids of further devices on the line, which have no axis",
        json_schema_extra=documented(
            text=(
                "unit ids of further devices on the line; their frames pass unchanged "
                "([W7](wire-rules.md#w7-patience-and-foreign-unit-ids) has the rule for other unit ids). "
                "Between serial ports such a device may also use frames of non-standard length, as some "
                "inverters do (`05 03 01 01 30 B8`). All bytes between two silences are then one frame; it "
                "counts as a write and is sent some 30 ms after its last byte: let the controller wait at "
                "least 100 ms. Not unit id 0"
            ),
            default="none",
        ),
    )
    answers_as: Planned[UnitId | None] = Field(
        default=None,
        description="the unit id that the one Modbus/TCP drive answers with, where it is not its own",
        json_schema_extra=documented(
            text=(
                "unit id in the replies of a Modbus/TCP drive that always answers with 0, 1 or 255; ends "
                "the event `wrong-unit`"
            ),
            default="its own",
        ),
    )
    cut_through: Planned[bool] = Field(
        default=False,
        description="let frames leave while they still arrive, between serial ports (RTU to RTU)",
        json_schema_extra=documented(
            text=(
                "between two serial ports, forward a known request and its reply while they arrive; "
                "everything else is stored and forwarded. Only for drives that check the CRC "
                "([latency](latency.md#cut-through-a-frame-leaves-while-it-still-arrives))"
            )
        ),
    )
    monitor_max_wait_ms: Planned[Milliseconds] = Field(
        default=_TIMING.monitor_max_wait_ms,
        description="milliseconds after which a monitor's request no longer waits for a gap that it fits",
        json_schema_extra=documented(
            text=(
                "a `monitor`'s request that has waited this long takes the next gap, even if it does not "
                "fit. All monitors of a line share one such request per period, [at "
                "most](wire-rules.md#whose-turn-it-is). If many do not fit, lengthen their `timeout_ms` or "
                "let them poll less often. Warned of: a monitor's `timeout_ms` that is not longer"
            )
        ),
    )
