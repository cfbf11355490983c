"""Options of listening on a line."""

import re
import termios
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final

from gateway.options import Option, Options
from gateway.transport.endpoints import PARITIES

SERIAL_S: Final = 60.0
_RATE: Final = re.compile(r"B([1-9]\d+)")


def serial_rates() -> Sequence[int]:
    """Return the baud rates that a port of this system can be set to."""
    return sorted(int(found[1]) for found in map(_RATE.fullmatch, dir(termios)) if found)


def parities() -> Sequence[str]:
    """Return the words for a parity."""
    return [*PARITIES.values()]


@dataclass(frozen=True, slots=True)
class ListenOptions(Options):
    """How long to listen, and the known settings of a serial line."""

    baudrate: Annotated[int | None, Option("Use this baud rate; do not try others.", one_of=serial_rates)] = (
        None
    )
    parity: Annotated[
        str | None, Option("Use this parity: none, even or odd; do not try others.", one_of=parities)
    ] = None
    seconds: Annotated[
        float | None,
        Option("Seconds to listen; default: 60 on a serial port, until Ctrl-C for a proxy.", "for", min=0.1),
    ] = None


AS_LONG_AS_USUAL: Final = ListenOptions()
