"""Limits and further addresses of a position, and drives that take single registers only."""

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.motion import Form
from gateway.exchange.control import switch
from gateway.modbus.registers import PositionField, RegisterType, WordOrder
from tests.exchange.line_bench import COMMAND, Bench, axis_plan, read, write
from tests.exchange.staged_bench import COMMANDED, HOME_PDU, ONLY_ABSOLUTE, RUN_PDU, StagedBench, staged_plan

INT32 = RegisterType.INT32
LOW = WordOrder.LOW_FIRST
ONE_SIDED = make_table([0, 100], [0.01, 0.01], [0.0, 0.0], Units.MM)

# --- limits and aliases -----------------------------------------------------------------------------------

LIMIT = PositionField(0x0900, INT32, LOW)
ALIAS = PositionField(0x0904, INT32, LOW)


def test_limits_are_corrected_half_way_between_the_branches_and_read_back_exactly() -> None:
    bench = Bench(axis_plan(limits=(LIMIT,), table=ONE_SIDED))
    bench.ask(write(LIMIT, 90_000))
    assert bench.memory.get(LIMIT) == 90_005
    assert LIMIT.unpack(bench.ask(read(LIMIT))[2:]) == 90_000
    bench.move(50_000, 40_000)
    assert LIMIT.unpack(bench.ask(read(LIMIT))[2:]) == 90_000


def test_limits_a_limit_of_0_means_none_and_passes() -> None:
    bench = Bench(axis_plan(limits=(LIMIT,), table=ONE_SIDED))
    bench.ask(write(LIMIT, 0))
    assert bench.memory.get(LIMIT) == 0
    assert LIMIT.unpack(bench.ask(read(LIMIT))[2:]) == 0


def test_limits_half_a_limit_is_refused() -> None:
    bench = Bench(axis_plan(limits=(LIMIT,), table=ONE_SIDED))
    assert bench.ask(bytes.fromhex("06 0900 1234")) == bytes.fromhex("86 04")


def test_aliases_are_turned_back_like_the_position_itself_and_not_written() -> None:
    bench = Bench(axis_plan(aliases=(ALIAS,)))
    bench.move(50_000)
    bench.memory.put(ALIAS, 50_010)
    assert ALIAS.unpack(bench.ask(read(ALIAS))[2:]) == 50_000
    assert bench.ask(write(ALIAS, 1)) == bytes.fromhex("90 02")


# --- drives that take single registers only ---------------------------------------------------------------

SINGLE = {"writes_with": Form.FC06, "motion": ONLY_ABSOLUTE}


def test_fc06_drives_get_each_word_alone_and_the_trigger_puts_them_right() -> None:
    bench = StagedBench(staged_plan(**SINGLE))
    for part in ("06 0606 FFFA", "06 0607 0000"):  # 65 530
        assert bench.ask(bytes.fromhex(part)) == bytes.fromhex(part)
    bench.trigger()
    # forward it is 65 540: both words change with the carry
    assert bench.drive.moves == [("absolute", 65_540)]
    assert all(pdu[0] != 16 for pdu in bench.seen)
    bench.settle()
    assert COMMAND.unpack(bench.ask(read(COMMAND))[2:]) == 65_530


def test_fc06_only_the_words_that_differ_are_written_anew() -> None:
    """M2: of the first target no word is known; 49000, BF68 0000, is BF5E 0000 backward, and BF68 if off."""
    bench = StagedBench(staged_plan(**SINGLE))
    bench.ask(bytes.fromhex("06 0607 0000"))
    bench.ask(bytes.fromhex("06 0606 C350"))
    bench.writes()
    bench.trigger()
    assert bench.writes() == ["06 06 06 c3 5a", "06 06 07 00 00", RUN_PDU.hex(" ")]
    bench.settle()
    bench.ask(bytes.fromhex("06 0606 BF68"))
    assert bench.writes() == ["06 06 06 bf 5e"]
    switch(bench.line.axes, "x", is_on=False)
    bench.trigger()
    assert bench.writes() == ["06 06 06 bf 68", RUN_PDU.hex(" ")]


# --- words that are not known ------------------------------------------------------------------------------


def went_to(bench: StagedBench, *targets: int) -> None:
    """Go to targets that are written word by word, and stand there."""
    for counts in targets:
        for pdu in words_of(counts):
            assert bench.ask(pdu) == pdu
        bench.trigger()
        bench.settle()


def words_of(counts: int, place: PositionField = COMMAND) -> list[bytes]:
    """The two FC06 that write a target, in the order of its registers."""
    words = place.pack(counts)
    return [
        b"\x06" + (place.address + word).to_bytes(2, "big") + words[2 * word : 2 * word + 2]
        for word in range(2)
    ]


def test_fc06_every_word_that_is_not_known_is_written_anew() -> None:
    """M2: 0 backward is -10, FFF6 FFFF; homing makes that doubtful, and from -2000 it is 10: 000A 0000.

    The word that is 0000 is written too: 000A beside FFFF would be -65526.
    """
    bench = StagedBench(staged_plan(**SINGLE))
    went_to(bench, -1000, 1000, 0)
    assert bench.drive.get(COMMAND) == -10
    bench.ask(HOME_PDU)
    bench.drive.put(COMMANDED, -2000)
    bench.settle()
    bench.writes()
    bench.trigger()
    assert bench.writes() == ["06 06 06 00 0a", "06 06 07 00 00", "06 05 0e 00 01"]
    assert bench.drive.moves[-1] == ("absolute", 10)


def test_fc06_every_word_that_is_not_known_is_written_anew_high_word_first() -> None:
    """M2: 65526 backward is 65516, 0000 FFEC; after homing it is 65536 forward from 0: 0001 0000.

    The word that is 0000 is written too: 0001 beside FFEC would be 131052.
    """
    high_first = PositionField(COMMAND.address, INT32, WordOrder.HIGH_FIRST)
    bench = StagedBench(staged_plan(command=(high_first,), **SINGLE))
    for counts in (70_000, 80_000, 65_526):
        for pdu in words_of(counts, high_first):
            assert bench.ask(pdu) == pdu
        bench.trigger()
        bench.settle()
    assert bench.drive.get(high_first) == 65_516
    bench.ask(HOME_PDU)
    bench.drive.put(COMMANDED, 0)
    bench.settle()
    bench.writes()
    bench.trigger()
    assert bench.writes() == ["06 06 06 00 01", "06 06 07 00 00", "06 05 0e 00 01"]
    assert bench.drive.get(high_first) == 65_536


def test_fc06_a_target_of_which_one_word_was_written_anew_is_not_believed_whole() -> None:
    """M2: as above, and the second word is refused; the first alone would be -65526 and does not run.

    0 written again goes out as 0000 and, once it is whole, as 0000; the trigger writes 000A 0000, each word.
    """
    bench = StagedBench(staged_plan(**SINGLE))
    went_to(bench, -1000, 1000, 0)
    bench.ask(HOME_PDU)
    bench.drive.put(COMMANDED, -2000)
    bench.settle()
    bench.send(RUN_PDU)
    assert bench.link.take() == bytes.fromhex("06 0606 000A")
    bench.drive.write(0x0606, bytes.fromhex("000A"))
    bench.line.reply(1, bytes.fromhex("06 0606 000A"), bench.now_ns)
    assert bench.answers(bytes.fromhex("86 04")) == bytes.fromhex("06 0607 0000")
    assert bench.link.sent == []
    assert bench.port.take() == bytes.fromhex("86 04")
    assert bench.drive.get(COMMAND) == -65_526
    assert bench.refused(RUN_PDU) == 4
    for pdu in words_of(0):
        assert bench.ask(pdu) == pdu
    bench.writes()
    bench.trigger()
    assert bench.writes() == ["06 06 06 00 0a", "06 06 07 00 00", "06 05 0e 00 01"]
    assert bench.drive.moves[-1] == ("absolute", 10)


def test_fc06_a_word_that_passed_as_it_came_is_not_taken_for_the_one_before() -> None:
    """M1, M2: the drive holds -10, FFF6 FFFF, for 0; 2000 mm is refused, for it is outside the travel.

    Of 0 written again the first word passes as it came, 0000, for its other word was lost; the second is
    corrected, FFFF. The trigger writes FFF6 FFFF anew, each word: 0000 beside FFFF would be -65536.
    """
    bench = StagedBench(staged_plan(travel=(-140.0, 140.0), **SINGLE))
    went_to(bench, -1000, 1000, 0)
    bench.writes()
    assert bench.ask(write(COMMAND, 2_000_000)) == bytes.fromhex("90 04")
    for pdu in words_of(0):
        assert bench.ask(pdu) == pdu
    assert bench.writes() == ["06 06 06 00 00", "06 06 07 ff ff"]
    bench.trigger()
    assert bench.writes() == ["06 06 06 ff f6", "06 06 07 ff ff", "06 05 0e 00 01"]
    assert bench.drive.moves[-1] == ("absolute", -10)
