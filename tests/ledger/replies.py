"""What a controller has to be answered, given what its drive answered."""

from tests.ledger.events import Book
from tests.ledger.exchanges import Frame, Request, read_fields
from tests.ledger.frames import native_success, words_of
from tests.ledger.judging import Judge


def check_reply(judge: Judge, request: Request, frame: Frame, pdu: bytes, book: Book) -> None:
    """Hold a controller's reply against that of its drive."""
    drive_pdu = frame.reply
    assert drive_pdu is not None
    wanted = _wanted(request, frame, drive_pdu)
    if wanted is not None:
        if pdu != wanted:
            detail = f"{request.pdu.hex(' ')} was answered {pdu.hex(' ')} instead of {wanted.hex(' ')}"
            book.violation("wrong-reply", detail, judge.witness.journal)
        return
    _check_data(judge, request, frame, pdu, book)


def _wanted(request: Request, frame: Frame, drive_pdu: bytes) -> bytes | None:
    """Return the reply that follows byte for byte; None where positions were read."""
    if drive_pdu[0] >= 0x80:
        return bytes((request.pdu[0] | 0x80, drive_pdu[1])) if len(drive_pdu) == 2 else drive_pdu
    if not native_success(frame.pdu, drive_pdu):
        is_recast = frame.pdu[0] != request.pdu[0]
        return bytes((request.pdu[0] | 0x80, 4)) if is_recast else drive_pdu
    if request.parsed.read is not None:
        return None
    if request.parsed.function in (6, 22):
        return request.pdu
    return request.pdu[:5] if request.parsed.function == 16 else drive_pdu


def _check_data(judge: Judge, request: Request, frame: Frame, pdu: bytes, book: Book) -> None:
    assert request.parsed.read is not None
    assert frame.parsed.read is not None
    assert frame.reply is not None
    (address, count), (sent_address, sent_count) = request.parsed.read, frame.parsed.read
    if pdu[:2] != bytes((request.pdu[0], 2 * count)) or len(pdu) != 2 + 2 * count:
        detail = f"{request.pdu.hex(' ')} was answered {pdu.hex(' ')}"
        book.violation("wrong-reply", detail, judge.witness.journal)
        return
    if len(frame.reply) != 2 + 2 * sent_count:
        return  # the drive answered something else
    told = dict(enumerate(words_of(pdu[2:]), address))
    held = dict(enumerate(words_of(frame.reply[2:]), sent_address))
    for field in read_fields(judge.layout):
        part = {i: told.pop(field + i) for i in (0, 1) if field + i in told}
        if part:
            _check_position(judge, field, (held[field], held[field + 1]), part, frame)
    wrong = {hex(a): (hex(word), hex(held[a])) for a, word in told.items() if word != held[a]}
    if wrong:
        book.violation("touched-other-words", f"{request.pdu.hex(' ')}: {wrong}", judge.witness.journal)


def _check_position(
    judge: Judge, field: int, held: tuple[int, int], part: dict[int, int], frame: Frame
) -> None:
    layout, corrected = judge.layout, judge.layout.join(held)
    if field != layout.command or field == layout.actual:
        assert frame.sample is not None
        sample = frame.sample
        judge.witness.check_reading(corrected, part, is_stationary=sample.is_stationary, faded=sample.faded)
        return
    belief = judge.belief
    if not belief.is_target_ok or belief.nominal is None:
        return
    judge.book.seen["targets read back"] += 1
    wanted = layout.split(belief.nominal)
    if belief.is_raw:
        return
    if any(wanted[i] != word for i, word in part.items()):
        words = {i: hex(word) for i, word in part.items()}
        detail = (
            f"{belief.nominal} was acknowledged, the drive holds {corrected}, the controller reads {words}"
        )
        judge.book.violation("target-read-back", detail, judge.witness.journal)
