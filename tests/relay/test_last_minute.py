"""Counters of the last minute, and which requests met with damage."""

from gateway.relay.drive_link import Instead
from gateway.relay.last_minute import LastMinute
from gateway.times import NS_PER_S


def test_what_is_older_than_a_minute_does_not_count() -> None:
    total = {"whole": 0}
    minute = LastMinute(lambda: total)
    for second in range(0, 125, 5):  # one a second, sampled every five
        total["whole"] = second
        minute.tick(second * NS_PER_S)
    assert minute.grown(120 * NS_PER_S) == {"whole": 60}
    assert minute.grown(124 * NS_PER_S) == {
        "whole": 60
    }  # the sample at 60 s is the newest that is old enough


def test_before_a_minute_has_passed_everything_counts_and_new_counters_begin_at_zero() -> None:
    total = {"whole": 7}
    minute = LastMinute(lambda: total)
    minute.tick(0)
    total["damaged"] = 2
    assert minute.grown(30 * NS_PER_S) == {"whole": 7, "damaged": 2}
    minute.tick(61 * NS_PER_S)
    assert minute.grown(62 * NS_PER_S) == {"whole": 0, "damaged": 2}


def test_of_the_unanswered_in_a_row_it_is_known_which_met_with_damage() -> None:
    damage = Instead()
    for is_damaged in (True, True, False, True):
        damage.add(came=is_damaged)
    assert (damage.total, damage.among(1), damage.among(2), damage.among(3)) == (3, 1, 1, 2)
    for _ in range(100):
        damage.add(came=True)
    assert (damage.total, damage.among(100)) == (103, 32)
