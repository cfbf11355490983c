"""Times and decoders that follow from the kind of endpoint."""

from collections.abc import Mapping
from typing import Final

from gateway.modbus.rtu import RtuReplyDecoder, RtuRequestDecoder, silence_ns
from gateway.modbus.rtu_replies import NOBODY
from gateway.modbus.rtu_requests import NO_UNITS
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint

TCP_SILENCE_NS: Final = 5_000_000
"""RTU through a serial device server loses the silence between frames. This long without a byte ends a frame
whose length its own bytes do not give, if its CRC is right."""
TCP_GIVE_UP_NS: Final = 50_000_000


def frame_silence_ns(endpoint: SerialEndpoint) -> int:
    """Return the silence between two frames on a serial line, in ns."""
    return silence_ns(endpoint.baudrate, endpoint.bits_per_character)


def request_decoder(
    endpoint: TcpEndpoint | SerialEndpoint, odd_units: frozenset[int] = NO_UNITS
) -> RtuRequestDecoder:
    """Return a decoder for an RTU controller; ``odd_units`` as in the decoder, for a serial port only."""
    if isinstance(endpoint, SerialEndpoint):
        return RtuRequestDecoder(frame_silence_ns(endpoint), odd_units=odd_units)
    return RtuRequestDecoder(TCP_SILENCE_NS, TCP_GIVE_UP_NS)


def reply_decoder(
    endpoint: TcpEndpoint | SerialEndpoint,
    refused_reads: Mapping[int, int] = NOBODY,
    odd_units: frozenset[int] = NO_UNITS,
) -> RtuReplyDecoder:
    """Return a decoder for RTU drives; the arguments as in ``RtuReplyDecoder``."""
    if isinstance(endpoint, SerialEndpoint):
        silence_ns = frame_silence_ns(endpoint)
        return RtuReplyDecoder(
            silence_ns, echo=endpoint.echo, refused_reads=refused_reads, odd_units=odd_units
        )
    return RtuReplyDecoder(TCP_SILENCE_NS, TCP_GIVE_UP_NS, refused_reads=refused_reads)


RETURNS: Final = "set echo = true: the adapter returns what is sent"
"""The problem of a serial port that echoes although the configuration does not say so."""


def returns_requests(endpoint: TcpEndpoint | SerialEndpoint) -> str:
    """Return problem and remedy if requests to drives are echoed and the configuration does not say so."""
    if isinstance(endpoint, SerialEndpoint):
        return RETURNS
    return "switch off the echo of the device server: it returns what is sent"


def endpoint_key(endpoint: TcpEndpoint | SerialEndpoint) -> str:
    """Return the configuration key of an endpoint."""
    if isinstance(endpoint, SerialEndpoint):
        return "rtu"
    return "rtu_over_tcp" if endpoint.rtu else "tcp"
