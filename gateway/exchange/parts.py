"""Parts of positions: what a request writes of a command field, and what it makes of the whole."""

from gateway.exchange.access import Access
from gateway.exchange.request import Request
from gateway.exchange.unit import FieldHit, FieldPlace, UnitMap
from gateway.modbus.errors import RegisterRangeError
from gateway.modbus.registers import WordOrder


def written_part(hit: FieldHit, pdu: bytes, access: Access) -> tuple[int, bytes]:
    """Return the part of a command field that a request writes: its first word, and the words."""
    data = access.words(pdu)
    first = max(0, -hit.word)
    start = 2 * max(0, hit.word)
    return first, data[start : start + 2 * (hit.place.field.words - first)]


def nominal_words(hit: FieldHit, request: Request) -> bytes | None:
    """Return all words of a command field once this request is applied, or None when some are not known."""
    shadow = hit.place.shadow
    assert shadow is not None
    pdu, access, known = request.pdu, request.access, request.known
    if access.is_mask:
        return _masked(hit, pdu, access)
    first, words = written_part(hit, pdu, access)
    if hit.is_whole:
        return words
    completed = shadow.completed(first, words, request.arrived_ns)
    read = known.command_words.get(id(shadow))
    if completed is None and read is not None and not shadow.is_torn:
        merged = bytearray(read)
        merged[2 * first : 2 * first + len(words)] = words
        if kept_words_are_certain(hit.place, read, first, len(words) // 2):
            completed = bytes(merged)
    return completed


def _masked(hit: FieldHit, pdu: bytes, access: Access) -> bytes | None:
    shadow = hit.place.shadow
    if shadow is None or shadow.is_torn or shadow.nominal_words is None:
        return None  # a mask needs the exact word that it is laid over
    merged = bytearray(shadow.nominal_words)
    at = -2 * hit.word
    data = pdu[access.data_offset :]
    current = merged[at] << 8 | merged[at + 1]
    and_mask, or_mask = data[0] << 8 | data[1], data[2] << 8 | data[3]
    merged[at : at + 2] = ((current & and_mask) | (or_mask & ~and_mask & 0xFFFF)).to_bytes(2, "big")
    return bytes(merged)


def kept_words_are_certain(place: FieldPlace, words: bytes, first: int, count: int) -> bool:
    """Whether the words that a partial write keeps are the same for every position that they may stand for.

    The drive's register holds a corrected position, and which correction it was given may not be known any
    more: the nominal one lies within ``max_correction`` of it, perhaps across a word's border.
    """
    settings = place.axis.plan.settings
    margin = settings.max_correction * abs(settings.counts_per_unit) / place.field.scale
    raw = place.field.unpack(words)
    if place.field.type.is_float:
        return False
    try:
        ends = [place.field.pack(round(raw + sign * margin)) for sign in (-1.0, 1.0)]
    except RegisterRangeError:
        return False
    kept = [i for i in range(place.field.words) if not first <= i < first + count]
    least = 0 if place.field.order is WordOrder.LOW_FIRST else place.field.words - 1
    return least not in kept and all(
        end[2 * i : 2 * i + 2] == words[2 * i : 2 * i + 2] for end in ends for i in kept
    )


def note_unsent(unit: UnitMap, pdu: bytes, access: Access, arrived_ns: int) -> None:
    """Note that a request never reached the drive: what it wrote is lost, and torn from the rest (M3)."""
    for hit in unit.written(access.write_address, access.write_quantity).fields:
        note_lost(hit, pdu, access, arrived_ns)


def note_held(hit: FieldHit, pdu: bytes, access: Access, arrived_ns: int) -> None:
    """Note a part of a command field that the drive acknowledged while the rest is not known."""
    assert hit.place.shadow is not None
    hit.place.shadow.hold(*written_part(hit, pdu, access), arrived_ns)


def note_lost(hit: FieldHit, pdu: bytes, access: Access, arrived_ns: int) -> None:
    """Note that what a request wrote into one command field was lost."""
    shadow = hit.place.shadow
    if shadow is None:
        return
    if hit.is_whole or access.is_mask or not access.is_consistent:
        shadow.tear(arrived_ns)
    else:
        shadow.lose(*written_part(hit, pdu, access), arrived_ns)
