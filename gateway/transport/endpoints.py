"""The address of a controller or of a bus of drives: plain data, checked by the configuration."""

from ipaddress import IPv4Address, IPv6Address, ip_address

import msgspec

PARITIES = {"N": "none", "E": "even", "O": "odd"}
"""The letters of :class:`SerialEndpoint`, with their words in the configuration."""


class TcpEndpoint(msgspec.Struct, frozen=True, tag=True):
    """A TCP address. ``rtu`` is True for a serial device server that carries raw RTU frames."""

    host: str
    port: int
    rtu: bool = False

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{host}:{self.port}"


class SerialEndpoint(msgspec.Struct, frozen=True, tag=True):
    """A serial port with its character format."""

    device: str
    baudrate: int = 19200
    parity: str = "N"
    """``N``, ``E`` or ``O``."""
    data_bits: int = 8
    stop_bits: int = 1
    echo: bool = False
    """The adapter echoes: it receives what it sends, because its RS-485 receiver stays on."""
    low_latency: bool = True
    """Set the driver's delays of received bytes to their minimum; otherwise leave them."""
    rs485: bool = False
    """Set the RS-485 mode of the driver, which switches the direction of the line; otherwise leave it."""

    @property
    def bits_per_character(self) -> int:
        """Bits on the wire for one byte: start, data, parity and stop bits."""
        return 1 + self.data_bits + (self.parity != "N") + self.stop_bits

    def __str__(self) -> str:
        return self.device


def host_of(peer: str) -> str:
    """Return the host of a peer's address; empty for a serial port.

    >>> host_of("192.168.0.7:40001"), host_of("[fd00::7]:40001"), host_of("/dev/ttyUSB0")
    ('192.168.0.7', 'fd00::7', '')
    """
    return "" if peer.startswith("/") else peer.rpartition(":")[0].strip("[]")


def address_of(host: str) -> IPv4Address | IPv6Address:
    """Return an address without its zone; an IPv4-mapped IPv6 address as IPv4.

    Raises:
        ValueError: it is no address.

    >>> address_of("::ffff:192.0.2.7"), address_of("fe80::1%eth0")
    (IPv4Address('192.0.2.7'), IPv6Address('fe80::1'))
    """
    address = ip_address(host.partition("%")[0])
    mapped = address.ipv4_mapped if isinstance(address, IPv6Address) else None
    return mapped or address
