"""Connections that are not let in: told of with their reason, but never one by one."""

from gateway.relay.refusals import HOSTS, Refusals
from gateway.times import NS_PER_S
from gateway.transport.tcp import Refusal


class Notes:
    """What was noted, and a clock that stands until it is moved."""

    def __init__(self) -> None:
        self.now_ns = 1000 * NS_PER_S
        self.details: list[str] = []
        self.refusals = Refusals(
            lambda event, detail: self.details.append(f"{event.name} {detail}"), self.clock_ns
        )

    def clock_ns(self) -> int:
        return self.now_ns


def test_a_flood_from_one_host_is_one_note_a_minute_with_its_count() -> None:
    notes = Notes()
    for _ in range(1000):
        notes.refusals.add("10.0.0.1", Refusal.TOO_MANY)
    notes.now_ns += 60 * NS_PER_S - 1
    notes.refusals.add("10.0.0.1", Refusal.TOO_MANY)
    notes.now_ns += 1
    notes.refusals.add("10.0.0.1", Refusal.TOO_MANY)
    # The first was noted at once; then 999 + 1 + 1.
    sentence = "connection-refused 10.0.0.1: too many connections at once (max_connections)"
    assert notes.details == [sentence, f"{sentence}, 1001 times since the last note"]


def test_each_host_and_each_reason_is_noted() -> None:
    notes = Notes()
    notes.refusals.add("10.0.0.1", Refusal.TOO_MANY)
    notes.refusals.add("10.0.0.1", Refusal.NOT_ALLOWED)
    notes.refusals.add("10.0.0.2", Refusal.NOT_ALLOWED)
    assert notes.details[1:] == [
        "connection-refused 10.0.0.1: not in `allow`",
        "connection-refused 10.0.0.2: not in `allow`",
    ]


def test_very_many_hosts_are_noted_together() -> None:
    notes = Notes()
    for number in range(5000):
        notes.refusals.add(f"fd00::{number:x}", Refusal.NOT_ALLOWED)
    assert len(notes.details) == HOSTS + 1
    assert notes.details[-1] == "connection-refused further hosts: not in `allow`"
