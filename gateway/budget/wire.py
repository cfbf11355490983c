"""Frames and the wires that carry them: number of bytes, character time, required silence.

The numbers of a wire are the relay's own: ``gateway.transport.framing``.
"""

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from msgspec import Struct

from gateway.drives.motion import Form
from gateway.modbus.lengths import ADU_OVERHEAD
from gateway.times import NS_PER_S
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.framing import TCP_SILENCE_NS, frame_silence_ns

# --- bytes of frames ---------------------------------------------------------------------------------------
#
# Of the PDUs that carry positions, triggers and states (Modbus application protocol V1.1b3).

MEI_PDU: Final = 12
"""CANopen general reference: function, MEI type, option, two reserved, index, sub-index, start, count."""
MOST_READ: Final = 125
MOST_WRITTEN: Final = 123


class PduSizes(NamedTuple):
    """Sizes of the PDUs of a request and its reply, in bytes."""

    request_bytes: int
    reply_bytes: int
    ends_by_silence: bool = False
    """Their length does not follow from their own bytes; each ends with a silence on its wire."""


READS: Final[Mapping[Form, Callable[[int], PduSizes]]] = {
    Form.FC03: lambda words: PduSizes(5, 2 + 2 * words),
    Form.FC04: lambda words: PduSizes(5, 2 + 2 * words),
    Form.MEI: lambda words: PduSizes(MEI_PDU, MEI_PDU + 2 * words, ends_by_silence=True),
}
WRITES: Final[Mapping[Form, Callable[[int], tuple[PduSizes, ...]]]] = {
    Form.FC06: lambda words: (PduSizes(5, 5),) * words,
    Form.FC16: lambda words: (PduSizes(6 + 2 * words, 5),),
    Form.MEI: lambda words: (PduSizes(MEI_PDU + 2 * words, MEI_PDU, ends_by_silence=True),),
}
READ_BIT: Final = PduSizes(5, 3)
"""One coil or discrete input."""
WRITE_WORD: Final = PduSizes(5, 5)
"""FC06, and FC05 for a coil."""


def read_frame(form: Form, words: int) -> PduSizes:
    """Return the read of so many registers.

    >>> read_frame(Form.FC03, 2)
    PduSizes(request_bytes=5, reply_bytes=6, ends_by_silence=False)
    """
    return READS[form](words)


def write_frames(form: Form, words: int) -> tuple[PduSizes, ...]:
    """Return the frames that write so many registers: one, or one for each word.

    >>> len(write_frames(Form.FC06, 2)), write_frames(Form.FC16, 2)[0].request_bytes
    (2, 10)
    """
    return WRITES[form](words)


# --- one side of the gateway -------------------------------------------------------------------------------

MBAP_OVERHEAD: Final = 7
"""Transaction, protocol, length and unit id (Modbus messaging on TCP/IP V1.0b, 3.1.3)."""


class Wire(Struct, frozen=True):
    """One side of the gateway."""

    bits_per_byte: int = 0
    """Start, data, parity and stop bits; 0 if the times are unknown."""
    baudrate: int = 0
    """0 if it is not a serial port."""
    silence_ns: int = 0
    """Minimum silence between two frames; 0 on TCP."""
    tail_ns: int = 0
    """Silence that ends a frame whose length does not follow from its own bytes; 0 on Modbus TCP."""
    overhead_bytes: int = ADU_OVERHEAD
    """Bytes of a frame besides its PDU."""
    is_hidden: bool = False
    """There is a serial line behind a serial device server, and its times are unknown."""

    @property
    def is_serial(self) -> bool:
        """Whether it is a serial port of this machine, whose times are known."""
        return self.baudrate > 0

    @property
    def character_ns(self) -> int:
        """Character time; 0 if unknown."""
        return round(self.bits_per_byte * NS_PER_S / self.baudrate) if self.baudrate else 0

    def frame_bytes(self, pdu_bytes: int) -> int:
        """Return the bytes of a whole frame."""
        return pdu_bytes + self.overhead_bytes

    def frame_ns(self, pdu_bytes: int) -> int:
        """Return the duration of a frame from its first bit to its last; 0 if unknown.

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
