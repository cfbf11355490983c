"""Traffic: what happens between controllers, axes and drives. The exchange reports it with a detail."""

from typing import Final

from gateway.catalogue.entry import EventEntry, Severity

LINE_UP: Final = EventEntry(
    "line-up",
    Severity.INFO,
    "the connection to the drives of a line is open. After a loss, reported only if the loss was",
    "a start, or the end of a `line-down`",
)
LINE_DOWN: Final = EventEntry(
    "line-down",
    Severity.WARNING,
    "the connection to the drives of a line is lost; the detail says why. Requests over TCP wait for a new "
    "one for half of their controller's `timeout_ms`, then get exception 0x0A; on RTU silence. Reported "
    "immediately if an axis was moving or the loss lasts a second",
    "an unplugged adapter, or a connection closed by the drives or their device server. *When idle*: "
    "harmless, the server closes idle connections. *After a malformed header*: faulty Modbus/TCP",
    "check cable, adapter and power of the drives. The gateway reconnects automatically",
)
CONNECTION_RENEWED: Final = EventEntry(
    "connection-renewed",
    Severity.WARNING,
    "nothing came from the drives for three time-outs. The gateway connects again, at first after 1 s, "
    "later after up to 60 s. The drives still count as silent",
    "a device server that lost the connection, or was asked too soon after accepting it; drives that are "
    "off behind a converter",
    "if it happens after each start, set `connect_delay_ms`. Otherwise check drives and converter",
)
DRIVE_SILENT: Final = EventEntry(
    "drive-silent",
    Severity.WARNING,
    "the drive missed a response after having answered before. Reported once until it answers again",
    "the drive is off or starting; a loose wire, a disturbed line, a wrong unit id, or a short "
    "`response_timeout_ms`",
    "check the drive and its wiring. `timeouts` in `status` counts how often it happens",
)
UNKNOWN_UNIT: Final = EventEntry(
    "unknown-unit",
    Severity.WARNING,
    "a controller addresses a unit id of a Modbus/TCP line that has no axis. Its requests pass, except "
    "writes that a drive ignoring unit ids would execute (0x0A). Reported once",
    "see the trouble `unknown-unit`",
    "do what the trouble `unknown-unit` says",
)
DRIVE_BACKED_OFF: Final = EventEntry(
    "drive-backed-off",
    Severity.WARNING,
    "a drive left three requests in a row unanswered. Requests for it or its group get exception 0x0B "
    "without waiting, except occasional trials. Other drives are not delayed",
    "as for `drive-silent`",
    "check the drive and its wiring. Any frame from it ends this. `retry_ms` sets the interval of the trials",
)
CUT_THROUGH_OFF: Final = EventEntry(
    "cut-through-off",
    Severity.INFO,
    "a line with `cut_through` stores requests or replies of a controller, because forwarding would save "
    "no character. Reported once for each; measured again later",
    "an adapter that delivers bursts (a latency timer of 16 ms, a FIFO), a slow side before a fast one, "
    "or a busy computer",
    "run `pitch-gateway budget CONFIG`. If no frame gains, remove `cut_through`. Otherwise let the "
    "gateway set the latency timer (`low_latency`, see [latency "
    "settings](operations.md#what-a-serial-port-adds-latency-settings)) or set `fifo`. Then restart the "
    "gateway",
)
DRIVE_ANSWERS: Final = EventEntry(
    "drive-answers",
    Severity.INFO,
    "a drive that was silent answers again",
    "the end of a `drive-silent`",
)
AXIS_REFERENCED: Final = EventEntry(
    "axis-referenced",
    Severity.INFO,
    "the position of the axis is known: it is corrected from its next target on",
    "homing, the homed bit, a position that was set, or `pitch-gateway reference`",
)
REFERENCE_LOST: Final = EventEntry(
    "reference-lost",
    Severity.WARNING,
    "the position of the axis is no longer known: positions pass 1:1 in both directions",
    "the homed bit fell, an alarm, a drive silent for `lost_ms`, homing, or another position at "
    "standstill; the detail says which",
    "home the axis. If its drive cannot report that, run `pitch-gateway reference CONFIG AXIS`",
)
DIRECTION_UNSURE: Final = EventEntry(
    "direction-unsure",
    Severity.WARNING,
    "the branch of the table is assumed, because the position of the axis is not known well enough",
    "the axis moved when a new target came, or its actual position is unreadable",
    "map `actual` and `bits.done` of the drive, set `max_speed`, and leave `safe_read` on",
)
BRANCH_HUNTS: Final = EventEntry(
    "branch-hunts",
    Severity.WARNING,
    "the branch of the table changed more than five times in ten seconds",
    "short reversals, or a controller that repeats a target with jitter",
    "if the axis is at standstill, set `repeat_within` to the jitter in counts",
)
COMPENSATION_ENDED: Final = EventEntry(
    "compensation-ended",
    Severity.WARNING,
    "the axis is no longer corrected until the gateway is restarted",
    "a register listed under `remap` was written: it moves other registers or swaps their words",
    "check that the drive's registers match the configuration, then restart the gateway",
)
REFUSED_VALUE: Final = EventEntry(
    "refused-value",
    Severity.WARNING,
    "the gateway answered a request with an exception; it did not reach the drive",
    "a position beyond `travel`, register or table, an incomplete position, or a write that bypasses the "
    "correction; the detail says which",
    "run `pitch-gateway explain` with the sentence of `detail` in quotes",
)
AXIS_BLOCKED: Final = EventEntry(
    "axis-blocked",
    Severity.WARNING,
    "a target was lost before it reached the drive. Triggers of the axis are refused until the drive "
    "accepts a complete target; stops pass. While the positions of the axis pass 1:1, its triggers pass too",
    "see the trouble `blocked`",
    "do what the trouble `blocked` says",
)
AXIS_RELEASED: Final = EventEntry(
    "axis-released",
    Severity.WARNING,
    "the drive has accepted a complete target: triggers of the axis pass again",
    "the end of an `axis-blocked`",
)
GROUP_HELD: Final = EventEntry(
    "group-held",
    Severity.WARNING,
    "an axis of a group moves corrected or 1:1, as the first axis did, although a switch, table, gain or "
    "reference has changed. The change applies when all have moved",
    "see the trouble `group-held`",
    "switch only at standstill. If a reference was lost, home the axes before the next move",
)
GROUP_SKEWED: Final = EventEntry(
    "group-skewed",
    Severity.ERROR,
    "one axis of a group has moved, or may have, and the target of another was refused. The detail gives "
    "the skew of the beam. The gateway does not stop the axes",
    "see the trouble `group-skewed`",
    "do what the trouble `group-skewed` says",
)
RESTAGED: Final = EventEntry(
    "restaged",
    Severity.WARNING,
    "a staged target was rewritten before its trigger, with the current correction",
    "the axis was elsewhere at the trigger than at the write, or the table changed",
)
UNKNOWN_MODE: Final = EventEntry(
    "unknown-mode",
    Severity.WARNING,
    "a frame has a meaning that the register map does not list: it passed unchanged",
    "a mode or trigger value that is not listed",
    "look the value up in the drive's manual, and list it under its meaning or under `ignore`",
)
STORED_MOVE: Final = EventEntry(
    "stored-move",
    Severity.WARNING,
    "the start of a position not written through the gateway was refused with exception 4",
    "the controller runs a position stored in the drive, or written before the gateway started",
    'have the controller write the target, or set `stored_moves = "uncorrected"`',
)
BASE_UNKNOWN: Final = EventEntry(
    "base-unknown",
    Severity.WARNING,
    "a relative move came while its start was unknown: refused with exception 6, or passed with "
    '`relative_unknown = "pass"`',
    "a stop, jog, homing, alarm or lost connection before it, and no register that shows the position at "
    "standstill",
    "map `commanded` or `actual` with `bits.done` or `bits.moving`, or have the controller begin with an "
    "absolute move",
)
STREAM_BEGAN: Final = EventEntry(
    "stream-began",
    Severity.INFO,
    "the drive's offset from the first setpoint of a stream stays in force until the table has taken over",
    "a start without a record, homing, or a position that was set",
    "read `detail`: what cannot be a correction was dropped with the first setpoint",
)
RESTORED: Final = EventEntry(
    "restored",
    Severity.INFO,
    "the axis continues from the position in its record of the previous run",
    "the gateway started while the drive was at standstill",
)
RECORD_NOT_USED: Final = EventEntry(
    "record-not-used",
    Severity.WARNING,
    "the record of the previous run is not used, or none can be kept",
    "the axis has moved, table or scale has changed, it is not referenced, or the file is unusable; the "
    "detail says which",
    "see [what a restart knows](operations.md#what-a-restart-knows). Most reasons end with the first target",
)
WITHDRAWN: Final = EventEntry(
    "withdrawn",
    Severity.WARNING,
    "a request was not sent: its controller had given up, or a stop of its axis followed. Reported at "
    "most once a second",
    "a line too slow for its controllers, a closed connection, or a stop",
    "compare with `pitch-gateway budget CONFIG`. Give the controller a longer time-out or a slower cycle",
)
STOOD_STILL: Final = EventEntry(
    "stood-still",
    Severity.WARNING,
    "the relay did not run for a while. Requests that controllers gave up meanwhile were not sent, "
    "except stops",
    "a stopped or starved process, or a suspended computer",
    "check what else uses the processor, and leave real-time scheduling on",
)
LATE_TARGET: Final = EventEntry(
    "late-target",
    Severity.WARNING,
    "a target or trigger waited longer than `deadline_ms`. It was sent, or refused with exception 6",
    "other requests occupied the line, or a drive was silent",
    "compare with `pitch-gateway budget CONFIG`. Let monitors poll less often",
)
BUDGET_OVERRUN: Final = EventEntry(
    "budget-overrun",
    Severity.WARNING,
    "one exchange took longer than `budget_us` in the gateway, after many that did not. The detail names "
    "the slowest step",
    "the computer is busy with something else",
    "check the load of the computer. `fifo` and `cpus` of `[relay]` give the gateway priority",
)
BUDGET_KEPT: Final = EventEntry(
    "budget-kept",
    Severity.INFO,
    "`budget_us` is kept again",
    "the end of a `budget-overrun`",
)
LATE_REPLY: Final = EventEntry(
    "late-reply",
    Severity.WARNING,
    "a frame of a drive was dropped: it answers no request, or came later than the `timeout_ms` of an RTU "
    "controller",
    "the drive answers after `response_timeout_ms` or twice, another master is on the line, or the "
    "controller waits longer than `timeout_ms` says",
    "raise `response_timeout_ms`, and `timeout_ms` to the time that the controller waits; with the gateway "
    "stopped, `pitch-gateway probe CONFIG --timing` measures what the drive needs. Check "
    "that no other master uses the line",
)
REQUEST_REFUSED: Final = EventEntry(
    "request-refused",
    Severity.WARNING,
    "a controller asked for something that its role or rights forbid, too often, or faster than the line "
    "answers",
    "a controller with another task than configured, one that ignores replies, a scanner, or an attack",
    "check `peer`, `function_code` and `unit_id`. If the request is legitimate, change the key in the "
    "detail and restart the gateway",
)
SECOND_WRITER: Final = EventEntry(
    "second-writer",
    Severity.WARNING,
    "a controller tried to move an axis that another one is moving; it got exception 6",
    "a panel that jogs while the program runs, two programs at once, or an attack. Or the first "
    "controller triggers in every cycle and so never releases the axis",
    "let one finish: in `status`, `writer` of the axis (on a terminal `moved by`) names it. Trigger only on "
    'changes. If both must move the axis, set `writers = "any"`',
)
INTERNAL_FAULT: Final = EventEntry(
    "internal-fault",
    Severity.ERROR,
    "a fault in the gateway's program: an axis or request met an event impossible in its state. The "
    "position now counts as unknown, the homed bit is read again, and triggers are refused until a "
    "complete target. Stops pass; the rest of the request is dropped",
    "a bug in the gateway; the detail names state and event",
    "write the target again; home the axis if it is not referenced. Send log and configuration to the "
    "makers of the gateway",
)
TERM_FOLLOWS: Final = EventEntry(
    "term-follows",
    Severity.INFO,
    "the `thermal` or `cross` correction of an axis follows its source",
    "the first value, or the end of a `term-held` or `term-fades`; `term` says which correction",
)
TERM_HELD: Final = EventEntry(
    "term-held",
    Severity.WARNING,
    "the source of a `thermal` or `cross` correction gives no new value: the last one is held",
    "thermal: no temperature for `timeout_s`. Cross: see the trouble `other-axis-unknown`",
    "thermal: check the sensor, the broker or its address. Cross: do what the trouble "
    "`other-axis-unknown` says",
)
TERM_FADES: Final = EventEntry(
    "term-fades",
    Severity.WARNING,
    "the `thermal` or `cross` correction of an axis returns to 0 with its next targets",
    "a `term-held` that lasted longer than `hold_s` of `thermal` or `fresh_s` of `cross`",
    "as for `term-held`. Until then the axis is corrected by its table alone",
)
TERM_TOO_LARGE: Final = EventEntry(
    "term-too-large",
    Severity.WARNING,
    "table, `thermal` and `cross` together exceed `max_correction`. `thermal` and `cross` keep their "
    "values; with a new table they are left out",
    "see the trouble `term-too-large`",
    "do what the trouble `term-too-large` says",
)
