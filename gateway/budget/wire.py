"""One side of the gateway as a wire: what a byte takes, what silence frames need, what a frame adds to a PDU.

The numbers are those that the relay itself goes by: ``gateway.transport.framing``.
"""

from dataclasses import dataclass
from typing import Final

from gateway.modbus.lengths import ADU_OVERHEAD
from gateway.times import NS_PER_S
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.framing import TCP_SILENCE_NS, frame_silence_ns

MBAP_OVERHEAD: Final = 7
"""Transaction, protocol, length and unit id (Modbus messaging on TCP/IP V1.0b, 3.1.3)."""


@dataclass(frozen=True, slots=True)
class Wire:
    """One side of the gateway."""

    bits_per_byte: int = 0
    """Start, data, parity and stop bits; 0 where no time on a wire is known."""
    baudrate: int = 0
    """0 where there is no serial port."""
    silence_ns: int = 0
    """Least silence between two frames; 0 on TCP."""
    tail_ns: int = 0
    """Silence that ends a frame whose own bytes do not say how long it is; 0 on Modbus TCP."""
    overhead_bytes: int = ADU_OVERHEAD
    """What a frame has besides its PDU."""
    is_hidden: bool = False
    """There is a serial line behind a serial device server, of which nothing is known."""

    @property
    def is_serial(self) -> bool:
        """Whether it is a serial port of this machine, whose times are known."""
        return self.baudrate > 0

    @property
    def character_ns(self) -> int:
        """What a byte takes; 0 where no wire is known."""
        return round(self.bits_per_byte * NS_PER_S / self.baudrate) if self.baudrate else 0

    def frame_bytes(self, pdu_bytes: int) -> int:
        """Return the bytes of a whole frame."""
        return pdu_bytes + self.overhead_bytes

    def frame_ns(self, pdu_bytes: int) -> int:
        """Return how long a frame takes from its first bit to its last; 0 where no wire is known.

        >>> Wire(bits_per_byte=11, baudrate=9600).frame_ns(10)  # FC16 of two registers: 13 bytes
        14895833
        """
        if not self.baudrate:
            return 0
        return round(self.frame_bytes(pdu_bytes) * self.bits_per_byte * NS_PER_S / self.baudrate)


def wire_of(endpoint: TcpEndpoint | SerialEndpoint) -> Wire:
    """Return the wire to a controller or to the drives."""
    if isinstance(endpoint, SerialEndpoint):
        silence_ns = frame_silence_ns(endpoint)
        return Wire(endpoint.bits_per_character, endpoint.baudrate, silence_ns, silence_ns)
    if endpoint.rtu:
        return Wire(tail_ns=TCP_SILENCE_NS, is_hidden=True)
    return Wire(overhead_bytes=MBAP_OVERHEAD)
