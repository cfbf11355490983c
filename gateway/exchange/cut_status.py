"""What the status says of cut-through on a line."""

from collections.abc import Mapping
from typing import Any

from gateway.exchange.cut_through.forward import CutLine
from gateway.exchange.cut_through.frame import CutEvent
from gateway.times import NS_PER_US


def cut_status(cuts: CutLine) -> dict[str, Any]:
    """Return what became of requests and replies since the start: cut through, stored or spoilt, and why."""
    return {
        "requests": _frames(cuts.requests, cuts.requests_stored, cuts.requests_gain_ns),
        "replies": _frames(cuts.replies, cuts.replies_stored, cuts.replies_gain_ns),
        "torn": cuts.torn,
    }


def _frames(ended: Mapping[CutEvent, int], stored: Mapping[CutEvent, int], gain_ns: int) -> dict[str, Any]:
    whole = ended[CutEvent.COMMITTED]
    return {
        "cut_through": whole,
        "gain_us": round(gain_ns / whole / NS_PER_US) if whole else None,
        "stored": {event.value: number for event, number in stored.items() if number},
        "spoilt": {
            event.value: number - stored[event]
            for event, number in ended.items()
            if event is not CutEvent.COMMITTED and number > stored[event]
        },
    }
