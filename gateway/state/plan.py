"""The whole checked configuration in plain objects: what the relay runs from."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from ipaddress import IPv4Network, IPv6Network

from gateway.exchange.plan import NO_OTHER_UNITS, AxisPlan, ControllerPlan, LineTiming, OtherUnits, Role
from gateway.exchange.rights import UNLIMITED, Rights
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.limits import DEFAULT_LIMITS, ConnectionLimits
from gateway.transport.tls_files import TlsFiles


@dataclass(frozen=True, slots=True)
class RoleRights:
    """What a role of a certificate gives."""

    role: Role
    rights: Rights = UNLIMITED


@dataclass(frozen=True, slots=True)
class TlsPlan:
    """Modbus/TCP Security on a listener: its files, and what each role may do; the others may not come in."""

    files: TlsFiles
    roles: Mapping[str, RoleRights]


@dataclass(frozen=True, slots=True)
class ControllerLink:
    """A controller and where it connects. ``allow`` empty: any address that reaches the listener.

    With ``tls`` what each connection may do comes with its certificate; ``plan`` has the most of it.
    """

    plan: ControllerPlan
    endpoint: TcpEndpoint | SerialEndpoint
    allow: tuple[IPv4Network | IPv6Network, ...] = ()
    limits: ConnectionLimits = DEFAULT_LIMITS
    tls: TlsPlan | None = None

    def plan_of(self, certified: str) -> ControllerPlan | None:
        """Return the plan of connections whose certificate has a role; None where it is not one of ours.

        "" is a connection without TLS.
        """
        if not certified:
            return self.plan if self.tls is None else None
        given = None if self.tls is None else self.tls.roles.get(certified)
        if given is None:
            return None
        return replace(self.plan, role=given.role, rights=given.rights, certified=certified)


@dataclass(frozen=True, slots=True)
class LinePlan:
    """One bus of drives with the controllers that may use it."""

    name: str
    drives: TcpEndpoint | SerialEndpoint
    controllers: tuple[ControllerLink, ...]
    axes: tuple[AxisPlan, ...]
    timing: LineTiming
    groups: tuple[tuple[str, ...], ...] = ()
    """Names of axes that are corrected together or not at all."""
    other_units: OtherUnits = NO_OTHER_UNITS
    """Of a Modbus/TCP line: what is known of unit ids that have no axis."""
    answers_as: int | None = None
    """The unit id in the replies of its one Modbus/TCP drive, where that is not the one that was asked."""
    cut_through: bool = False
    """Frames may leave while they still arrive, where both sides are serial ports."""
    tape_bytes: int = 0
    """How much of its last minutes is kept (``ipc.tape``); 0: nothing."""


@dataclass(frozen=True, slots=True)
class RelayOptions:
    """How the process of the relay is to be scheduled."""

    fifo: int = 0
    """Priority of SCHED_FIFO, 1 to 99; 0: as the process was started."""
    cpus: tuple[int, ...] = ()
    """CPUs to run on; none: any."""
    lock_memory: bool = False


@dataclass(frozen=True, slots=True)
class GatewayPlan:
    """Everything the relay needs."""

    name: str
    lines: tuple[LinePlan, ...]
    relay: RelayOptions = RelayOptions()
    status_unit: int = 0
    """Unit id at which the gateway itself answers (``relay.status_unit``); 0: at none."""
