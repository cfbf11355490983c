"""The restrictions and permissions of the systemd units for one configuration.

Each unit gets one drop-in (systemd.unit(5)). What cannot be restricted stays open, with its reason.
"""

import contextlib
import grp
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from ipaddress import IPv6Address, ip_address
from pathlib import Path
from typing import Any, Final

from gateway.config.load import Loaded
from gateway.secret_files import CREDENTIAL, is_credential_name
from gateway.state.plan import GatewayPlan, RelayOptions
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint

RELAY_UNIT: Final = "pitch-gateway-relay.service"
SUPERVISOR_UNIT: Final = "pitch-gateway-supervisor.service"
CONFIGURATION: Final = "/etc/pitch-gateway"
SECRETS: Final = f"{CONFIGURATION}/secrets"
STATE: Final = "/var/lib/pitch-gateway"
"""The only folder that the units permit the service to write to (StateDirectory=)."""
FIRST_FREE_PORT: Final = 1024
"""Ports below need a capability (ip(7))."""
LOOPBACK: Final = "localhost"
"""systemd's word for 127.0.0.0/8 and ::1 (systemd.resource-control(5)), and the usual host name."""
KINDS: Final = ("ttyUSB", "ttyACM", "ttyAMA", "ttymxc", "ttyS")
"""Device names of serial port drivers, as in the units; none is a prefix of another."""
ADAPTERS: Final = ("ttyUSB", "ttyACM")
"""Devices that a name under /dev/serial may link to."""
OWN_NAMESPACE: Final = (
    "# In a user namespace of its own neither a capability nor a limit that is raised would count.",
    "PrivateUsers=no",
)


@dataclass(slots=True)
class Addresses:
    """The network peers of a process; ``open_because`` says why the list cannot be complete."""

    allowed: list[str] = field(default_factory=lambda: [LOOPBACK])
    open_because: list[str] = field(default_factory=list)

    def peer(self, host: str, who: str) -> None:
        """Add a remote address, as packets have it: no interface, IPv4 as IPv4."""
        if host == LOOPBACK:
            return
        try:
            address = ip_address(host.partition("%")[0])
        except ValueError:
            self.open_because.append(f"{who} is a host name, {host}, not an address for systemd")
            return
        if isinstance(address, IPv6Address) and address.ipv4_mapped is not None:
            address = address.ipv4_mapped
        if not address.is_loopback:
            self.allowed.append(str(address))

    def listener(self, host: str, networks: Sequence[str], who: str) -> None:
        """Add a listening address, for some networks or for all."""
        self.allowed += networks
        if not networks and not _is_loopback(host):
            self.open_because.append(f"{who} may come from anywhere")

    def lines(self) -> Iterator[str]:
        """Yield the lines of the drop-in."""
        if self.open_because:
            yield "# IPAddressDeny= is left open:"
            yield from (f"#   {reason}" for reason in self.open_because)
            return
        yield "IPAddressDeny=any"
        yield f"IPAddressAllow={' '.join(dict.fromkeys(self.allowed))}"


def drop_ins(loaded: Loaded) -> dict[str, str]:
    """Return the drop-in of each unit, by the name of the unit."""
    secrets = list(_credentials(loaded.document.tables))
    return {
        RELAY_UNIT: _text(loaded.path, [*_relay_lines(loaded.plan), *_secret_lines(secrets)]),
        SUPERVISOR_UNIT: _text(loaded.path, [*_supervisor_lines(loaded), *_secret_lines(secrets)]),
    }


def why_no_state(loaded: Loaded) -> str | None:
    """Return why the service cannot keep its state; None if it can."""
    if loaded.state_folder.resolve().is_relative_to(STATE):
        return None
    return (
        f"{loaded.path}: gateway.state: the units let the service write to {STATE} only, and the state is in "
        f'{loaded.state_folder}; write state = "{STATE}" below [gateway]'
    )


def _text(config: Path, lines: Iterable[str]) -> str:
    head = f"# Made from {config.name} by `pitch-gateway service`: make it again when that has changed."
    return "\n".join((head, "[Service]", *lines, ""))


def _relay_lines(plan: GatewayPlan) -> Iterator[str]:
    addresses = Addresses()
    ports: list[int] = []
    devices: list[str] = []
    for line in plan.lines:
        if isinstance(line.drives, TcpEndpoint):
            addresses.peer(line.drives.host, f"the drives of line {line.name}: their address")
        else:
            devices.append(line.drives.device)
        for link in line.controllers:
            if isinstance(link.endpoint, SerialEndpoint):
                devices.append(link.endpoint.device)
                continue
            ports.append(link.endpoint.port)
            who = f"controller {link.plan.name} of line {line.name} has no `allow`: it"
            addresses.listener(link.endpoint.host, link.allow, who)
    yield from addresses.lines()
    yield from _device_lines(devices)
    yield from _port_lines(ports)
    yield from _realtime_lines(plan.relay)
    if _low(ports) or plan.relay != RelayOptions():
        yield from OWN_NAMESPACE


def _supervisor_lines(loaded: Loaded) -> Iterator[str]:
    addresses = Addresses()
    page = loaded.sections.http.endpoint
    if page is not None:
        addresses.listener(page.host, (), "who looks at the page")
    if loaded.sections.mqtt is not None:
        addresses.peer(loaded.sections.mqtt.host, "[mqtt] host")
    for name, axis in loaded.sections.axes.items():
        if axis.thermal is not None and axis.thermal.source.modbus is not None:
            addresses.peer(axis.thermal.source.modbus.host, f"the temperature sensor of axis {name}")
    output = loaded.sections.alarm_output
    contact = None if output is None or output.device is None else output.device.endpoint
    if isinstance(contact, TcpEndpoint):
        addresses.peer(contact.host, "[alarm_output] device")
    yield from addresses.lines()
    if isinstance(contact, SerialEndpoint):
        yield "# The serial port of [alarm_output]."
        yield "PrivateDevices=no"
        yield "SupplementaryGroups=dialout"
        yield from (f"DeviceAllow=char-{kind} rw" for kind in _kinds_of(contact.device) or KINDS)
    if output is not None and output.gpio is not None:
        yield "# The GPIO line of [alarm_output]: docs/install.md has the group and the udev rule."
        yield "PrivateDevices=no"
        yield from ["SupplementaryGroups=gpio"] if _is_group("gpio") else ["# There is no group gpio here."]
        yield "DeviceAllow=char-gpiochip rw"
    ports = [] if page is None else [page.port]
    yield from _port_lines(ports)
    if _low(ports):
        yield from OWN_NAMESPACE


def _is_group(name: str) -> bool:
    """Whether there is such a group here: systemd starts no service of a group that is missing."""
    with contextlib.suppress(KeyError):
        return bool(grp.getgrnam(name))
    return False


def _device_lines(devices: Iterable[str]) -> Iterator[str]:
    """Allow the kinds of the named ports, not the ports: an adapter may be plugged in later."""
    kinds: dict[str, None] = {}
    for device in devices:
        found = _kinds_of(device)
        if not found:
            yield f"# DeviceAllow= is left as it is: of what kind {device} is, its name does not say"
            return
        kinds |= dict.fromkeys(found)
    yield "DeviceAllow="
    yield from (f"DeviceAllow=char-{kind} rw" for kind in kinds)
    if not kinds:
        yield "PrivateDevices=yes"


def _kinds_of(device: str) -> tuple[str, ...]:
    path = Path(device)
    if path.is_relative_to("/dev/serial"):
        return ADAPTERS
    name = path.resolve().name  # a udev link, if it exists
    return tuple(kind for kind in KINDS if name.startswith(kind) and name[len(kind) :].isdecimal())


def _port_lines(ports: Iterable[int]) -> Iterator[str]:
    low = _low(ports)
    if low:
        yield f"# Ports below {FIRST_FREE_PORT}: {', '.join(map(str, low))}."
        yield "CapabilityBoundingSet=CAP_NET_BIND_SERVICE"
        yield "AmbientCapabilities=CAP_NET_BIND_SERVICE"


def _low(ports: Iterable[int]) -> list[int]:
    return sorted(port for port in ports if 0 < port < FIRST_FREE_PORT)


def _realtime_lines(options: RelayOptions) -> Iterator[str]:
    if options == RelayOptions():
        return
    yield "# What [relay] asks for, the relay asks the system for when everything is loaded."
    if options.fifo:
        yield "RestrictRealtime=no"
        yield f"LimitRTPRIO={options.fifo}"
    if options.lock_memory:
        yield "LimitMEMLOCK=infinity"
    yield "SystemCallFilter=sched_setscheduler sched_setaffinity setrlimit"


def _secret_lines(names: Iterable[str]) -> Iterator[str]:
    """Pass secrets to both services: the relay's ExecStartPre checks the whole configuration."""
    yield from (f"LoadCredential={name}:{SECRETS}/{name}" for name in names)


def _credentials(value: Any) -> Iterator[str]:
    """Yield the names of the credentials in a document, each once; no other text gets into a unit."""
    found: dict[str, None] = {}
    waiting = [value]
    while waiting:
        each = waiting.pop(0)
        if isinstance(each, Mapping):
            waiting += each.values()
        elif isinstance(each, list | tuple):
            waiting += each
        elif isinstance(each, str) and each.startswith(CREDENTIAL) and is_credential_name(each):
            found[each.removeprefix(CREDENTIAL)] = None
    yield from found


def _is_loopback(host: str) -> bool:
    try:
        return host == LOOPBACK or ip_address(host).is_loopback
    except ValueError:
        return False
