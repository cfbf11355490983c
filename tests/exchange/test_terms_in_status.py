"""What the status says of thermal and cross: what each added to the last target, and who is silent."""

from typing import Any

import pytest

from gateway.compensation.settings import ThermalSettings
from gateway.exchange.axis.axis import join_terms
from gateway.exchange.control import set_temperature, switch
from gateway.exchange.status import axis_status
from tests.exchange.line_bench import ACTUAL, COMMAND, Bench, axis_plan, stream_plan, write
from tests.exchange.test_cross_terms import FLAT, TRAVEL, go_y, x_plan, y_plan
from tests.support.status_models import plain

HELD_IN_THE_MIDDLE = ThermalSettings(11.5e-6, reference=20.0, fixed_at=400.0, timeout_s=60.0, hold_s=600.0)


def terms(bench: Bench) -> Any:
    return plain(axis_status(bench.line.axes[0], bench.now_ns).terms)


def warm(bench: Bench, celsius: float) -> None:
    set_temperature(bench.line.axes, "x", celsius, bench.now_ns)


def both(**changes: Any) -> Bench:
    """x with a screw that is held at 400 mm, and 0.1 mm out of square over 1 m of y."""
    bench = Bench(x_plan(thermal=HELD_IN_THE_MIDDLE, **changes), y_plan())
    join_terms(bench.line.axes)
    return bench


def test_each_term_says_what_it_added_to_the_last_target() -> None:
    bench = both()
    warm(bench, 30.0)
    assert terms(bench)["correction"] is None  # there is no target yet
    assert terms(bench)["thermal"]["correction"] is None
    go_y(bench, 400_000)
    bench.move(900_000)
    found = terms(bench)
    assert found["thermal"]["correction"] == pytest.approx(-0.0575)  # 11.5e-6 x 10 K x 500 mm
    assert found["cross"]["correction"] == pytest.approx(0.04)
    assert found["correction"] == pytest.approx(-0.0175)
    bench.move(400_000)
    assert terms(bench)["thermal"]["correction"] == 0.0
    assert terms(bench)["cross"]["correction"] == pytest.approx(0.04)
    go_y(bench, 1_000_000)
    assert terms(bench)["correction"] == pytest.approx(0.04)  # x has got no target since
    bench.move(500_000)
    assert terms(bench)["cross"]["correction"] == pytest.approx(0.1)


def test_a_term_that_is_too_large_does_not_say_that_it_was_added() -> None:
    bench = both(max_correction=0.05)
    go_y(bench, 400_000)
    bench.move(100_000)
    go_y(bench, 900_000)
    assert bench.reach(200_000) == 200_040
    found = terms(bench)
    assert (found["is_too_large"], found["correction"]) == (True, pytest.approx(0.04))
    assert found["cross"]["correction"] == pytest.approx(0.04)


def test_while_it_gives_way_in_a_stream_it_says_what_is_left_of_it() -> None:
    screw = ThermalSettings(1e-4, reference=20.0, fixed_at=0.0)
    bench = Bench(stream_plan(table=FLAT, travel=TRAVEL, thermal=screw, max_correction=2.0))
    warm(bench, 30.0)
    bench.memory.put(ACTUAL, 100_000)
    shares = []
    for step in range(600):
        if step == 400:
            switch(bench.line.axes, "x", is_on=False)
        counts = 100_000 + 500 * step
        bench.ask(write(COMMAND, counts))
        bench.wait(10.0)
        bench.memory.put(ACTUAL, bench.memory.get(COMMAND))
        told = (bench.memory.get(COMMAND) - counts) / 1000.0  # of a flat table: the term alone
        if step > 0:
            assert terms(bench)["correction"] == pytest.approx(told, abs=0.0006)  # half a count, and rounding
            shares.append(terms(bench)["thermal"]["correction"])
    assert shares[398] == pytest.approx(-0.2995)  # 1e-4 x 10 K x 299.5 mm
    assert any(-0.2 < share < -0.1 for share in shares[399:])
    assert shares[-1] == 0.0


def test_an_axis_without_terms_has_none_in_its_status() -> None:
    assert terms(Bench(axis_plan())) is None


def test_a_sensor_is_silent_after_its_time_also_when_it_was_never_heard() -> None:
    bench = both()

    def state() -> tuple[str, bool]:
        bench.line.axes[0].correction.report_terms(bench.now_ns)  # as the line does every few seconds
        thermal = terms(bench)["thermal"]
        return thermal["state"], thermal["is_silent"]

    assert state() == ("waiting", False)
    bench.wait(60_000.0)
    assert state() == ("waiting", False)
    bench.wait(1_000.0)
    assert state() == ("waiting", True)
    warm(bench, 30.0)
    assert state() == ("following", False)
    bench.wait(61_000.0)
    assert state() == ("held", True)
    bench.wait(600_000.0)
    assert state() == ("fading", True)
    bench.wait(300_000.0)
    assert state() == ("faded", True)
    warm(bench, 30.0)
    assert state() == ("following", False)
