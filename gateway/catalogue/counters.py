"""What is counted and shown: in the status, on the page, in the terminal and as metrics; since the start."""

from collections.abc import Mapping
from typing import Final

from gateway.catalogue.entry import CounterEntry

_LONGER: Final = (
    "raise `response_timeout_ms` until the drive answers in time; with the gateway stopped "
    "`pitch-gateway probe CONFIG --timing` then measures how much it needs"
)

LINE: Final = (
    CounterEntry("exchanges", "exchanges", "exchanges with the drives: requests that were answered"),
    CounterEntry(
        "timeouts",
        "time-outs",
        "exchanges that a drive did not answer in time",
        "look at the drive and its wires, and whether `response_timeout_ms` is long enough",
    ),
    CounterEntry(
        "exceptions",
        "exceptions",
        "exceptions that drives answered with; they pass as they are",
        "look the code up in the drive's manual, or with `pitch-gateway explain 0x02`",
    ),
    CounterEntry(
        "late",
        "late",
        "frames or bytes from the drives when nothing was expected",
        f"{_LONGER}; see that no other master talks on the line",
    ),
    CounterEntry(
        "late_replies",
        "late replies",
        "replies over Modbus/TCP that came after their request had been given up",
        _LONGER,
    ),
    CounterEntry(
        "late_targets",
        "late targets",
        "targets and triggers that had waited longer than the `deadline_ms` of their axis",
        "compare with `pitch-gateway budget CONFIG`; let monitors ask less often",
    ),
    CounterEntry(
        "refused",
        "refused",
        "requests that the gateway refused; of a controller those that it sent",
        "look at the log: `refused-value`, `request-refused` and `second-writer` say why",
    ),
    CounterEntry(
        "backed_off",
        "answered for silent drives",
        "requests that were answered with 0x0B at once because their drive had left three in a row "
        "unanswered",
        "look at the drive: power, cable, unit id; see `drive-backed-off`",
    ),
    CounterEntry(
        "too_late",
        "too late to send",
        "requests that were answered with 0x0B at once, and not sent, because their drive was silent: behind "
        "the silence after its time-out they could have left only with less than half of their controller's "
        "`timeout_ms` left; at most two in one silence, then a read is sent late",
        "look at the drive, as for `timeouts`. Where it is well but slow, a shorter `drain_ms` or a longer "
        "`timeout_ms` of the controller lets them be sent; with the gateway stopped "
        "`pitch-gateway probe CONFIG --timing` measures",
    ),
    CounterEntry(
        "withdrawn",
        "withdrawn",
        "requests that were not sent: their controller had given up on them, or a stop came after them",
        "compare with `pitch-gateway budget CONFIG`; give the controller a longer time-out",
    ),
    CounterEntry("broadcasts", "broadcasts", "requests to all drives, which none answers"),
    CounterEntry("added_reads", "added reads", "reads of the gateway's own: of positions, modes and bits"),
    CounterEntry(
        "internal_faults",
        "internal faults",
        "faults of the gateway's own program; see the event `internal-fault`",
        "send the log and the configuration to the makers of the gateway",
    ),
    CounterEntry("restaged", "restaged", "staged targets that were written anew for their trigger"),
    CounterEntry(
        "unknown_modes",
        "unknown modes",
        "frames whose meaning the register map does not know: they passed untouched",
        "look the value up in the drive's manual and list it under its meaning, or under `ignore`",
    ),
    CounterEntry(
        "unmapped_reads",
        "unmapped reads",
        "reads of positions that are not mapped: they pass as they are",
        "map the register under `actual`, `commanded` or `aliases`",
    ),
    CounterEntry(
        "damaged",
        "damaged",
        "runs of bytes, however short, of which no frame could be made; of a unit id the requests that met "
        "with them, of a controller's port what came from there",
        "check cable, screen and termination; where nothing is whole, baud rate, parity, and A and B",
    ),
    CounterEntry(
        "crc_errors",
        "CRC errors",
        "of the damaged those of four bytes and more: frames with a wrong check sum",
        "check cable, screen, termination and baud rate",
    ),
    CounterEntry(
        "dropped_bytes",
        "dropped bytes",
        "bytes that belong to no frame",
        "check cable, screen, termination and baud rate",
    ),
    CounterEntry(
        "stray_bytes",
        "stray bytes",
        "bytes from the drives over RTU while nothing was expected",
        f"{_LONGER}; see that no other master talks on the line",
    ),
    CounterEntry(
        "stray_frames",
        "stray frames",
        "whole frames among the stray bytes: a drive that answers late, or twice",
        f"{_LONGER}; see that no unit id is there twice",
    ),
    CounterEntry(
        "foreign_frames",
        "foreign frames",
        "whole frames over RTU that answer another unit id or another function than was asked",
        "see that no unit id is there twice, and that no other master talks on the line",
    ),
    CounterEntry(
        "echoes",
        "echoes",
        "own requests that an RS-485 adapter heard back; they are taken out",
    ),
    CounterEntry(
        "malformed",
        "malformed",
        "bytes over TCP that are no Modbus/TCP frame; of a controller what it sent",
        "see what runs at that address: RTU over TCP wants `rtu_over_tcp`",
    ),
    CounterEntry(
        "oversized",
        "too long replies",
        "replies over Modbus/TCP that are longer than a frame may be; their requests were answered as if "
        "none had come",
        "see what device answers at that address: no drive sends replies as long",
    ),
    CounterEntry(
        "wrong_units",
        "wrong unit ids",
        "replies over Modbus/TCP with another unit id than was asked",
        "where the one drive of the line answers so, set `answers_as`; else look at the unit ids",
    ),
    CounterEntry(
        "budget_overruns",
        "budget overruns",
        "exchanges that took the gateway longer than `budget_us`",
        "look at the load of the computer; `fifo` and `cpus` of `[relay]` put the gateway first",
    ),
)
"""By the key of a line in the status; some stand with its controllers, axes and unit ids too."""

OTHERS: Final = (
    CounterEntry(
        "timeouts_in_a_row",
        "time-outs in a row",
        "requests that a unit id has left unanswered since its last answer",
        "look at the drive: power, cable, unit id",
    ),
    CounterEntry(
        "damaged_in_a_row",
        "damaged in a row",
        "of the newest 32 requests that a unit id left unanswered in a row those that met with bytes that "
        "are no frame: it speaks, and is not understood",
        "compare baud rate and parity, then exchange A and B",
    ),
    CounterEntry(
        "other_ids_in_a_row",
        "other transaction ids in a row",
        "of the newest 32 requests that a unit id left unanswered in a row those that met with a reply of "
        "another transaction id: it answers, and no reply of it counts",
        "bring its firmware up to date, or put a converter in its place that returns the transaction id",
    ),
    CounterEntry(
        "damaged_minute",
        "damaged in the last minute",
        "requests to a unit id within the last minute that met with bytes that are no frame",
        "check cable, screen and termination",
    ),
    CounterEntry(
        "whole",
        "whole frames",
        "whole frames that came from the serial port of a controller",
    ),
    CounterEntry(
        "refused_connections",
        "connections refused",
        "connections to the listener of a controller that were closed at once",
        "look at the log: `connection-refused` says who, and which key",
    ),
    CounterEntry(
        "failed_handshakes",
        "handshakes failed",
        "TLS handshakes with the listener of a controller that failed",
        "look at the log: `handshake-failed` and `certificate-refused` say why, and of whom",
    ),
    CounterEntry(
        "opens",
        "opens",
        "times that the port or the connection was opened: more than one means that it was lost",
        "look at cable and adapter where it grows",
    ),
    CounterEntry(
        "changes",
        "changes",
        "times that two controllers took an axis from each other, in one go",
        "let only one of them move the axis",
    ),
    CounterEntry(
        "cut_through",
        "cut through",
        "of a line with `cut_through` the requests and replies that left while they arrived",
    ),
    CounterEntry(
        "stored",
        "stored",
        "of a line with `cut_through` those that were stored whole before they left, and why: `kept` for "
        "what is never cut through, or was whole too soon, else what happened before the first byte left",
        "compare with `pitch-gateway budget CONFIG`; `cut-through-off` in the log names the adapter",
    ),
    CounterEntry(
        "spoilt",
        "spoilt",
        "of a line with `cut_through` those that began to leave and were made no frame, and why",
        "where many are `stalled` or `unfit`, turn `cut_through` off for the line; where `bad`, check cables",
    ),
    CounterEntry(
        "torn",
        "torn",
        "of a line with `cut_through` the frames inside of which its transmitter was empty",
        "`fifo` and `cpus` of `[relay]` put the gateway first; else turn `cut_through` off for the line",
    ),
    CounterEntry("connects", "connects", "connections to the MQTT broker since the start"),
    CounterEntry("published", "published", "messages to the MQTT broker since the start"),
    CounterEntry(
        "dropped_events",
        "dropped events",
        "events that were not published over MQTT, because the broker was away for too long",
        "see that the broker runs and can be reached; what happened meanwhile stands in the log",
    ),
)
"""What is counted of unit ids, controllers, axes and the supervisor."""

COUNTERS: Final[Mapping[str, CounterEntry]] = {entry.name: entry for entry in (*LINE, *OTHERS)}
"""Every counter, by its key in the status."""
OF_METRIC: Final[Mapping[str, str]] = {
    "controller_frames": "whole",
    "controller_damaged_frames": "damaged",
    "drive_damaged": "damaged",
    "drive_timeouts_in_a_row": "timeouts_in_a_row",
    "axis_budget_overruns": "budget_overruns",
    **{f"line_frames_{name}": name for name in ("cut_through", "stored", "spoilt", "torn")},
    **{f"line_{entry.name}": entry.name for entry in LINE},
}
"""The key of a counter by its name in the metrics, without ``pitch_gateway_`` and ``_total``."""
ON_PAGE: Final[Mapping[str, str]] = {"exchanges/s": "exchanges", "over": "budget_overruns"}
"""The key of a counter by what stands beside it on the page, where that is neither its words nor its key."""


def counter(asked: str) -> CounterEntry | None:
    """Return the counter that is called so: by its key, its words, its metric; None: none is.

    >>> [counter(asked).name for asked in ("Time-outs", "pitch_gateway_line_timeouts_total", "timeouts")]
    ['timeouts', 'timeouts', 'timeouts']
    """
    text = asked.strip().lower()
    metric = text.removeprefix("pitch_gateway_").removesuffix("_total")
    name = OF_METRIC.get(metric) or ON_PAGE.get(text) or text
    if name in COUNTERS:
        return COUNTERS[name]
    return next((entry for entry in COUNTERS.values() if entry.words.lower() == text), None)


def meaning(name: str) -> str:
    """Return what a counter counts, as a sentence for metrics.

    >>> meaning("timeouts")
    'Exchanges that a drive did not answer in time.'
    """
    text = COUNTERS[name].meaning.replace("`", "")
    return f"{text[0].upper()}{text[1:]}."
