"""Frames for Wireshark: pcapng, an interface for each controller and one for the drives of a line.

Modbus/TCP frames get artificial Ethernet, IP and TCP headers: with the hosts of both ends where they are
known. The server always has port 502, where Wireshark expects it, whatever the real port is. RTU frames use
the link type *Wireshark Upper PDU* with the name of the dissector, ``mbrtu``, so that no setting is needed.
The gateway's own transaction ids towards drives are not in the trace buffer; they are counted here.

Sources: draft-ietf-opsawg-pcapng (blocks, options); https://www.tcpdump.org/linktypes.html (1 Ethernet, 252
Upper PDU); epan/exported_pdu.h of Wireshark (tags); RFC 791, 8200, 9293 (headers and their sums).
"""

from dataclasses import dataclass, field
from ipaddress import IPv4Address, IPv6Address, ip_address
from struct import Struct, pack
from typing import Final

from gateway.modbus.mbap import encode_mbap
from gateway.modbus.rtu import encode_rtu
from gateway.recording import traffic
from gateway.state.plan import GatewayPlan
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint

ETHERNET: Final = 1
UPPER_PDU: Final = 252
MODBUS_PORT: Final = 502
FIRST_CLIENT_PORT: Final = 49152
HERE: Final = IPv4Address("127.0.0.1")
"""The gateway, or a host whose address is unknown."""
_SECTION: Final = 0x0A0D0D0A
_INTERFACE: Final = 1
_PACKET: Final = 6
_BYTE_ORDER: Final = 0x1A2B3C4D
_COMMENT, _NAME, _DESCRIPTION, _RESOLUTION, _FLAGS = 1, 2, 3, 9, 2
_INBOUND, _OUTBOUND = 1, 2
_TAG_DISSECTOR, _TAG_END = 12, 0
_TAG_IPV4_FROM, _TAG_IPV4_TO, _TAG_PORT_TYPE, _TAG_PORT_FROM, _TAG_PORT_TO = 20, 21, 24, 25, 26
_PORT_TYPE_TCP: Final = 2
_PUSH_ACK: Final = 0x18
_U32 = Struct(">I")
Address = IPv4Address | IPv6Address


@dataclass(slots=True)
class _Interface:
    """One side of a line: the interface and address of its packets."""

    number: int
    is_mbap: bool
    server: Address
    """The address of the requested side."""


@dataclass(slots=True)
class _Stream:
    """One connection on one side."""

    client: Address
    port: int
    sent: list[int] = field(default_factory=lambda: [1, 1])
    """The next sequence number of the client and of the server."""


class PcapNg:
    """Makes pcapng from entries, as they come."""

    def __init__(self, plan: GatewayPlan, only: str | None = None) -> None:
        self._lines = {line.name: line for line in plan.lines if only in (None, line.name)}
        self._controller_side: dict[tuple[str, str], _Interface] = {}
        self._back: dict[str, _Interface] = {}
        self._streams: dict[tuple[str, int], _Stream] = {}
        self._senders: dict[tuple[str, int], str] = {}
        """The controller of each port, by line."""
        self._asked: dict[str, int] = {}
        """Requests to the drives of a line so far: the transaction id of the newest one."""

    def head(self) -> bytes:
        """Return the beginning of a file: the program that made it, and all interfaces."""
        blocks = [_block(_SECTION, pack("<IHHq", _BYTE_ORDER, 1, 0, -1) + _options((4, b"pitch-gateway")))]
        for name, line in self._lines.items():
            for link in line.controllers:
                where = self._interface(link.endpoint)
                self._controller_side[name, link.plan.name] = where
                blocks.append(
                    _interface(where, f"{name}: {link.plan.name}", f"controller at {link.endpoint}")
                )
            where = self._back[name] = self._interface(line.drives)
            blocks.append(_interface(where, f"{name}: drives", f"drives at {line.drives}"))
        return b"".join(blocks)

    def packet(self, entry: traffic.Entry, wall_ns: int) -> bytes:
        """Return the packet of an entry at a time of day; empty if the entry is no frame."""
        match entry:
            case traffic.Request(line=line, port=port) if line in self._lines:
                self._senders[line, port] = entry.controller
                interface = self._controller_side.get((line, entry.controller))
                stream = self._stream(line, port, entry.peer)
                ids = entry.transaction, entry.unit
                return _packet(interface, stream, ids, bytes.fromhex(entry.pdu), wall_ns, is_request=True)
            case traffic.Answered(line=line, port=port) if line in self._lines:
                interface = self._controller_side.get((line, self._senders.get((line, port), "")))
                stream = self._stream(line, port, "")
                ids = entry.transaction, entry.unit
                return _packet(interface, stream, ids, bytes.fromhex(entry.pdu), wall_ns, is_request=False)
            case traffic.Sent(line=line) | traffic.Reply(line=line) if line in self._lines:
                is_request = isinstance(entry, traffic.Sent)
                self._asked[line] = self._asked.get(line, 0) + is_request
                ids = self._asked[line] & 0xFFFF, entry.unit
                stream = self._stream(line, 0, "")
                back = self._back[line]
                return _packet(back, stream, ids, bytes.fromhex(entry.pdu), wall_ns, is_request=is_request)
            case _:
                return b""

    def _interface(self, endpoint: TcpEndpoint | SerialEndpoint) -> _Interface:
        number = len(self._controller_side) + len(self._back)
        if isinstance(endpoint, SerialEndpoint):
            return _Interface(number, False, HERE)
        return _Interface(number, not endpoint.rtu, _address(endpoint.host))

    def _stream(self, line: str, port: int, peer: str) -> _Stream:
        stream = self._streams.get((line, port))
        if stream is None:
            client_port = FIRST_CLIENT_PORT + len(self._streams) % (0x10000 - FIRST_CLIENT_PORT)
            stream = self._streams[line, port] = _Stream(_address(peer), client_port)
        return stream


def _packet(
    where: _Interface | None,
    stream: _Stream,
    ids: tuple[int, int],
    pdu: bytes,
    wall_ns: int,
    *,
    is_request: bool,
) -> bytes:
    if where is None or not pdu:
        return b""
    transaction_id, unit_id = ids
    if where.is_mbap:
        data = _ethernet(where, stream, encode_mbap(transaction_id, unit_id, pdu), is_request=is_request)
    else:
        data = _upper_pdu(stream, encode_rtu(unit_id, pdu), is_request=is_request)
    head = pack("<IIIII", where.number, wall_ns >> 32, wall_ns & 0xFFFFFFFF, len(data), len(data))
    flags = (_FLAGS, pack("<I", _INBOUND if is_request else _OUTBOUND))
    return _block(_PACKET, head + _padded(data) + _options(flags))


def _ethernet(where: _Interface, stream: _Stream, data: bytes, *, is_request: bool) -> bytes:
    """Return data in a frame of its TCP connection: each end has acknowledged what the other sent."""
    client, server = _of_one_kind(stream.client, where.server)
    source, target = (client, server) if is_request else (server, client)
    ports = (stream.port, MODBUS_PORT) if is_request else (MODBUS_PORT, stream.port)
    mine, others = (0, 1) if is_request else (1, 0)
    tcp = pack(">HHIIBBHHH", *ports, stream.sent[mine], stream.sent[others], 5 << 4, _PUSH_ACK, 0xFFFF, 0, 0)
    stream.sent[mine] = (stream.sent[mine] + len(data)) & 0xFFFFFFFF
    pseudo = source.packed + target.packed + pack(">IHBB", len(tcp) + len(data), 0, 0, 6)
    tcp = tcp[:16] + pack(">H", _sum(pseudo + tcp + data)) + tcp[18:]
    macs = (b"\x02\0\0\0\0\x02" + b"\x02\0\0\0\0\x01") if is_request else b"\x02\0\0\0\0\x01\x02\0\0\0\0\x02"
    if source.version == 6:
        ip = pack(">IHBB", 6 << 28, len(tcp) + len(data), 6, 64) + source.packed + target.packed
        return macs + b"\x86\xdd" + ip + tcp + data
    ip = (
        pack(">BBHHHBBH", 0x45, 0, 20 + len(tcp) + len(data), 0, 0x4000, 64, 6, 0)
        + source.packed
        + target.packed
    )
    ip = ip[:10] + pack(">H", _sum(ip)) + ip[12:]
    return macs + b"\x08\x00" + ip + tcp + data


def _upper_pdu(stream: _Stream, frame: bytes, *, is_request: bool) -> bytes:
    """Return an RTU frame with the name of its dissector; the port shows the direction."""
    ports = (stream.port, MODBUS_PORT) if is_request else (MODBUS_PORT, stream.port)
    tags = (
        (_TAG_DISSECTOR, b"mbrtu"),
        (_TAG_IPV4_FROM, HERE.packed),
        (_TAG_IPV4_TO, HERE.packed),
        (_TAG_PORT_TYPE, _U32.pack(_PORT_TYPE_TCP)),
        (_TAG_PORT_FROM, _U32.pack(ports[0])),
        (_TAG_PORT_TO, _U32.pack(ports[1])),
    )
    head = b"".join(pack(">HH", tag, len(_padded(value))) + _padded(value) for tag, value in tags)
    return head + pack(">HH", _TAG_END, 0) + frame


def _interface(where: _Interface, name: str, description: str) -> bytes:
    link_type = ETHERNET if where.is_mbap else UPPER_PDU
    options = _options((_NAME, name.encode()), (_DESCRIPTION, description.encode()), (_RESOLUTION, b"\x09"))
    return _block(_INTERFACE, pack("<HHI", link_type, 0, 0) + options)


def _options(*options: tuple[int, bytes]) -> bytes:
    made = b"".join(pack("<HH", code, len(value)) + _padded(value) for code, value in options)
    return made + pack("<HH", 0, 0)


def _block(kind: int, body: bytes) -> bytes:
    size = len(body) + 12
    return pack("<II", kind, size) + body + pack("<I", size)


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)


def _sum(data: bytes) -> int:
    """Return the Internet checksum (RFC 1071)."""
    data += bytes(len(data) % 2)
    total = sum(int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return total ^ 0xFFFF


def _address(host: str) -> Address:
    """Return the address of a host; that of this machine if it is a name, unspecified or missing."""
    try:
        address = ip_address(host.partition("%")[0])
    except ValueError:
        return HERE
    return HERE if address.is_unspecified else address


def _of_one_kind(client: Address, server: Address) -> tuple[Address, Address]:
    if client.version == server.version:
        return client, server
    return _as_ipv6(client), _as_ipv6(server)


def _as_ipv6(address: Address) -> IPv6Address:
    """Return an address as one of 128 bits (RFC 4291, 2.5.5.2)."""
    return (
        address if isinstance(address, IPv6Address) else IPv6Address(bytes(10) + b"\xff\xff" + address.packed)
    )
