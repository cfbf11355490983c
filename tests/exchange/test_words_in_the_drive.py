"""What is known of the words in a drive, after each way in which a write of them can end (M1, M3).

A position of two words, written 0001 0002 by the controller and 000A 0002 in the drive.
"""

from typing import Final

import pytest

from gateway.drives.motion import Action, ModePlan, MotionPlan
from gateway.exchange.axis.registers import Completeness, FieldImage, Loss, NextPart, RuleImage
from gateway.modbus.registers import PositionField, RegisterType
from tests.exchange.line_bench import COMMAND, MS

NOMINAL: Final = bytes.fromhex("0001 0002")
CORRECTED: Final = bytes.fromhex("000A 0002")
FIRST: Final = bytes.fromhex("0003")
SECOND: Final = bytes.fromhex("0004")
BOTH: Final = FIRST + SECOND


def whole(*, waits: bool = False) -> FieldImage:
    image = FieldImage(COMMAND, waits=waits)
    image.settle(NOMINAL, CORRECTED)
    return image


def state(image: FieldImage) -> Completeness:
    return image.completeness


def lose(image: FieldImage, loss: Loss, first: int, words: bytes, *, at_ms: int, follows_ms: int = 0) -> None:
    """A part that arrived then is lost; its controller is told at once."""
    image.lose(loss, first, words, arrived_ns=at_ms * MS, follows_ns=follows_ms * MS, now_ns=at_ms * MS)


def test_forgotten_words_are_unknown_on_both_scales() -> None:
    image = whole()
    image.forget()
    assert (image.nominal_words, image.corrected_words) == (None, None)
    assert not image.holds(0, CORRECTED)
    assert image.completed(0, FIRST, 1 * MS, 0) is None


def test_after_a_refused_part_of_forgotten_words_all_of_them_count_as_lost() -> None:
    image = whole()
    lose(image, Loss.REFUSED_UNWRITTEN, 0, FIRST, at_ms=1)
    assert state(image) is Completeness.PART_REFUSED
    image.forget()
    assert state(image) is Completeness.ALL_LOST
    lose(image, Loss.REFUSED_UNWRITTEN, 0, FIRST, at_ms=2)
    assert state(image) is Completeness.ALL_LOST


def test_after_a_refused_part_of_words_never_known_all_of_them_count_as_lost() -> None:
    image = FieldImage(COMMAND)
    lose(image, Loss.REFUSED_UNWRITTEN, 0, FIRST, at_ms=1)
    assert state(image) is Completeness.ALL_LOST


def test_a_write_sent_before_a_loss_does_not_complete_the_words() -> None:
    for loss in Loss:
        image = whole()
        sent_in = image.epoch
        lose(image, loss, 0, FIRST, at_ms=1)
        image.settle(NOMINAL, CORRECTED, sent_in)
        assert image.is_incomplete, loss
        image.settle(NOMINAL, CORRECTED, image.epoch)
        assert not image.is_incomplete, loss


def test_a_write_sent_before_a_whole_write_was_lost_does_not_complete_the_words() -> None:
    image = whole()
    sent_in = image.epoch
    image.lose_all_words(1 * MS)
    image.settle(NOMINAL, CORRECTED, sent_in)
    assert image.is_incomplete


@pytest.mark.parametrize(("late_ns", "is_joined"), [(0, True), (1, False)])
def test_words_that_were_lost_are_joined_for_200_ms(late_ns: int, is_joined: bool) -> None:
    image = whole()
    lose(image, Loss.WITHDRAWN, 0, FIRST, at_ms=10)
    joined = image.completed(1, SECOND, 210 * MS + late_ns, 10 * MS)
    assert joined == (BOTH if is_joined else None)


def test_words_with_another_request_between_them_are_not_joined() -> None:
    image = whole()
    lose(image, Loss.WITHDRAWN, 0, FIRST, at_ms=10)
    assert image.completed(1, SECOND, 20 * MS, 15 * MS) is None


def test_a_part_from_before_a_lost_write_is_joined_with_none() -> None:
    """The whole one arrived at 50 ms. That the part of 40 ms is lost shows later."""
    image = whole()
    image.lose_all_words(50 * MS)
    lose(image, Loss.WITHDRAWN, 0, FIRST, at_ms=40)
    assert state(image) is Completeness.ALL_LOST
    assert image.completed(1, SECOND, 60 * MS, 40 * MS) is None


def test_words_that_were_all_lost_one_by_one_count_as_a_lost_whole_write() -> None:
    image = whole()
    lose(image, Loss.WITHDRAWN, 0, FIRST, at_ms=10)
    lose(image, Loss.WITHDRAWN, 1, SECOND, at_ms=20, follows_ms=10)
    assert state(image) is Completeness.ALL_LOST
    assert image.completed(0, FIRST, 30 * MS, 20 * MS) is None


def test_words_count_as_a_lost_whole_write_also_if_the_drive_got_the_first_one() -> None:
    image = whole(waits=True)
    image.lose_all_words(5 * MS)
    assert image.next_part(10 * MS) is NextPart.AS_IT_CAME
    image.buffer(0, FIRST, 10 * MS, 5 * MS)
    assert state(image) is Completeness.PARTS_BUFFERED
    lose(image, Loss.WITHDRAWN, 1, SECOND, at_ms=20, follows_ms=10)
    assert state(image) is Completeness.ALL_LOST
    assert image.completed(0, FIRST, 30 * MS, 20 * MS) is None


def test_buffered_words_are_joined_however_late_the_others_come() -> None:
    image = whole(waits=True)
    image.lose_all_words(5 * MS)
    image.buffer(0, FIRST, 10 * MS, 5 * MS)
    assert image.completed(1, SECOND, 9_000 * MS, 8_000 * MS) == BOTH
    image.forget_parts()  # their connection broke
    assert image.completed(1, SECOND, 9_000 * MS, 8_000 * MS) is None


def test_the_loss_of_a_connection_does_not_change_a_whole_target() -> None:
    image = whole()
    image.forget_parts()
    assert not image.is_incomplete
    assert image.completed(1, SECOND, 9_000 * MS, 0) == NOMINAL[:2] + SECOND


def test_a_buffered_part_makes_the_words_in_the_drive_unknown() -> None:
    image = whole(waits=True)
    image.lose_all_words(5 * MS)
    image.buffer(0, FIRST, 10 * MS, 5 * MS)
    assert image.corrected_words is None


def test_a_word_that_comes_once_more_begins_the_parts_again() -> None:
    """Of the first command 0003 came, of the second one 0005 and 0004."""
    image = whole(waits=True)
    image.lose_all_words(5 * MS)
    image.buffer(0, FIRST, 10 * MS, 5 * MS)
    image.buffer(0, bytes.fromhex("0005"), 500 * MS, 400 * MS)
    assert image.completed(1, SECOND, 600 * MS, 500 * MS) == bytes.fromhex("0005 0004")


def test_the_drive_refused_a_part_and_each_word_must_be_acknowledged_again() -> None:
    image = whole()
    lose(image, Loss.REFUSED_UNWRITTEN, 0, FIRST, at_ms=10)
    image.settle(NOMINAL, CORRECTED, image.epoch, written=0b01)
    assert image.is_incomplete
    image.settle(NOMINAL, CORRECTED, image.epoch, written=0b10)
    assert not image.is_incomplete


@pytest.mark.parametrize(
    ("arrived_ms", "handled"), [(9, NextPart.REFUSED), (10, NextPart.COMPLETED), (11, NextPart.COMPLETED)]
)
def test_a_part_that_came_before_its_controller_knew_of_the_refusal_is_refused(
    arrived_ms: int, handled: NextPart
) -> None:
    image = whole()
    lose(image, Loss.REFUSED_UNWRITTEN, 0, FIRST, at_ms=10)
    assert image.next_part(arrived_ms * MS) is handled


# --- four words, of which 0003 0004 come first --------------------------------------------------------------


def long(*, waits: bool = False) -> FieldImage:
    image = FieldImage(PositionField(0x10, RegisterType.INT64), waits=waits)
    image.settle(NOMINAL + NOMINAL, CORRECTED + CORRECTED)
    return image


def test_targets_older_than_the_last_lost_word_do_not_count() -> None:
    image = long()
    lose(image, Loss.WITHDRAWN, 0, FIRST, at_ms=10)
    sent_in = image.epoch
    lose(image, Loss.WITHDRAWN, 1, SECOND, at_ms=20, follows_ms=10)
    image.settle(NOMINAL + NOMINAL, CORRECTED + CORRECTED, sent_in)
    assert image.is_incomplete


def test_a_second_buffered_word_does_not_replace_the_first_one() -> None:
    image = long(waits=True)
    image.lose_all_words(5 * MS)
    image.buffer(0, FIRST, 10 * MS, 5 * MS)
    image.buffer(1, SECOND, 500 * MS, 400 * MS)
    assert state(image) is Completeness.PARTS_BUFFERED
    assert image.completed(2, BOTH, 9_000 * MS, 8_000 * MS) == BOTH + BOTH


def test_a_buffered_word_waits_no_longer_than_the_lost_one_beside_it() -> None:
    image = long(waits=True)
    lose(image, Loss.WITHDRAWN, 0, FIRST, at_ms=10)
    image.buffer(1, SECOND, 20 * MS, 10 * MS)
    assert image.completed(2, BOTH, 210 * MS, 20 * MS) == BOTH + BOTH
    assert image.completed(2, BOTH, 211 * MS, 20 * MS) is None


def test_a_refused_part_is_newer_than_what_came_before_it() -> None:
    image = whole()
    lose(image, Loss.REFUSED_UNWRITTEN, 0, FIRST, at_ms=50)
    lose(image, Loss.WITHDRAWN, 1, SECOND, at_ms=40)
    assert state(image) is Completeness.ALL_LOST


def test_words_that_are_rewritten_one_by_one_are_known_with_the_last_of_them() -> None:
    image = FieldImage(COMMAND)
    image.settle(NOMINAL, NOMINAL)
    image.invalidate()
    image.acknowledge_rewrite(NOMINAL, 0, CORRECTED[:2], image.epoch)
    assert image.corrected_words is None
    assert image.holds(0, CORRECTED[:2])
    assert not image.holds(0, CORRECTED)
    assert image.may_be_corrected
    image.acknowledge_rewrite(NOMINAL, 1, CORRECTED[2:], image.epoch)
    assert image.corrected_words == CORRECTED


def test_words_of_an_earlier_rewriting_are_not_joined_with_those_of_a_later_one() -> None:
    image = whole()
    unknown = (
        image.invalidate,
        lambda: image.settle(NOMINAL, None),
        lambda: image.invalidate_rewritten(BOTH),
    )
    for forget in unknown:
        image.invalidate()
        image.acknowledge_rewrite(NOMINAL, 0, CORRECTED[:2], image.epoch)
        forget()
        image.acknowledge_rewrite(NOMINAL, 1, CORRECTED[2:], image.epoch)
        assert image.corrected_words is None


def test_after_an_unanswered_rewriting_both_words_mean_what_the_controller_wrote() -> None:
    image = whole()
    image.invalidate_rewritten(BOTH)
    assert image.corrected_words is None
    assert [image.means(words) for words in (CORRECTED, BOTH, NOMINAL)] == [NOMINAL, NOMINAL, None]


@pytest.mark.parametrize(
    ("before", "left", "may_be_corrected"),
    [
        (NOMINAL, NOMINAL, False),
        (NOMINAL, CORRECTED, True),
        (CORRECTED, NOMINAL, True),
        (NOMINAL, None, True),
    ],
)
def test_corrected_words_are_possible_once_they_were_sent(
    before: bytes, left: bytes | None, may_be_corrected: bool
) -> None:
    image = FieldImage(COMMAND)
    image.settle(NOMINAL, before)
    image.leave(NOMINAL, left)
    assert image.may_be_corrected is may_be_corrected


def test_forgotten_registers_of_the_rules_are_unknown() -> None:
    rules = RuleImage(MotionPlan())
    rules.store_words({0x30: 5}, 0)
    rules.store_read(0x31, 6)
    rules.store_coils({0x40: 1})
    rules.stage(0)
    assert [rules.word(0x30), rules.word(0x31), rules.coil(0x40), rules.staged] == [5, 6, 1, 0]
    rules.invalidate({0x30: 0}, {0x40: 0})
    assert [rules.word(0x30), rules.word(0x31), rules.coil(0x40)] == [None, 6, None]
    rules.store_coils({0x40: 1})
    rules.forget()
    assert [rules.word(0x31), rules.coil(0x40), rules.staged] == [None, None, None]


MODE: Final = 0x32
FOLLOWS: Final = RuleImage(
    MotionPlan(modes=(ModePlan(MODE, actions={1: Action.FOLLOW, 2: Action.ABSOLUTE}), None), is_staged=True)
)


@pytest.mark.parametrize(("word", "goes"), [(1, True), (2, False), (3, False)])
def test_in_a_mode_that_follows_a_drive_may_move_immediately(word: int, goes: bool) -> None:
    FOLLOWS.store_read(MODE, word)
    assert FOLLOWS.may_go_at_once(0) is goes
    assert not FOLLOWS.may_go_at_once(1)  # this field has no mode
    FOLLOWS.forget()
    assert not FOLLOWS.may_go_at_once(0)


def test_a_lost_mode_is_lost_until_it_is_written_again() -> None:
    FOLLOWS.lose_mode(MODE, 4, 3)
    FOLLOWS.store_words({MODE: 1}, 2)
    assert FOLLOWS.lost_mode(0) == 4
    assert (FOLLOWS.lost_mode(1), FOLLOWS.lost_mode(None)) == (None, None)
    FOLLOWS.store_words({MODE: 1}, 3)
    assert FOLLOWS.lost_mode(0) is None


def test_the_time_of_a_buffered_part_begins_again_when_it_comes_again() -> None:
    """Its 200 ms count from then: a part that was withdrawn joins the other one 110 ms later."""
    image = FieldImage(COMMAND, waits=True)
    for at_ms in (1, 151):
        image.buffer(0, FIRST, at_ms * MS, (at_ms - 1) * MS)
    lose(image, Loss.WITHDRAWN, 0, FIRST, at_ms=161, follows_ms=151)
    assert image.completed(1, SECOND, 261 * MS, 161 * MS) == BOTH
