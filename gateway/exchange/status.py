"""The part of the status model that the exchange knows."""

from gateway.exchange.line import LineExchange


def line_status(line: LineExchange) -> dict[str, object]:
    """Return one line's part of the status model."""
    counters = line.counters
    return {
        "state": "up" if line.is_up else "down",
        "exchanges": counters.exchanges,
        "timeouts": counters.timeouts,
        "exceptions": counters.exceptions,
        "late": counters.late,
        "refused": counters.refused,
        "withdrawn": counters.withdrawn,
        "broadcasts": counters.broadcasts,
        "added_reads": counters.added_reads,
    }


def axes_status(line: LineExchange) -> dict[str, dict[str, object]]:
    """Return each axis's part of the status model, by name."""
    return {axis.plan.name: axis.status() for axis in line.axes}
