"""Numbers, names and addresses as written in the configuration.

A read function raises ValueError for a wrong value, and its text says what is allowed. The caller adds the
value and its key.
"""

import re
from ipaddress import IPv4Network, IPv6Address, IPv6Network, ip_address, ip_network
from typing import Annotated, Final

from pydantic import AfterValidator, BeforeValidator, Field, PlainValidator

from gateway.times import US_PER_MS
from gateway.transport.endpoints import TcpEndpoint

# Bounds beyond any machine. They keep every later computation finite.
LARGEST_LENGTH: Final = 1e9
LARGEST_COUNTS: Final = 2.0**63
LARGEST_COUNTS_PER_UNIT: Final = 1e12
SMALLEST_COUNTS_PER_UNIT: Final = 1e-6
LONGEST_MS: Final = 3_600_000.0

Length = Annotated[float, Field(ge=-LARGEST_LENGTH, le=LARGEST_LENGTH)]
"""A position or distance in the units of the axis."""
PositiveLength = Annotated[float, Field(gt=0.0, le=LARGEST_LENGTH)]
LengthOrZero = Annotated[float, Field(ge=0.0, le=LARGEST_LENGTH)]
Counts = Annotated[float, Field(ge=-LARGEST_COUNTS, le=LARGEST_COUNTS)]
CountsOrZero = Annotated[float, Field(ge=0.0, le=LARGEST_COUNTS)]
Milliseconds = Annotated[float, Field(gt=0.0, le=LONGEST_MS)]
Microseconds = Annotated[float, Field(gt=0.0, le=LONGEST_MS * US_PER_MS)]
MillisecondsOrZero = Annotated[float, Field(ge=0.0, le=LONGEST_MS)]

NAME_RULE: Final = "allowed: 1 to 32 letters A-Z a-z, digits, - and _, beginning with a letter or digit"
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}")
_HOST_NAME: Final = re.compile(
    r"[A-Za-z0-9_]([A-Za-z0-9_-]*[A-Za-z0-9])?(\.[A-Za-z0-9_]([A-Za-z0-9_-]*[A-Za-z0-9])?)*"
)
_ADDRESS: Final = re.compile(r"(?:\[(?P<v6>[^\[\]]*)\]|(?P<host>[^:\[\]]*)):(?P<port>[0-9]{1,5})")
HOST_RULE: Final = 'allowed: a name or an address alone, as in "broker.lan", "192.168.0.7" or "::1"'
ADDRESS_RULE: Final = 'allowed: "HOST:PORT", as in "127.0.0.1:502", "cnc.local:502" or "[::1]:502"'


def check_counts_per_unit(scale: float) -> float:
    """Check a scale: signed, and in a range that keeps every product finite.

    Raises:
        ValueError: 0, or out of bounds.
    """
    if not SMALLEST_COUNTS_PER_UNIT <= abs(scale) <= LARGEST_COUNTS_PER_UNIT:
        raise ValueError(
            f"allowed: a number other than 0, its size from {SMALLEST_COUNTS_PER_UNIT:g} to "
            f"{LARGEST_COUNTS_PER_UNIT:g}, negative if the drive counts the other way"
        )
    return scale


def check_travel(travel: tuple[float, float]) -> tuple[float, float]:
    """Check that travel has a length. Raises ValueError otherwise."""
    if travel[0] >= travel[1]:
        raise ValueError("allowed: [lowest, highest], the first below the second")
    return travel


def read_name(raw: object) -> str:
    """Check the name of a gateway, line, axis, group or controller.

    Names become parts of file names, topics and metrics.

    Raises:
        ValueError: any other character.
    """
    if not isinstance(raw, str) or not _NAME.fullmatch(raw):
        raise ValueError(NAME_RULE)
    return raw


def parse_address(raw: object) -> tuple[str, int]:
    """Read ``HOST:PORT``; an IPv6 address has brackets.

    Raises:
        ValueError: anything else, also a port outside 1 to 65535.

    >>> parse_address("[::1]:502")
    ('::1', 502)
    """
    parts = _ADDRESS.fullmatch(raw) if isinstance(raw, str) else None
    if parts is None:
        raise ValueError(ADDRESS_RULE)
    port = int(parts["port"])
    if not 1 <= port <= 65535:
        raise ValueError("allowed: a port from 1 to 65535")
    if parts["v6"] is not None:
        return _ip_v6(parts["v6"]), port
    host = parts["host"]
    if not _HOST_NAME.fullmatch(host) or len(host) > 253:
        raise ValueError(ADDRESS_RULE)
    if host.replace(".", "").isdigit():
        _check_ip_v4(host)
    return host, port


def read_host(raw: object) -> str:
    """Read a name or an address without a port; an IPv6 address has no brackets.

    Raises:
        ValueError: anything else.

    >>> read_host("broker.lan"), read_host("::1")
    ('broker.lan', '::1')
    """
    if isinstance(raw, str) and _HOST_NAME.fullmatch(raw) and len(raw) <= 253:
        return raw
    try:
        return str(IPv6Address(raw if isinstance(raw, str) else ""))
    except ValueError:
        raise ValueError(HOST_RULE) from None


def _ip_v6(text: str) -> str:
    try:
        return str(IPv6Address(text))
    except ValueError:
        raise ValueError(f'"{text}" is not an IPv6 address; {ADDRESS_RULE}') from None


def _check_ip_v4(text: str) -> None:
    try:
        ip_address(text)
    except ValueError:
        raise ValueError(
            f'"{text}" is not an IPv4 address: it needs four numbers from 0 to 255; {ADDRESS_RULE}'
        ) from None


def read_tcp(raw: object) -> TcpEndpoint:
    """Read the address of a Modbus TCP endpoint. Raises ValueError like :func:`parse_address`."""
    host, port = parse_address(raw)
    return TcpEndpoint(host, port)


def read_rtu_over_tcp(raw: object) -> TcpEndpoint:
    """Read the address of a serial device server. Raises ValueError like :func:`parse_address`."""
    host, port = parse_address(raw)
    return TcpEndpoint(host, port, rtu=True)


def read_device(raw: object) -> str:
    """Read the path of a serial port.

    Raises:
        ValueError: not an absolute path; a service has no working directory.
    """
    if not isinstance(raw, str) or not raw.startswith("/") or "\0" in raw:
        raise ValueError('allowed: the full path of a serial port, as in "/dev/serial/by-id/usb-…"')
    return raw


def read_network(raw: object) -> IPv4Network | IPv6Network:
    """Read a network from which a controller may connect.

    Raises:
        ValueError: not a network, or one with bits beyond its prefix; the text says the likely network.
    """
    rule = 'allowed: a network or address, as in "192.168.0.0/24", "192.168.0.7" or "fd00::/8"'
    text = raw if isinstance(raw, str) else ""
    try:
        return ip_network(text)
    except ValueError:
        pass
    try:
        meant = ip_network(text, strict=False)
    except ValueError:
        raise ValueError(rule) from None
    raise ValueError(f'an address inside a network; write "{meant}" for the network or leave out the "/…"')


Name = Annotated[str, BeforeValidator(read_name)]
UnitId = Annotated[int, Field(ge=0, le=255)]
FileName = Annotated[str, Field(min_length=1, pattern=r"^[^\x00]*$")]
Tcp = Annotated[TcpEndpoint, PlainValidator(read_tcp)]
RtuOverTcp = Annotated[TcpEndpoint, PlainValidator(read_rtu_over_tcp)]
Device = Annotated[str, BeforeValidator(read_device)]
Network = Annotated[IPv4Network | IPv6Network, BeforeValidator(read_network)]
CountsPerUnit = Annotated[float, AfterValidator(check_counts_per_unit)]
Travel = Annotated[tuple[Length, Length], Field(strict=False), AfterValidator(check_travel)]
