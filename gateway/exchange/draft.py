"""A target that left the short way, with all that is needed to tell the long way about it.

Its drive answers with the usual echo nearly always; what a :class:`Rewriting` holds is worked out afterwards,
when nobody waits for it any more.
"""

from typing import NamedTuple

from gateway.compensation.moves import SteadyMove
from gateway.counts import Counts
from gateway.exchange.access import Access
from gateway.exchange.axis import Rendering
from gateway.exchange.known import NOTHING_KNOWN
from gateway.exchange.request import Request
from gateway.exchange.rewriting import Rewriting
from gateway.exchange.unit import FieldHit, UnitMap


class Place(NamedTuple):
    """Where the target stands in its frames."""

    unit: UnitMap
    access: Access
    hit: FieldHit


Draft = tuple[Place, bytes, bytes, Counts, int, SteadyMove | None]
"""A target on the wire: its place, nominal and corrected words, corrected counts, losses of its shadow when
it was sent, and what accepting it means (None for a repeat). A plain tuple: one is made for each setpoint."""


def rendering_of(draft: Draft) -> Rendering:
    """Return the target as the long way would have rendered it."""
    place, nominal_words, corrected_words, corrected_counts, _, steady = draft
    axis, shadow = place.hit.place.axis, place.hit.place.shadow
    assert shadow is not None
    move = None if steady is None else axis.compensation.move_of(steady)
    fields = (axis, shadow, nominal_words, corrected_words, corrected_counts, move, False)
    return tuple.__new__(Rendering, fields)


def rewriting_of(draft: Draft, rendering: Rendering, request: tuple[bytes, int, int]) -> Rewriting:
    """Return a request as the long way would have prepared it: its PDU, when it was sent and when it came."""
    unit, access, hit = draft[0]
    pdu, sent_ns, arrived_ns = request
    start = access.data_offset + 2 * hit.word
    words = rendering.corrected_words
    sent_pdu = pdu[:start] + words + pdu[start + len(words) :]
    prepared = Request(unit, pdu, access, [], NOTHING_KNOWN, sent_ns, arrived_ns)
    rewriting = Rewriting(prepared, sent_pdu, (rendering,))
    rewriting.command_hits = (hit,)
    rewriting.losses = {id(rendering.shadow): draft[4]}
    return rewriting
