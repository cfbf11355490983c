"""What has to be met somewhere in a whole run of ``python -m tests.verify``, and what no world can meet.

A rule that was never put to the test proves nothing. So each row of the tables of states is either met, or
stands below with the reason why no world reaches it; the same holds for the events of the exchange, the
exceptions that a controller may be answered, and the ends of what is cut through.
"""

from collections.abc import Collection
from typing import Final

from gateway.catalogue import exchange_events
from gateway.catalogue.entry import entries_of
from gateway.exchange.cut_through.frame import ForwardEvent
from tests.verify.snapshot import all_rows

EXCEPTIONS: Final = (1, 4, 6, 0x0A, 0x0B)
FORWARDED_REQUESTS: Final = frozenset(ForwardEvent) - {
    ForwardEvent.OPENED,
    ForwardEvent.FITTED,
    ForwardEvent.JUDGED,
    ForwardEvent.KEPT,
}
FORWARDED_REPLIES: Final = FORWARDED_REQUESTS - {
    ForwardEvent.OVERTAKEN,
    ForwardEvent.MET,
    ForwardEvent.UNFIT,
    ForwardEvent.REFUSED,
}
"""Nothing overtakes a reply or meets it, its head is known before it begins, and it can be turned back."""
FORWARD_ENDS: Final = frozenset(
    f"cut {name} {event.value}"
    for name, events in (("request", FORWARDED_REQUESTS), ("reply", FORWARDED_REPLIES))
    for event in events
)
"""How what has left in part while it arrived can end (W12)."""
NO_TABLE: Final = "taken without the table, as each setpoint of a stream takes it"
NO_WAY: Final = "no world has a way there yet"
NOT_MET: Final[dict[str, str]] = {
    "event budget-kept": "the time budget is measured on a machine, not in a world",
    "event budget-overrun": "the time budget is measured on a machine, not in a world",
    "event connection-renewed": "no world has a connection: all drives are at serial ports",
    "event late-target": "what waits in these worlds waits for the silence of its own drive, and is answered",
    "event cut-through-off": "how ports hand bytes over is not learned in a world",
    "event late-reply": "late frames come while the line waits for silence anyway",
    "event internal-fault": "a bug of the gateway, which is raised in a world",
    "event stood-still": "told by the process that stood still",
    "event unknown-unit": "other unit ids are in no world",
    **dict.fromkeys(
        (f"event term-{each}" for each in ("fades", "held", "too-large")),
        "no world waits as long as a sensor may be silent, nor has one so warm",
    ),
    "row moving + acknowledged": NO_TABLE,
    "row gantry: sent + whole": "no world broadcasts to the axes of a group",
    "row gantry: under-way + expired": "no world waits for ten seconds",
    **dict.fromkeys(
        (f"row on the wire: target + {each}" for each in ("motion-sent", "target-sent")),
        "no frame of a world has two targets",
    ),
    "row stop: again + replaces": "no controller of a world sends one stop three times before it is answered",
    **dict.fromkeys(
        (f"row stop: {each} + goes-again" for each in ("again", "first")),
        "writes are held back on a connection that is made anew only, and no world has one",
    ),
    "row stop: no + found-with-more": "the stops of all worlds do nothing else",
    **dict.fromkeys(
        (
            "row may-have-left + reference-changed",
            "row may-have-left + stopped",
            "row at-rest + reference-changed",
            "row at-rest + stopped",
            "row superseded + stopped",
        ),
        NO_WAY,
    ),
}
"""What no world reaches, each with its reason."""


def missing(met: Collection[str]) -> list[str]:
    """Return what should have been met and was not."""
    wanted = {f"row {name}" for name in all_rows()}
    wanted |= {f"event {kind.name}" for kind in entries_of(exchange_events)}
    wanted |= {f"exception {code:#04x}" for code in EXCEPTIONS} | FORWARD_ENDS
    return sorted(wanted - set(met) - set(NOT_MET))
