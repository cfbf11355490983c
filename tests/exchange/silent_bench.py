"""A line with a unit id that does not answer, and a controller that polls it in turn with another one."""

from typing import Any, Final

from gateway.exchange.plan import AxisPlan, ControllerPlan, LineTiming
from tests.exchange.line_bench import Bench, Port, axis_plan

OTHER: Final = bytes.fromhex("03 0700 0001")
ANSWER: Final = bytes.fromhex("03 02 0005")
SILENT: Final = bytes.fromhex("83 0B")


def line(*plans: Any, tcp_drive: bool = False, serial: bool = False, **timing: float) -> Bench:
    """Time-outs of 100 ms, silences of 50 ms; the first trial after 200 ms."""
    times: dict[str, Any] = {"response_timeout_ms": 100.0, "drain_ms": 50.0, "retry_ms": 200.0, **timing}
    bench = Bench(*plans, timing=LineTiming(**times), serial=serial, tcp_drive=tcp_drive)
    bench.port = controller("plc", serial=serial)
    return bench


def controller(name: str, *, serial: bool = False, timeout_ms: float = 100.0) -> Port:
    return Port(ControllerPlan(name, timeout_ms=timeout_ms, serial=serial))


def polled_in_turn(bench: Bench, seconds: float, takes_ms: int = 1) -> list[tuple[bool, int, float | None]]:
    """Let one controller read unit 1, which answers after ``takes_ms``, and unit 2, which is dead, in turn.

    The controller waits for each answer for its time-out at most, then sends the next request. Return for
    each request: whether unit 2 was already dead, the unit id, and the time until the answer in ms (None: no
    answer came).
    """
    asked: list[tuple[bool, int, float | None]] = []
    patience_ms, until_ns, unit_id = bench.port.plan.timeout_ms, bench.now_ns + seconds * 1e9, 1
    while bench.now_ns < until_ns:
        is_third, number, took_ms = "drive-backed-off" in bench.kinds()[:5], len(asked), 0.0
        bench.port.replies.clear()
        bench.send(OTHER, unit_id=unit_id, transaction_id=number)
        left_ms = 0
        while (is_open := number not in [n for n, _, _ in bench.port.replies]) and took_ms < patience_ms:
            if (1, OTHER) in bench.link.sent:
                left_ms = takes_ms
            bench.link.sent.clear()
            bench.wait(1)
            took_ms += 1
            left_ms -= 1
            if left_ms == 0:
                bench.line.reply(1, ANSWER, bench.now_ns)
        asked.append((is_third, unit_id, None if is_open else took_ms))
        unit_id = 3 - unit_id
    return asked


def two_axes(**changes: Any) -> tuple[AxisPlan, AxisPlan]:
    """Two axes, each on a unit id of its own."""
    return axis_plan(name="x", unit_id=1, **changes), axis_plan(name="y", unit_id=2, **changes)
