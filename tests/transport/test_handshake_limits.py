"""How many handshakes may begin: at once and in a second, of one host and of all."""

from gateway.transport.handshakes import HOSTS, HandshakeLimits

S = 1_000_000_000


def begun(limits: HandshakeLimits, host: str, times: int, now_ns: int) -> int:
    """Try so many handshakes that end at once; returns how many were let begin."""
    count = 0
    for _ in range(times):
        if not limits.why_not(host, now_ns):
            limits.ended(host)
            count += 1
    return count


def test_one_host_has_ten_at_once_and_then_five_a_second() -> None:
    limits = HandshakeLimits(0)
    assert begun(limits, "a", 500, 0) == 10
    assert limits.why_not("a", 0) == "too many handshakes: 5 a second from one address"
    assert begun(limits, "a", 500, S) == 5
    assert begun(limits, "a", 500, 11 * S) == 10  # never more than ten
    assert sum(begun(limits, "a", 5, (12 + n) * S) for n in range(10)) == 50


def test_a_flood_of_one_host_leaves_room_for_another() -> None:
    limits = HandshakeLimits(0)
    begun(limits, "flood", 500, 0)
    assert begun(limits, "controller", 1, 0) == 1


def test_all_hosts_together_have_twenty_at_once_and_then_twenty_a_second() -> None:
    limits = HandshakeLimits(0)
    assert sum(begun(limits, f"host {n}", 1, 0) for n in range(100)) == 20
    assert limits.why_not("controller", 0) == "too many handshakes: 20 a second"
    assert sum(begun(limits, f"host {n}", 1, S) for n in range(100)) == 20


def test_those_that_do_not_end_are_bounded_too() -> None:
    limits = HandshakeLimits(0)
    assert [limits.why_not("slow", n * S) for n in range(8)] == [""] * 8
    assert limits.why_not("slow", 100 * S) == "too many handshakes: 8 at once from one address"
    assert all(not limits.why_not(f"host {n}", (100 + n) * S) for n in range(24))
    assert limits.running == 32
    assert limits.why_not("controller", 200 * S) == "too many handshakes: 32 at once"
    limits.ended("slow")
    assert limits.why_not("controller", 200 * S) == ""


def test_very_many_hosts_share_one_measure_and_do_not_fill_the_memory() -> None:
    limits = HandshakeLimits(0)
    for n in range(10_000):
        limits.why_not(f"fd00::{n:x}", n * S // 1000)  # a thousand a second
    assert len(limits._hosts) <= HOSTS + 1
