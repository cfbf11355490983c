"""What goes wrong on the way to a drive and back."""

import random
from enum import Enum
from typing import Final

from tests.ledger.frames import native_success, parse

EXCEPTION_CODES: Final = (1, 2, 3, 4, 6, 0x27, 0x35)
OF_WHAT_MAY_BE_DONE: Final = EXCEPTION_CODES[1:]
"""Who does not know a function has not carried it out (M7)."""


class Fault(Enum):
    NONE = "none"
    DELAYED = "reply delayed"
    LATE = "reply late"
    LATE_BOTH = "taken and answered late"
    REPLY_LOST = "reply lost"
    REQUEST_LOST = "request lost"
    REPLY_GARBLED = "reply garbled"
    REQUEST_GARBLED = "request garbled"
    REFUSED = "exception, nothing done"
    REFUSED_DONE = "exception, done all the same"
    STALE = "an old echo, done"
    STALE_NOT_DONE = "an old echo, nothing done"


_ALL: Final = tuple(fault for fault in Fault if fault is not Fault.NONE)
IS_DONE: Final = frozenset(_ALL) - {
    Fault.REQUEST_LOST, Fault.REQUEST_GARBLED, Fault.REFUSED, Fault.STALE_NOT_DONE
}  # fmt: skip


def choose(rng: random.Random, share: float, *, exception_writes_nothing: bool) -> Fault:
    """Return what goes wrong with one exchange; mostly nothing."""
    if rng.random() >= share:
        return Fault.NONE
    fault = rng.choice(_ALL)
    if fault is Fault.REFUSED_DONE and exception_writes_nothing:
        return Fault.REFUSED
    return fault


def stale_reply(pdu: bytes, right: bytes, rng: random.Random) -> bytes | None:
    """Return a reply to a write as an older or confused one would look; None where there is none."""
    parsed = parse(pdu)
    if parsed.function == 6:
        stale = rng.choice([pdu[:3] + b"\xff\xff", pdu[:3] + rng.randbytes(2)])
    elif parsed.function == 16:
        stale = rng.choice([pdu[:3] + b"\x00\x00", b"\x10" + rng.randbytes(2) + pdu[3:5]])
    elif parsed.function == 22:
        stale = pdu[:3] + rng.randbytes(4)
    else:
        return None
    return None if stale == right or native_success(pdu, stale) else stale
