"""A loss that was noted while an older write was on the wire is not healed by its acknowledgement (M3)."""

from gateway.exchange.axis.registers import FieldImage, Loss
from gateway.exchange.plan import ControllerPlan, LineTiming
from tests.exchange.line_bench import COMMAND, MS, Port, write
from tests.exchange.staged_bench import MODE, RUN_PDU, STOP_PDU, StagedBench, staged_plan, sticky

REFUSED = bytes.fromhex("86 06")


def test_m3_a_target_that_a_stop_withdrew_is_not_replaced_by_the_one_on_the_wire() -> None:
    bench = StagedBench(serial=False)
    bench.go_to(50_000)
    bench.send(write(COMMAND, 20_000), transaction_id=1)
    bench.send(write(COMMAND, 30_000), transaction_id=2)
    bench.send(STOP_PDU, Port(ControllerPlan("panel")))
    bench.serve()
    assert [pdu.hex() for _, _, pdu in bench.port.replies] == ["9006", "1006060002"]
    bench.port.replies.clear()
    assert bench.ask(RUN_PDU) == REFUSED
    assert bench.go_to(30_000) == ("absolute", 29_990)


def test_m3_a_half_that_was_withdrawn_is_not_joined_with_what_was_on_the_wire() -> None:
    bench = StagedBench()
    bench.go_to(50_000)
    bench.send(bytes.fromhex("06 0606 1111"))  # on the wire: 0x0000_1111
    bench.send(bytes.fromhex("06 0607 0001"))  # waits
    bench.send(bytes.fromhex("03 0800 0001"))  # the controller went on: the part is withdrawn
    bench.serve()
    bench.port.replies.clear()
    bench.wait(500)
    assert bench.ask(bytes.fromhex("06 0606 2222")) == bytes.fromhex("06 0606 2222")
    assert bench.ask(RUN_PDU)[0] == 0x86
    assert bench.ask(bytes.fromhex("06 0607 0001")) == bytes.fromhex("06 0607 0001")
    assert bench.trigger() == ("absolute", 74_284)  # 0x0001_2222 = 74 274, forward


def test_m3_a_mode_that_was_withdrawn_is_not_replaced_by_the_one_on_the_wire() -> None:
    bench = StagedBench(staged_plan(motion=sticky()))
    bench.memory.words[MODE] = 1
    bench.go_to(50_000)
    bench.stage(1_000)
    bench.send(bytes.fromhex("06 0700 0001"))
    bench.send(bytes.fromhex("06 0700 0002"))
    bench.send(bytes.fromhex("03 0800 0001"))
    bench.serve()
    bench.port.replies.clear()
    assert bench.ask(RUN_PDU)[0] == 0x86
    assert bench.ask(bytes.fromhex("06 0700 0002"))[0] == 6
    assert bench.trigger() == ("relative", 51_010)


def test_m3_a_part_whose_loss_shows_later_than_that_of_a_newer_one_counts_for_nothing() -> None:
    image = FieldImage(COMMAND)
    image.settle(bytes(4), bytes(4))
    later, sooner = 100 * MS, 90 * MS
    lose(image, b"\x00\x02", later)  # was withdrawn at once
    lose(image, b"\x00\x01", sooner)  # that this one was not sent is known only now
    for follows_ns in (later, sooner):
        assert image.completed(0, b"\x12\x34", 150 * MS, follows_ns) is None


def lose(image: FieldImage, high: bytes, arrived_ns: int) -> None:
    image.lose(Loss.WITHDRAWN, 1, high, arrived_ns=arrived_ns, follows_ns=0, now_ns=arrived_ns)


def test_m1_a_half_that_was_lost_and_given_again_may_wait_for_the_other() -> None:
    image = FieldImage(COMMAND)
    lose(image, b"\x00\x01", 100 * MS)
    image.buffer(1, b"\x00\x01", 250 * MS, 100 * MS)
    assert image.completed(0, b"\x12\x34", 900 * MS, 700 * MS) == bytes.fromhex("1234 0001")


def test_m3_halves_that_came_at_one_instant_are_lost_in_their_order() -> None:
    bench = StagedBench(tcp_drive=True, timing=LineTiming(response_timeout_ms=100))
    port = Port(ControllerPlan("cnc", timeout_ms=100))
    bench.go_to(50_000)
    bench.send(bytes.fromhex("06 0606 1111"), port, transaction_id=1)  # on the wire: 0x0000_1111
    bench.send(bytes.fromhex("10 0605 0002 04 0000 2222"), port, transaction_id=2)
    bench.send(bytes.fromhex("06 0607 0001"), port, transaction_id=3)
    bench.send(STOP_PDU, Port(ControllerPlan("panel")))  # refuses both that wait
    bench.link.sent.clear()
    bench.wait(100)  # and nobody answers the first
    bench.serve()
    bench.ask(bytes.fromhex("06 0607 0001"))
    assert bench.refused(RUN_PDU) == 6  # the newest low half is 2222, and it was lost
    assert bench.ask(bytes.fromhex("06 0606 2222")) == bytes.fromhex("06 0606 2222")
    assert bench.trigger() == ("absolute", 74_284)  # 0x0001_2222 = 74 274, forward
