"""The temperature that counts: no faster than it may, held while nothing is heard, and gone after that."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.compensation.errors import TemperatureError
from gateway.compensation.settings import ThermalSettings
from gateway.compensation.thermal import TermState, Thermal

S = 1_000_000_000
SETTINGS = ThermalSettings(11.5e-6, timeout_s=60.0, hold_s=600.0, rate_per_min=2.0, largest_dt=40.0)


def thermal(**changes: float) -> Thermal:
    return Thermal(ThermalSettings(**{"alpha": 11.5e-6, "rate_per_min": 2.0, **changes}))


def test_the_first_temperature_counts_at_once_and_the_next_ones_at_two_kelvin_a_minute() -> None:
    found = thermal()
    assert found.state(5 * S) is TermState.WAITING
    assert found.follow(5 * S) == 0.0
    found.take(22.0, 10 * S)
    assert found.follow(10 * S) == 2.0
    found.take(42.0, 20 * S)  # it jumps by 20 K
    assert found.follow(20 * S) == 2.0
    assert found.follow(50 * S) == pytest.approx(3.0, abs=1e-12)
    assert found.difference_at(80 * S) == pytest.approx(4.0, abs=1e-12)


@pytest.mark.parametrize("celsius", [float("nan"), float("inf"), float("-inf"), 3000.0, 60.1, -20.1])
def test_what_is_no_temperature_of_a_screw_changes_nothing(celsius: float) -> None:
    found = thermal()
    found.take(21.0, S)
    with pytest.raises(TemperatureError, match="is no temperature within 40 K of the reference 20"):
        found.take(celsius, 2 * S)
    assert (found.celsius, found.difference_at(2 * S)) == (21.0, 1.0)
    assert found.age_s(3 * S) == 2.0  # and it is not taken for a sign of life


def test_a_silent_sensor_is_held_and_then_goes_back_to_nothing() -> None:
    found = thermal()
    found.take(24.0, 0)
    assert found.state(60 * S) is TermState.FOLLOWING
    assert found.state(61 * S) is TermState.HELD
    assert found.state(660 * S) is TermState.HELD
    assert found.difference_at(660 * S) == 4.0
    assert found.state(661 * S) is TermState.FADING
    assert found.difference_at(720 * S) == pytest.approx(2.0, abs=1e-12)
    assert found.difference_at(780 * S) == 0.0
    assert found.state(780 * S) is TermState.FADED
    found.take(24.0, 1000 * S)  # it comes back: no faster than it went
    assert found.difference_at(1000 * S) == 0.0
    assert found.difference_at(1060 * S) == pytest.approx(2.0, abs=1e-12)
    assert found.state(1000 * S) is TermState.FOLLOWING


def test_another_run_goes_on_from_what_counted_there() -> None:
    found = thermal()
    found.resume(5.0, 100 * S)
    assert found.state(100 * S) is TermState.FOLLOWING  # for timeout_s nobody is missed
    assert found.state(161 * S) is TermState.HELD
    assert found.difference_at(760 * S) == 5.0
    assert found.difference_at(790 * S) == pytest.approx(4.0, abs=1e-12)
    found.take(20.0, 130 * S)
    assert found.difference_at(160 * S) == pytest.approx(4.0, abs=1e-12)


def test_a_record_that_comes_after_the_first_temperature_is_where_that_starts_from() -> None:
    found = thermal()
    found.take(30.0, 0)
    found.resume(4.0, 10 * S)
    assert found.difference_at(40 * S) == pytest.approx(5.0, abs=1e-12)


READINGS = st.lists(st.tuples(st.floats(0.1, 900.0), st.floats(-20.0, 60.0)), min_size=1, max_size=12)


@given(READINGS, st.lists(st.floats(0.0, 5000.0), max_size=12))
def test_how_often_it_is_looked_at_makes_no_difference(
    readings: list[tuple[float, float]], looks: list[float]
) -> None:
    seldom, often = Thermal(SETTINGS), Thermal(SETTINGS)
    now_ns, rest = 0, sorted(int(look * S) for look in looks)
    for pause_s, celsius in readings:
        now_ns += int(pause_s * S)
        while rest and rest[0] < now_ns:
            often.follow(rest.pop(0))
        seldom.take(celsius, now_ns)
        often.take(celsius, now_ns)
        assert often.difference == pytest.approx(seldom.difference, abs=1e-9)


@given(READINGS)
def test_it_never_changes_faster_than_it_may(readings: list[tuple[float, float]]) -> None:
    found = Thermal(SETTINGS)
    found.take(20.0, 0)
    seen, now_ns = [(0, 0.0)], 0
    for pause_s, celsius in readings:
        for share in (0.25, 0.5, 0.75, 1.0):
            at_ns = now_ns + int(share * pause_s * S)
            seen.append((at_ns, found.follow(at_ns)))
        now_ns += int(pause_s * S)
        found.take(celsius, now_ns)
        seen.append((now_ns, found.follow(now_ns)))
    for (before_ns, before), (after_ns, after) in pairwise(seen):
        assert abs(after - before) <= 2.0 / 60.0 * (after_ns - before_ns) / S + 1e-9
