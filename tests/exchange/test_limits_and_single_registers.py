"""Limits and further addresses of a position, and drives that take single registers only."""

from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.motion import Form
from gateway.modbus.registers import PositionField, RegisterType, WordOrder
from tests.exchange.line_bench import COMMAND, Bench, axis_plan, read, write
from tests.exchange.staged_bench import ONLY_ABSOLUTE, RUN_PDU, StagedBench, staged_plan

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
    bench.move(50_000)
    bench.move(40_000)
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
    bench = StagedBench(staged_plan(**SINGLE))
    bench.ask(bytes.fromhex("06 0607 0000"))
    bench.ask(bytes.fromhex("06 0606 C350"))
    bench.writes()
    bench.trigger()
    assert bench.writes() == ["06 06 06 c3 5a", RUN_PDU.hex(" ")]
