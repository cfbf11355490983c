"""The places of a listener: who makes room for whom, and what is closed by itself."""

from dataclasses import dataclass, field

import pytest

from gateway.times import NS_PER_S
from gateway.transport.connections import Closing, Connections
from gateway.transport.limits import HOSTS, ConnectionLimits, ConnectRate

START_NS = 1_000 * NS_PER_S


@dataclass
class Seen:
    """What is known of a connection."""

    asked_ns: int = 0
    unfinished_ns: int = 0
    is_served: bool = False


@dataclass(eq=False)
class Connection:
    """A connection that notes that it was closed."""

    host: str
    opened_ns: int = START_NS
    asking: Seen | None = field(default_factory=Seen)
    is_closed: bool = False

    def abort(self) -> None:
        self.is_closed = True


class Door:
    """A listener of four places at a time of the test's own."""

    def __init__(self, **limits: float) -> None:
        self.closed: list[tuple[str, Closing]] = []
        self.connections = Connections(
            ConnectionLimits(max_connections=4, **limits),
            patience_ns=3 * NS_PER_S,
            on_closed=lambda host, why: self.closed.append((host, why)),
        )
        self.now_ns = START_NS

    def comes(self, host: str, *, asked_s: float | None = None) -> Connection | None:
        """Let somebody connect, who asked for something so many seconds after the start; None: refused."""
        connection = Connection(host, self.now_ns)
        if not self.connections.has_room_for(host, self.now_ns):
            return None
        self.connections.take(connection, self.now_ns)
        if asked_s is not None:
            assert connection.asking is not None
            connection.asking.asked_ns = START_NS + int(asked_s * NS_PER_S)
        return connection

    def wait(self, seconds: float) -> None:
        self.now_ns += int(seconds * NS_PER_S)

    def is_closed(self, *connections: Connection | None) -> list[bool]:
        return [connection is not None and connection.is_closed for connection in connections]


def test_a_host_that_holds_all_places_and_asks_for_nothing_makes_room_at_once() -> None:
    door = Door()
    idle = [door.comes("10.0.0.9") for _ in range(4)]
    assert door.comes("10.0.0.1") is not None
    assert door.is_closed(*idle) == [True, False, False, False]
    assert door.closed == [("10.0.0.9", Closing.MADE_ROOM)]


def test_the_one_connection_of_a_controller_stays_however_long_it_is_quiet() -> None:
    door = Door()
    cnc = door.comes("10.0.0.1", asked_s=0)
    flood = [door.comes("10.0.0.9") for _ in range(3)]
    door.wait(3_600)
    more = [door.comes("10.0.0.9") for _ in range(50)]
    assert door.is_closed(cnc) == [False]
    assert door.is_closed(*flood) == [True, True, True]
    # Each of these made room for itself only after five seconds: one round of three, then nobody may.
    assert [each is not None for each in more] == [True] * 3 + [False] * 47


def test_those_that_never_asked_go_before_those_that_did() -> None:
    door = Door()
    asked = door.comes("10.0.0.1", asked_s=0)
    silent = [door.comes("10.0.0.1") for _ in range(3)]
    door.wait(40)
    assert door.comes("10.0.0.1") is not None
    assert door.is_closed(asked, *silent) == [False, True, False, False]


@pytest.mark.parametrize(
    ("hosts", "asked_s", "newcomer", "quiet_s"),
    [
        ("1111", 0, "1", 30),  # among its own a connection makes room only after a while,
        ("1111", None, "1", 5),  # which is shorter where it never asked
        ("8899", 100, "1", 101),  # who spoke within the last second makes room for nobody
        ("1234", 0, "5", 30),  # a host with one more than the newcomer has to be quiet for long
    ],
)
def test_how_long_a_connection_is_quiet_before_it_makes_room(
    hosts: str, asked_s: float | None, newcomer: str, quiet_s: int
) -> None:
    door = Door()
    for host in hosts:
        door.comes(f"10.0.0.{host}", asked_s=asked_s)
    door.wait(quiet_s - 0.1)
    assert door.comes(f"10.0.0.{newcomer}") is None
    door.wait(0.1)
    assert door.comes(f"10.0.0.{newcomer}") is not None


def test_a_host_with_more_than_half_of_the_places_makes_room_however_busy_it_is() -> None:
    door = Door()
    busy = [door.comes("10.0.0.9", asked_s=seconds) for seconds in (100.0, 99.0, 98.0)]
    other = door.comes("10.0.0.8", asked_s=0)
    door.wait(100)
    assert door.comes("10.0.0.9") is None
    assert door.comes("10.0.0.1") is not None
    assert door.is_closed(*busy, other) == [False, False, True, False]


def test_a_place_that_was_left_is_free() -> None:
    door = Door()
    first, *_ = [door.comes(f"10.0.0.{number}", asked_s=0) for number in (3, 4, 5, 6)]
    assert door.comes("10.0.0.2") is None
    assert first is not None
    door.connections.leave(first)
    door.connections.leave(first)
    assert door.comes("10.0.0.2") is not None


def test_a_request_that_is_never_whole_ends_its_connection() -> None:
    door = Door()
    slow, good = door.comes("10.0.0.9"), door.comes("10.0.0.1", asked_s=0)
    assert slow is not None
    assert slow.asking is not None
    slow.asking.unfinished_ns = START_NS
    door.wait(3)
    door.connections.sweep(door.now_ns)
    assert door.closed == []
    door.now_ns += 1
    door.connections.sweep(door.now_ns)
    assert door.is_closed(slow, good) == [True, False]
    assert door.closed == [("10.0.0.9", Closing.HALF_FRAME)]


def test_a_connection_that_asks_for_nothing_ends_only_where_that_is_wanted() -> None:
    door, patient = Door(idle_timeout_s=60.0), Door()
    for each in (door, patient):
        each.comes("10.0.0.1", asked_s=10)
        each.comes("10.0.0.2")
        each.wait(60.5)
        each.connections.sweep(each.now_ns)
        each.wait(10)
        each.connections.sweep(each.now_ns)
    assert door.closed == [("10.0.0.2", Closing.IDLE), ("10.0.0.1", Closing.IDLE)]
    assert patient.closed == []
    assert door.connections.is_empty
    assert not patient.connections.is_empty


def test_of_what_nothing_is_known_nothing_is_closed() -> None:
    door = Door(idle_timeout_s=1.0)
    for _ in range(4):
        door.connections.take(Connection("10.0.0.1", START_NS, None), START_NS)
    door.wait(3_600)
    door.connections.sweep(door.now_ns)
    assert door.comes("10.0.0.2") is None
    assert door.closed == []


def test_each_host_has_a_rate_of_its_own() -> None:
    rate = ConnectRate(ConnectionLimits(max_connections=3, connects_per_s=2.0))
    now_ns = START_NS
    assert [rate.takes("10.0.0.9", now_ns) for _ in range(5)] == [True] * 3 + [False] * 2
    assert rate.takes("10.0.0.1", now_ns)
    assert not rate.takes("10.0.0.9", now_ns + NS_PER_S // 2 - 1)
    assert rate.takes("10.0.0.9", now_ns + NS_PER_S // 2)
    assert not rate.takes("10.0.0.9", now_ns + NS_PER_S // 2)


def test_a_host_that_connects_for_each_request_and_gets_its_answer_is_no_flood() -> None:
    rate = ConnectRate(ConnectionLimits(max_connections=3, connects_per_s=2.0))
    now_ns = START_NS
    for _ in range(500):  # one each 4 ms
        assert rate.takes("10.0.0.9", now_ns)
        now_ns += NS_PER_S // 250
        rate.give_back("10.0.0.9", now_ns)
    assert [rate.takes("10.0.0.9", now_ns) for _ in range(5)] == [True] * 3 + [False] * 2


def test_more_answers_than_a_line_carries_are_a_flood_all_the_same() -> None:
    rate = ConnectRate(ConnectionLimits(max_connections=3, connects_per_s=2.0))
    taken = 0
    for number in range(10_000):  # within a second
        now_ns = START_NS + number * (NS_PER_S // 10_000)
        if rate.takes("10.0.0.9", now_ns):
            taken += 1
            rate.give_back("10.0.0.9", now_ns)
    # 1000 a second that are given back, and of the others three at once and two a second.
    assert 1000 <= taken <= 2510


def test_very_many_hosts_share_a_bucket_and_are_forgotten_when_theirs_is_full() -> None:
    rate = ConnectRate(ConnectionLimits(max_connections=2, connects_per_s=1.0))
    for number in range(HOSTS):
        assert rate.takes(f"fd00::{number:x}", START_NS)
    assert [rate.takes(f"fd01::{n}", START_NS) for n in range(4)] == [True, True, False, False]
    assert rate.takes("fd02::1", START_NS + 2 * NS_PER_S)
    assert rate.takes("fd02::1", START_NS + 2 * NS_PER_S)
    assert not rate.takes("fd02::1", START_NS + 2 * NS_PER_S)
