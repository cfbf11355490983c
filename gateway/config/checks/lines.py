"""Lines: their members, ports, endpoints and times."""

import os
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Final, TypeGuard

from gateway.budget.verdict import Grade, Judgement, judge
from gateway.config.axis_model import AxisSection
from gateway.config.build import line_plan
from gateway.config.drive_files import NamedProfile
from gateway.config.findings import Findings
from gateway.config.gateway_model import StatusUnitSection
from gateway.config.line_model import Connect, ControllerSection, DrivesEndpoint, LineSection, broken_rule
from gateway.config.problems import key_text, shown
from gateway.config.sections import Sections
from gateway.config.tables import AxisTable
from gateway.config.toml import KeyPath
from gateway.drives.profile import Transport
from gateway.exchange.plan import Role
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint

# --- Conflicts between lines: a shared port, device, address or name

MAY: Final = {Role.MOTION: "move", Role.OPERATOR: "read and stop", Role.MONITOR: "read"}
WILDCARDS: Final = frozenset({"0.0.0.0", "::"})  # noqa: S104 (to be recognised, not to be bound)


@dataclass(frozen=True, slots=True)
class EndpointUse:
    """An endpoint and the key that names it."""

    key: KeyPath
    endpoint: TcpEndpoint | SerialEndpoint


def check_lines(
    findings: Findings, lines: Mapping[str, LineSection], unit_ids: Mapping[str, Collection[int]]
) -> None:
    """Check all lines, alone and against each other; ``unit_ids``: of the axes of each line."""
    drives = [EndpointUse(drives_key(name, line), line.drives.endpoint) for name, line in lines.items()]
    listeners = [
        EndpointUse(
            (*controller_key(findings, name, controller.name, i), controller.way),
            controller.endpoint,
        )
        for name, line in lines.items()
        for i, controller in enumerate(line.controllers)
    ]
    for name, line in lines.items():
        _check_names(findings, name, line)
        _check_drain(findings, name, line)
        _check_connection(findings, name, line)
        _check_cut_through(findings, name, line)
        _check_units(findings, name, line, set(unit_ids.get(name, ())))
        _check_open_listeners(findings, name, line)
    _check_ipv6_alone(findings, listeners)
    ports = [use for use in (*drives, *listeners) if isinstance(use.endpoint, SerialEndpoint)]
    _check_devices(findings, sorted(ports, key=lambda use: findings.document.order_of(use.key)))
    _check_addresses(findings, drives, listeners)


def check_status_unit(
    findings: Findings,
    own: StatusUnitSection | None,
    lines: Mapping[str, LineSection],
    axes: Mapping[str, AxisSection],
) -> None:
    """Check that no drive and no other device has the gateway's own unit id."""
    if own is None:
        return
    drives = [(("axis", name, "unit_id"), axis.unit_id) for name, axis in axes.items()]
    others = [
        (("line", name, "other_units", number), unit_id)
        for name, line in lines.items()
        for number, unit_id in enumerate(line.other_units)
    ]
    for key, unit_id in (*drives, *others):
        if unit_id == own.id:
            findings.refuse(
                ("status_unit", "id"),
                f"{own.id} is the unit id of a drive: {key_text(key)} has it",
                "choose an id that no device of any line has, as 250: requests to it never reach a device",
            )


def drives_key(name: str, line: LineSection) -> KeyPath:
    """Return the key with the endpoint of a line's drives."""
    way = next(way for way in ("rtu", "tcp", "rtu_over_tcp") if getattr(line.drives, way) is not None)
    return ("line", name, "drives", way)


def controller_key(findings: Findings, line: str, controller: str, index: int) -> KeyPath:
    """Return the key path of a controller in the file, where refused controllers count too."""
    raw = findings.document.tables["line"][line].get("controllers", [])
    same = [
        i for i, c in enumerate(raw) if isinstance(c, dict) and c.get("name") == controller and i >= index
    ]
    return ("line", line, "controllers", same[0] if same else index)


def _check_names(findings: Findings, name: str, line: LineSection) -> None:
    names = [controller.name for controller in line.controllers]
    for i, controller in enumerate(names):
        if controller in names[:i]:
            key = (*controller_key(findings, name, controller, i), "name")
            findings.refuse(
                key, f'a second controller "{controller}"', "give each controller of a line its own name"
            )


def _check_drain(findings: Findings, name: str, line: LineSection) -> None:
    if line.drain_ms is not None and line.drives.tcp is not None:
        findings.refuse(
            ("line", name, "drain_ms"),
            "drain_ms on Modbus TCP drives",
            "remove it: their late replies have a transaction id",
        )


def _check_connection(findings: Findings, name: str, line: LineSection) -> None:
    """Keys about the TCP connection do not apply to a serial port."""
    given = {
        "connect": line.connect is not Connect.ALWAYS,
        "connect_delay_ms": line.connect_delay_ms > 0.0,
        "max_connection_s": line.max_connection_s > 0.0,
    }
    for key in (key for key, is_given in given.items() if is_given and line.drives.rtu is not None):
        found = f"{key} with drives on a serial port"
        findings.refuse(("line", name, key), found, "remove it: it is only for connections")


def _check_cut_through(findings: Findings, name: str, line: LineSection) -> None:
    is_between_ports = line.drives.rtu is not None and any(each.rtu for each in line.controllers)
    if line.cut_through and not is_between_ports:
        findings.refuse(
            ("line", name, "cut_through"),
            "cut_through without serial ports (rtu) on both sides",
            "remove it: only serial ports get and send a frame byte by byte",
        )


def _check_units(findings: Findings, name: str, line: LineSection, axis_ids: set[int]) -> None:
    """Unit ids without an axis are not those of axes; on a serial line each drive answers with its own."""
    for i, unit_id in enumerate(line.other_units):
        if unit_id in axis_ids:
            findings.refuse(
                ("line", name, "other_units", i), f"{unit_id} is the unit_id of an axis", "leave it out"
            )
    if line.answers_as is not None and line.drives.tcp is None:
        findings.refuse(("line", name, "answers_as"), "answers_as without Modbus TCP drives", "leave it out")
    elif line.answers_as is not None and len(axis_ids.union(line.other_units)) > 1:
        findings.refuse(
            ("line", name, "answers_as"),
            "answers_as on a line with several unit ids",
            "remove it: on this line another unit id is another drive",
        )


def _check_open_listeners(findings: Findings, name: str, line: LineSection) -> None:
    for controller in line.controllers:
        if controller.listens is None or controller.allow or is_loopback(controller.listens.host):
            continue
        if controller.tls is not None:  # the client address does not matter: a certificate is required
            continue
        index = line.controllers.index(controller)
        findings.warn(
            (*controller_key(findings, name, controller.name, index), controller.way),
            f"any computer that reaches {controller.listens} may {MAY[controller.role]} the drives",
            'name who may connect, as in allow = ["192.168.0.7"], or listen on 127.0.0.1',
        )


def _check_ipv6_alone(findings: Findings, listeners: list[EndpointUse]) -> None:
    """Elsewhere ``[::]`` often accepts IPv4 connections too; here it accepts IPv6 only."""
    endpoints = [use.endpoint for use in listeners if isinstance(use.endpoint, TcpEndpoint)]
    for use in listeners:
        if not is_ipv6_alone(use.endpoint):
            continue
        both = TcpEndpoint("0.0.0.0", use.endpoint.port)  # noqa: S104 - to be named, not to be bound
        if any(is_same(endpoint, both) for endpoint in endpoints):
            continue
        findings.warn(
            use.key,
            f"{use.endpoint} accepts only IPv6 connections",
            f'for IPv4 only, write {use.key[-1]} = "{both.host}:{both.port}"; for both, add a second '
            "controller with that address and its own name; for IPv6 only, write the address of this "
            "machine",
        )


def is_ipv6_alone(endpoint: TcpEndpoint | SerialEndpoint) -> TypeGuard[TcpEndpoint]:
    """Whether an endpoint looks like all addresses of this machine but accepts IPv6 only."""
    return isinstance(endpoint, TcpEndpoint) and _canonical(endpoint.host) == "::"


def _check_devices(findings: Findings, uses: list[EndpointUse]) -> None:
    """Two names of one device (by-id, by-path, ttyUSB0) are one device."""
    first: dict[str, KeyPath] = {}
    for use in uses:
        device = os.path.realpath(str(use.endpoint))
        if device in first:
            findings.refuse(
                use.key,
                f"{use.endpoint} is already used by {key_text(first[device])}",
                "give each port one use: a serial port serves one controller or one bus of drives",
            )
        first.setdefault(device, use.key)


def _check_addresses(findings: Findings, drives: list[EndpointUse], listeners: list[EndpointUse]) -> None:
    for i, use in enumerate(drives):
        for other in drives[:i]:
            if is_same(use.endpoint, other.endpoint):
                findings.refuse(
                    use.key,
                    f"{use.endpoint} is already used by {key_text(other.key)}",
                    "put all drives behind one address into one line",
                )
    for i, use in enumerate(listeners):
        for other in listeners[:i]:
            if is_same(use.endpoint, other.endpoint, wildcard_hosts=WILDCARDS):
                findings.refuse(
                    use.key,
                    f"{use.endpoint} is already the listener of {key_text(other.key)}",
                    "give each controller its own port",
                )
        for other in drives:
            if is_same(use.endpoint, other.endpoint, wildcard_hosts=WILDCARDS):
                findings.refuse(
                    use.key,
                    f"{use.endpoint} is the address of {key_text(other.key)}: the gateway would connect to "
                    "itself",
                    "let the controller connect to another port",
                )


def is_same(
    one: TcpEndpoint | SerialEndpoint,
    other: TcpEndpoint | SerialEndpoint,
    wildcard_hosts: frozenset[str] = frozenset(),
) -> bool:
    """Whether both are one TCP address; ``wildcard_hosts`` stand for every address of this machine."""
    if isinstance(one, SerialEndpoint) or isinstance(other, SerialEndpoint) or one.port != other.port:
        return False
    hosts = (_canonical(one.host), _canonical(other.host))
    if hosts[0] == hosts[1]:
        return True
    for host, against in (hosts, hosts[::-1]):
        # A listener on every address of this machine covers its loopback address too.
        if host in wildcard_hosts and (":" in host) == (":" in against):
            return against in WILDCARDS or is_loopback(against)
    return False


def _canonical(host: str) -> str:
    try:
        return str(ip_address(host))
    except ValueError:
        return "127.0.0.1" if host.lower() == "localhost" else host.lower()


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches a listener at ``host``."""
    try:
        return ip_address(_canonical(host)).is_loopback
    except ValueError:
        return False


# --- Baud rates that no device has

USUAL_RATES: Final = frozenset(
    {
        *(50, 75, 110, 134, 150, 200, 300, 600, 1200, 1800, 2400, 4800, 7200, 9600, 14400, 19200, 28800),
        *(31250, 38400, 45450, 57600, 76800, 93750, 100_000, 115_200, 125_000, 128_000, 153_600, 187_500),
        *(200_000, 230_400, 250_000, 256_000, 307_200, 312_500, 375_000, 400_000, 460_800, 500_000, 576_000),
        *(600_000, 614_400, 625_000, 750_000, 800_000, 921_600),
        *(1_000_000, 1_152_000, 1_250_000, 1_500_000, 1_562_500, 2_000_000, 2_500_000, 3_000_000, 3_500_000),
        *(4_000_000, 5_000_000, 6_000_000, 8_000_000, 10_000_000, 12_000_000),
    }
)
"""Rates of terminals, modems and RS-485 buses, and divided clocks of adapters and drives."""


def check_ports(findings: Findings, sections: Sections) -> None:
    """Warn of unusual rates."""
    for key, rate in _rates(findings, sections):
        if rate not in USUAL_RATES:
            nearest = min(USUAL_RATES, key=lambda usual: abs(usual - rate))
            findings.warn(
                key,
                f"{rate} is not a baud rate of any device",
                f"see the manual of the device; the nearest usual one is {nearest}",
            )


def _rates(findings: Findings, sections: Sections) -> Iterator[tuple[KeyPath, int]]:
    for name, line in sections.lines.items():
        if line.drives.rtu is not None:
            yield ("line", name, "drives", "baudrate"), line.drives.baudrate
        for index, controller in enumerate(line.controllers):
            if controller.rtu is not None:
                key = controller_key(findings, name, controller.name, index)
                yield (*key, "baudrate"), controller.baudrate


# --- Tables that must name exactly one endpoint, checked as written in the file


def check_ways(findings: Findings) -> None:
    """Check the drives and the controllers of every line, and the device of ``[alarm_output]``.

    A problem that the schema reported too is one problem.
    """
    output = findings.document.tables.get("alarm_output")
    if isinstance(output, dict):
        _check(findings, DrivesEndpoint, output.get("device"), ("alarm_output", "device"))
    lines = findings.document.tables.get("line")
    for name, line in lines.items() if isinstance(lines, dict) else ():
        if not isinstance(line, dict):
            continue
        _check(findings, DrivesEndpoint, line.get("drives"), ("line", name, "drives"))
        controllers = line.get("controllers")
        for index, controller in enumerate(controllers if isinstance(controllers, list) else ()):
            _check(findings, ControllerSection, controller, ("line", name, "controllers", index))


def _check(
    findings: Findings, model: type[DrivesEndpoint | ControllerSection], raw: object, path: KeyPath
) -> None:
    rule = broken_rule(model, raw) if isinstance(raw, dict) else ""
    if rule:
        findings.refuse(path, f"found {shown(raw)}", rule)


# --- The drive profiles against the lines


def check_drives(findings: Findings, sections: Sections, drives: Mapping[str, NamedProfile]) -> None:
    """Warn of a line type that the drive does not have, and of unit ids that it cannot have."""
    for name, drive in drives.items():
        axis = (sections.axes | sections.partial_axes)[name]
        taken = drive.profile.unit_id_range
        if taken is not None and not taken[0] <= axis.unit_id <= taken[1]:
            only = f"{taken[0]} to {taken[1]}" if taken[0] < taken[1] else f"{taken[0]} only"
            findings.warn(
                ("axis", name, "unit_id"),
                f"{drive.name} accepts unit ids {only}, not {axis.unit_id}",
                "set it to the unit id of the drive",
            )
        line = sections.lines.get(axis.line)
        if line is None or not drive.profile.transports or _transport(line) in drive.profile.transports:
            continue
        findings.warn(
            ("axis", name, "drive"),
            f"{drive.name} speaks {_spoken(drive.profile.transports)}, but the drives of line {axis.line} "
            f"are on {_spoken((_transport(line),))}",
            "check the line; a converter in front of the drive is allowed",
        )


def _transport(line: LineSection) -> Transport:
    return Transport.RTU if line.drives.tcp is None else Transport.TCP


def _spoken(transports: tuple[Transport, ...]) -> str:
    return " and ".join(f"Modbus {transport.value.upper()}" for transport in transports)


# --- The time budget: a limit that no line can meet is an error


def check_budget(
    findings: Findings,
    sections: Sections,
    tables: Mapping[str, AxisTable],
    drives: Mapping[str, NamedProfile],
) -> None:
    """Check the times of every line without other errors; a line with errors has no times yet."""
    for name in sections.lines:
        axes = {axis_name: axis for axis_name, axis in sections.axes.items() if axis.line == name}
        keys: list[KeyPath] = [("line", name), *(("axis", axis_name) for axis_name in axes)]
        if any(map(findings.is_refused, keys)) or any(axis.registers is None for axis in axes.values()):
            continue
        for judgement in judge(line_plan(name, sections, tables, drives)):
            _report(findings, sections, judgement)


def _report(findings: Findings, sections: Sections, judgement: Judgement) -> None:
    key = judgement.key
    if key[0] == "line" and key[2] == "controllers":
        _, line, _, index, *rest = key
        assert isinstance(line, str)
        assert isinstance(index, int)
        controller = sections.lines[line].controllers[index]
        key = (*controller_key(findings, line, controller.name, index), *rest)
    if judgement.grade is Grade.IMPOSSIBLE:
        findings.refuse(key, judgement.found, judgement.remedy)
    elif judgement.grade is Grade.CLOSE:
        findings.warn(key, judgement.found, judgement.remedy)
