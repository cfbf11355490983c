"""The status of unit ids that do not answer, of the controllers of each unit id, and of rivals."""

from typing import Any

from gateway.exchange.plan import ControllerPlan, Role
from gateway.exchange.status import axes_status
from gateway.status.line import UnitStatus
from tests.exchange.line_bench import COMMAND, MS, Bench, Port, axis_plan, write
from tests.support.status_models import plain

OTHER = bytes.fromhex("03 1000 0001")
TIME_OUT_MS = 1000.0


def drives(bench: Bench) -> dict[str, UnitStatus]:
    return bench.line.unit_ids_status(bench.now_ns).drives


def rivals(bench: Bench) -> Any:
    return plain(axes_status(bench.line, bench.now_ns)["x"].rivals)


def controller(name: str) -> Port:
    port = Port(ControllerPlan(name, Role.MOTION))
    port.writer = name
    return port


def test_a_unit_id_without_a_request_is_neither_silent_nor_answering() -> None:
    bench = Bench(axis_plan(actual=()), serial=False, tcp_drive=True)
    assert drives(bench) == {
        "1": UnitStatus(answered_s=None, silent_s=None, timeouts_in_a_row=0, tried_again_s=None)
    }


def test_silence_lasts_from_the_first_request_without_an_answer_to_the_next_answer() -> None:
    bench = Bench(axis_plan(actual=()), serial=False, tcp_drive=True)
    bench.ask(OTHER)
    bench.wait(5_000)
    assert drives(bench)["1"] == UnitStatus(
        answered_s=5.0, silent_s=None, timeouts_in_a_row=0, tried_again_s=None
    )
    for _ in range(3):
        bench.missed(OTHER, TIME_OUT_MS)
    bench.wait(500)
    # 5 s without a request, three time-outs of 1 s, half a second more.
    assert drives(bench)["1"] == UnitStatus(
        answered_s=8.5, silent_s=3.5, timeouts_in_a_row=3, tried_again_s=0.5
    )  # a second after the third
    bench.wait(500)
    bench.port.replies.clear()
    bench.ask(OTHER)
    assert drives(bench)["1"] == UnitStatus(
        answered_s=0.0, silent_s=None, timeouts_in_a_row=0, tried_again_s=None
    )


def test_an_exception_is_an_answer() -> None:
    bench = Bench(axis_plan(actual=()), serial=False, tcp_drive=True)
    bench.ask(bytes.fromhex("65 00"))
    assert drives(bench)["1"].answered_s == 0.0


def test_the_status_names_who_talks_to_a_unit_id_also_if_no_drive_answers() -> None:
    bench = Bench(axis_plan(actual=()), serial=False, tcp_drive=True)
    bench.send(OTHER, controller("panel"), unit_id=17)
    bench.link.take()
    bench.wait(TIME_OUT_MS)
    assert bench.line.unit_ids_status(bench.now_ns).asked_by == {"panel": [17]}


def test_writers_that_are_refused_are_rivals_for_a_minute_after_their_last_try() -> None:
    bench = Bench(axis_plan(), serial=False)
    one, other = controller("one"), controller("other")
    bench.send(write(COMMAND, 1000), one)
    bench.serve()
    for _ in range(3):
        bench.send(write(COMMAND, 2000), other)
        bench.wait(1000)
    assert rivals(bench) == {"writers": ["one", "other"], "since_s": 3.0, "refused": 3, "changes": 0}
    bench.wait(59_000)
    assert rivals(bench)["refused"] == 3
    bench.wait(1)
    assert rivals(bench) is None


def test_writers_that_take_an_axis_from_each_other_are_rivals() -> None:
    bench = Bench(axis_plan(has_one_writer=False), serial=False)
    for number in range(4):
        bench.send(write(COMMAND, 1000 + number), controller("one" if number % 2 else "other"))
        bench.serve()
    found = rivals(bench)
    assert (found["refused"], found["changes"]) == (0, 3)  # the first of four took it from nobody


def test_one_writer_has_no_rival() -> None:
    bench = Bench(axis_plan(), serial=False)
    bench.move(1000)
    bench.now_ns += MS
    assert rivals(bench) is None
