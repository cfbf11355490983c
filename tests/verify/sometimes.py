"""What has to be met somewhere in a whole run of ``python -m tests.verify``, and what no world can meet.

A rule that was never put to the test proves nothing. So each row of the tables of whereabouts, reference and
block is either met, or stands below with the reason why no world reaches it; the same holds for the events of
the exchange and the exceptions that a controller may be answered.
"""

from collections.abc import Collection
from typing import Final

from gateway.exchange.events import EventKind
from tests.verify.snapshot import all_rows

EXCEPTIONS: Final = (1, 4, 6, 0x0A, 0x0B)
NOT_MET: Final[dict[str, str]] = {}
"""What no world reaches, each with its reason."""


def missing(met: Collection[str]) -> list[str]:
    """Return what should have been met and was not."""
    wanted = {f"row {name}" for name in all_rows()}
    wanted |= {f"event {kind.value}" for kind in EventKind}
    wanted |= {f"exception {code:#04x}" for code in EXCEPTIONS}
    return sorted(wanted - set(met) - set(NOT_MET))
