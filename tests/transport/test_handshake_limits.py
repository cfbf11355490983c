"""How many handshakes may begin: at once and in a second, of one host and of all."""

from pathlib import Path

import pytest

from gateway.clock import boot_ns
from gateway.transport.certificates import TlsFiles
from gateway.transport.channel import Channel
from gateway.transport.handshakes import HOSTS, MADE_ROOM, HandshakeLimits
from gateway.transport.secured import Failure, TlsServer
from gateway.transport.tls import ServerContexts
from tests.support.certificates import Shop

S = 1_000_000_000


def nothing() -> None:
    """Is never called: too few handshakes run."""
    raise AssertionError


class Slow:
    """Handshakes that their peers never end."""

    def __init__(self, limits: HandshakeLimits) -> None:
        self.limits = limits
        self.ended: list[str] = []

    def begin(self, name: str, host: str, now_ns: int) -> str:
        def give_up() -> None:
            self.ended.append(name)
            self.limits.ended(host, give_up)

        return self.limits.why_not(host, now_ns, give_up)


def begun(limits: HandshakeLimits, host: str, times: int, now_ns: int) -> int:
    """Try so many handshakes that end at once; returns how many were let begin."""
    count = 0
    for _ in range(times):
        if not limits.why_not(host, now_ns, nothing):
            limits.ended(host, nothing)
            count += 1
    return count


def test_one_host_has_ten_at_once_and_then_five_a_second() -> None:
    limits = HandshakeLimits()
    assert begun(limits, "a", 500, 0) == 10
    assert limits.why_not("a", 0, nothing) == "too many handshakes: 5 a second from one address"
    assert begun(limits, "a", 500, S) == 5
    assert begun(limits, "a", 500, 11 * S) == 10  # never more than ten
    assert sum(begun(limits, "a", 5, (12 + n) * S) for n in range(10)) == 50


def test_a_flood_of_one_host_leaves_room_for_another() -> None:
    limits = HandshakeLimits()
    begun(limits, "flood", 500, 0)
    assert begun(limits, "controller", 1, 0) == 1


def test_all_hosts_together_have_twenty_at_once_and_then_twenty_a_second() -> None:
    limits = HandshakeLimits()
    assert sum(begun(limits, f"host {n}", 2, 0) for n in range(10)) == 20
    # Who has tried nothing lately has five more.
    assert sum(begun(limits, f"other {n}", 2, 0) for n in range(20)) == 5
    assert limits.why_not("controller", 0, nothing) == "too many handshakes: 20 a second"
    assert sum(begun(limits, f"host {n}", 2, S) for n in range(20)) == 25


def test_a_controller_that_came_in_before_has_its_own_measure_whatever_others_do() -> None:
    limits = HandshakeLimits()
    limits.came_in("controller")
    assert sum(begun(limits, f"host {n}", 1, 0) for n in range(100)) == 25
    assert begun(limits, "controller", 50, 0) == 10
    assert begun(limits, "controller", 50, S) == 5
    for n in range(HOSTS):
        limits.came_in(f"{n}")  # as many as are remembered
    assert sum(begun(limits, f"host {n}", 1, 2 * S) for n in range(100)) == 25
    assert begun(limits, "controller", 1, 2 * S) == 0


def test_four_strangers_that_take_all_there_are_leave_some_for_a_controller() -> None:
    limits = HandshakeLimits()
    came = 0
    for tick in range(20 * 60):  # a minute, twenty tries of each in a second
        now_ns = tick * S // 20
        for n in range(4):
            begun(limits, f"10.0.0.{n}", 1, now_ns)
        if tick % 40 == 39:  # every two seconds
            came += begun(limits, "controller", 1, now_ns)
    assert came == 30


def test_those_that_do_not_end_are_bounded_and_keep_nobody_out() -> None:
    limits = HandshakeLimits()
    slow = Slow(limits)
    assert [slow.begin(f"slow {n}", "slow", n * S) for n in range(8)] == [""] * 8
    assert slow.begin("", "slow", 100 * S) == "too many handshakes: 8 at once from one address"
    assert all(not slow.begin(f"host {n}", f"host {n}", (100 + n) * S) for n in range(24))
    assert (limits.running, slow.ended) == (32, [])
    # The oldest of the one who has most of them makes room, until all have as many.
    for n in range(8):
        assert slow.begin(f"controller {n}", f"controller {n}", (200 + n) * S) == ""
        assert limits.running == 32
    assert slow.ended == [f"slow {n}" for n in range(8)]


def test_four_hosts_that_never_end_a_handshake_do_not_lock_a_controller_out() -> None:
    limits = HandshakeLimits()
    slow = Slow(limits)
    for second in range(60):
        for host in range(4):
            for _ in range(3):  # less than one host may, and together less than all may
                slow.begin("", f"10.0.0.{host}", second * S)
        assert begun(limits, "10.0.0.99", 1, second * S) == 1
    assert limits.running >= 24


class End(Channel):
    """The near end of a connection that says nothing."""

    def __init__(self, peer: str) -> None:
        self.peer = peer
        self.is_closed = False

    def write(self, data: bytes) -> None:
        raise AssertionError

    def has_gone(self, *, asks: bool) -> bool:
        return False

    def close(self) -> None:
        self.is_closed = True


async def test_a_connection_that_makes_room_is_closed_and_told_of(tmp_path: Path) -> None:
    shop = Shop(tmp_path)
    certificate, key = shop.server()
    contexts = ServerContexts(TlsFiles(str(certificate), str(key), str(shop.path)), print, print)
    failures: list[Failure] = []
    tls_server = TlsServer(contexts, lambda _: None, failures.append, lambda host, _: pytest.fail(host))
    now_ns = boot_ns()
    ends = [End(f"10.0.0.{n // 8}:{n}") for n in range(33)]
    for n, end in enumerate(ends):
        tls_server.connection().opened(end, now_ns + n * S)
    assert [end.is_closed for end in ends] == [True] + [False] * 32
    assert [(each.peer, each.reason) for each in failures] == [("10.0.0.0:0", MADE_ROOM)]
    assert tls_server.limits.running == 32
    tls_server.close()


def test_very_many_hosts_share_one_measure_and_do_not_fill_the_memory() -> None:
    limits = HandshakeLimits()
    slow = Slow(limits)
    for n in range(10_000):
        slow.begin("", f"fd00::{n:x}", n * S // 1000)  # a thousand a second
    assert len(limits._hosts) <= HOSTS + 1
