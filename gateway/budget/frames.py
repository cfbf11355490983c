"""Bytes of the PDUs with which positions, triggers and states travel (Modbus application protocol V1.1b3)."""

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from gateway.drives.motion import Form

MEI_PDU: Final = 12
"""CANopen general reference: function, MEI type, option, two reserved, index, sub-index, start, count."""
MOST_READ: Final = 125
MOST_WRITTEN: Final = 123


class Frame(NamedTuple):
    """A request and its reply: bytes of their PDUs."""

    request_bytes: int
    reply_bytes: int
    ends_by_silence: bool = False
    """Their own bytes do not say how long they are, so each ends where its wire falls silent."""


READS: Final[Mapping[Form, Callable[[int], Frame]]] = {
    Form.FC03: lambda words: Frame(5, 2 + 2 * words),
    Form.FC04: lambda words: Frame(5, 2 + 2 * words),
    Form.MEI: lambda words: Frame(MEI_PDU, MEI_PDU + 2 * words, ends_by_silence=True),
}
WRITES: Final[Mapping[Form, Callable[[int], tuple[Frame, ...]]]] = {
    Form.FC06: lambda words: (Frame(5, 5),) * words,
    Form.FC16: lambda words: (Frame(6 + 2 * words, 5),),
    Form.MEI: lambda words: (Frame(MEI_PDU + 2 * words, MEI_PDU, ends_by_silence=True),),
}
READ_BIT: Final = Frame(5, 3)
"""One coil or discrete input."""
WRITE_WORD: Final = Frame(5, 5)
"""FC06, and FC05 for a coil."""


def read_frame(form: Form, words: int) -> Frame:
    """Return the read of so many registers.

    >>> read_frame(Form.FC03, 2)
    Frame(request_bytes=5, reply_bytes=6, ends_by_silence=False)
    """
    return READS[form](words)


def write_frames(form: Form, words: int) -> tuple[Frame, ...]:
    """Return what writes so many registers: one frame, or one for each word.

    >>> len(write_frames(Form.FC06, 2)), write_frames(Form.FC16, 2)[0].request_bytes
    (2, 10)
    """
    return WRITES[form](words)
