"""Traffic: what happens between controllers, axes and drives. The exchange tells of it with a detail."""

from typing import Final

from gateway.catalogue.entry import EventEntry, Severity

LINE_UP: Final = EventEntry(
    "line-up",
    Severity.INFO,
    "the way to the drives of a line is open: requests pass; told where its end was told",
    "the start, or the end of a `line-down`",
)
LINE_DOWN: Final = EventEntry(
    "line-down",
    Severity.WARNING,
    "the way to the drives of a line is lost: over TCP requests wait for the next connection until half of "
    "their controller's `timeout_ms` has passed, and are then answered with exception 0x0A, on RTU with "
    "silence. The detail says why. Told once a minute for each reason, with how often it happened; at once "
    "where an axis was under way, and where it lasts for a second",
    "an adapter was unplugged, or the connection to the drives or their device server was closed; *when "
    "idle*: the server closes connections on which nothing is asked, which does no harm; *after a malformed "
    "header*: what is there does not speak Modbus/TCP as it should",
    "check cable, adapter and power of the drives; the gateway opens the way again by itself",
)
CONNECTION_RENEWED: Final = EventEntry(
    "connection-renewed",
    Severity.WARNING,
    "nothing came on the connection to the drives for three time-outs, whoever was asked: it was broken "
    "off, and another one is made. It is no sign of life: what counts silence goes on. Made anew again after "
    "1 s at the soonest, then twice as late each time up to 60 s",
    "a device server that has forgotten the connection, or one that was asked too soon after it accepted it; "
    "drives that are off behind a converter look the same",
    "where it happens after each start, set `connect_delay_ms`; else look at the drives and their converter",
)
DRIVE_SILENT: Final = EventEntry(
    "drive-silent",
    Severity.WARNING,
    "a drive did not answer in time, after one that did; told once until it answers again",
    "the drive is off or in its start, a loose wire, a disturbed line, another unit id, or a "
    "`response_timeout_ms` shorter than the drive needs",
    "look at the drive and its wires; `timeouts` of the line in `status` tells how often it happens",
)
UNKNOWN_UNIT: Final = EventEntry(
    "unknown-unit",
    Severity.WARNING,
    "a controller talks to a unit id of a Modbus/TCP line that has no axis: what it says passes as it is, "
    "but for writes that a drive which does not look at unit ids would take for its own (0x0A); told once",
    "another device behind the same connection, or a wrong `unit_id` in the configuration or the controller",
    "name the device in `other_units`, or mend the `unit_id`; then start the gateway again",
)
DRIVE_BACKED_OFF: Final = EventEntry(
    "drive-backed-off",
    Severity.WARNING,
    "a drive left three requests in a row unanswered: what is for it, or for its group, is answered with "
    "exception 0x0B at once, and only a trial goes there from time to time; the others are not kept waiting",
    "as of `drive-silent`",
    "look at the drive and its wires; it is asked as before with the first frame that comes from it. "
    "`retry_ms` says how often it is tried, and `retry_ms = 0` turns this off",
)
CUT_THROUGH_OFF: Final = EventEntry(
    "cut-through-off",
    Severity.INFO,
    "a line with `cut_through` stores frames of a controller, requests or replies, because by what was "
    "measured they would not leave a character sooner; told once for each, and tried again",
    "an adapter that hands bytes over in lumps (a latency timer of 16 ms, a FIFO), a slow side in "
    "front of a fast one, or a machine that is busy with other things",
    "see with `pitch-gateway budget CONFIG` what the wires alone would allow: where no frame gains, take "
    "`cut_through` out; else let the gateway set the latency timer (`low_latency`, see "
    "[latency settings](operations.md#what-a-serial-port-adds-latency-settings)), or give the relay `fifo`; "
    "then start the gateway again",
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
    "the axis knows where it is: from its next target on it is corrected",
    "homing, the homed bit, a position that was set, or `pitch-gateway reference`",
)
REFERENCE_LOST: Final = EventEntry(
    "reference-lost",
    Severity.WARNING,
    "nobody knows any more where the axis is: positions pass 1:1 in both directions",
    "the homed bit went away, an alarm, a drive that was silent for `lost_ms`, homing that began, or a "
    "standing axis that shows another position; the detail says which",
    "home the axis; where the drive has no way to show it, `pitch-gateway reference CONFIG AXIS`",
)
DIRECTION_UNSURE: Final = EventEntry(
    "direction-unsure",
    Severity.WARNING,
    "where the axis is could not be told: it keeps the branch of the table that it had",
    "the axis moved while a new target came, or its actual position cannot be read",
    "map `actual` and `bits.done` of the drive, set `max_speed`, and leave `safe_read` on",
)
BRANCH_HUNTS: Final = EventEntry(
    "branch-hunts",
    Severity.WARNING,
    "the branch of the table changed more than five times in ten seconds",
    "short moves to and fro, or a controller that resends one target with noise in it",
    "if the machine stands, set `repeat_within` to the counts by which its target trembles",
)
COMPENSATION_ENDED: Final = EventEntry(
    "compensation-ended",
    Severity.WARNING,
    "the axis is not corrected any more until the gateway is started again",
    "a register listed under `remap` was written, which moves other registers about or turns their words",
    "check that the drive's registers are as the configuration says, then start the gateway again",
)
REFUSED_VALUE: Final = EventEntry(
    "refused-value",
    Severity.WARNING,
    "a request was answered with an exception by the gateway itself, and did not reach the drive",
    "a position beyond `travel`, the register or the table, a part of a position whose rest is not known, or "
    "a write around the correction; the detail says which",
    "give the sentence of `detail` to `pitch-gateway explain`, in quotes: it says what to do",
)
AXIS_BLOCKED: Final = EventEntry(
    "axis-blocked",
    Severity.WARNING,
    "a target was lost on the way to the drive: the triggers of the axis are refused until it has accepted a "
    "complete one; stops pass",
    "the drive refused or did not answer a write, or a request of the controller was refused",
    "let the controller write the whole target again, of a group those of all its axes; where the gateway "
    "itself refused it, the event `refused-value` before it says what has to be another",
)
AXIS_RELEASED: Final = EventEntry(
    "axis-released",
    Severity.WARNING,
    "the drive has accepted a complete target: the triggers of the axis pass again",
    "the end of an `axis-blocked`",
)
GROUP_HELD: Final = EventEntry(
    "group-held",
    Severity.WARNING,
    "an axis of a group goes corrected, or 1:1, as the first of them has gone, although a switch, a table, a "
    "gain or a reference has changed since: that comes into force when all of them have gone",
    "the compensation was switched, or a homed bit fell, between the triggers of the axes of a group",
    "switch while the machine stands; where a reference was lost, home the axes before the next move",
)
GROUP_SKEWED: Final = EventEntry(
    "group-skewed",
    Severity.ERROR,
    "an axis of a group has gone, or may have, and the target of another one was refused: the beam is skewed "
    "by as much as the detail says; the gateway stops nothing by itself",
    "the drive refused its trigger or did not answer, or its target was lost before",
    "stop the axes where the machine cannot bear it; else write the target of the refused axis again, one "
    "that it may have, and run it",
)
RESTAGED: Final = EventEntry(
    "restaged",
    Severity.WARNING,
    "a staged target was written once more before its trigger, with the correction that holds now",
    "the axis stood elsewhere when the target was triggered than when it was written, or the table changed",
)
UNKNOWN_MODE: Final = EventEntry(
    "unknown-mode",
    Severity.WARNING,
    "a frame meant something that the register map does not know: it passed untouched",
    "the controller uses a mode or a trigger value that is listed nowhere",
    "look the value up in the drive's manual and list it under its meaning, or under `ignore`",
)
STORED_MOVE: Final = EventEntry(
    "stored-move",
    Severity.WARNING,
    "the start of a position that was not written through the gateway was refused, with exception 4",
    "the controller runs a position that the drive keeps, or one that was written before the gateway started",
    'let the controller write the target, or set `stored_moves = "uncorrected"`',
)
BASE_UNKNOWN: Final = EventEntry(
    "base-unknown",
    Severity.WARNING,
    "a relative move came while nobody knew where it starts: refused with exception 6, or passed unchanged "
    'with `relative_unknown = "pass"`',
    "a stop, a jog, homing, an alarm or a lost connection before it, and no register that tells the place of "
    "an axis that stands",
    "map `commanded` or `actual` with `bits.done` or `bits.moving`, or let the controller begin with an "
    "absolute move",
)
STREAM_BEGAN: Final = EventEntry(
    "stream-began",
    Severity.INFO,
    "what the drive stood from the first setpoint of a stream stays in force until the table has taken over",
    "a start without a record, a homing or a position that was set",
    "look at `detail`: what cannot be a correction was gone with the first setpoint",
)
RESTORED: Final = EventEntry(
    "restored",
    Severity.INFO,
    "the axis goes on where its record of the run before says that it was",
    "a start of the gateway while the drive stood still",
)
RECORD_NOT_USED: Final = EventEntry(
    "record-not-used",
    Severity.WARNING,
    "the record of the run before does not count, or none can be kept: the axis starts as for the first time",
    "the axis was moved meanwhile, table or scale were changed, it is not referenced, or the file cannot be "
    "used; the detail says which",
    "see [what a restart knows](operations.md#what-a-restart-knows); most reasons pass with the first target",
)
WITHDRAWN: Final = EventEntry(
    "withdrawn",
    Severity.WARNING,
    "a request was not sent: its controller had given up on it, or a stop of its axis came after it; told at "
    "most once a second for each controller and reason, with how many there were",
    "the line is too slow for what all controllers want of it, a controller closed its connection, or a stop",
    "compare with `pitch-gateway budget CONFIG`; give the controller a longer time-out or a slower cycle",
)
STOOD_STILL: Final = EventEntry(
    "stood-still",
    Severity.WARNING,
    "the relay did not run for a while; what its controllers gave up meanwhile was not sent, but for stops",
    "a stopped or starved process, or a machine that was suspended",
    "see that nothing else takes the processor; leave real-time scheduling on",
)
LATE_TARGET: Final = EventEntry(
    "late-target",
    Severity.WARNING,
    "a target or trigger had waited longer than `deadline_ms`; sent, or refused with exception 6",
    "the line was taken by other requests, or a drive was silent",
    "compare with `pitch-gateway budget CONFIG`; let monitors ask less often",
)
BUDGET_OVERRUN: Final = EventEntry(
    "budget-overrun",
    Severity.WARNING,
    "an exchange took more gateway time than `budget_us`, after many that did not; the detail names the "
    "slowest step",
    "the machine is busy with something else",
    "look at its load; `fifo` and `cpus` of `[relay]` put the gateway before everything else",
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
    "a drive sent a frame that answers nothing, which was dropped",
    "the drive answers later than `response_timeout_ms`, or twice, or another master is on the line",
    "raise `response_timeout_ms` until the drive answers in time (with the gateway stopped "
    "`pitch-gateway probe CONFIG --timing` then measures how much it needs), and see that no other master "
    "talks on the line",
)
REQUEST_REFUSED: Final = EventEntry(
    "request-refused",
    Severity.WARNING,
    "a controller asked for what its role or its rights do not allow, too often, or faster than the line "
    "answers; told at most once a minute for each controller and reason, with how often it happened",
    "a controller with another task than its configuration says, one that does not wait for replies, a "
    "scanner, or somebody who tries",
    "look at `peer`, `function_code` and `unit_id`; the detail names the key of the controller that says so: "
    "where it may do that, change the key and start the gateway again",
)
SECOND_WRITER: Final = EventEntry(
    "second-writer",
    Severity.WARNING,
    "a controller wanted to move an axis that another one moves, and was refused with exception 6; told at "
    "most once "
    "a minute for each axis and controller",
    "a panel that jogs while the program runs, two programs at once, or somebody who tries; or the one that "
    "holds it writes a trigger in every cycle, also when that starts nothing, and so never lets go",
    "let one of them finish: `writer` of the axis in `status` says who holds it (on a terminal `moved by`), "
    'and have it write triggers only when they change; where both are to move it, set `writers = "any"`',
)
INTERNAL_FAULT: Final = EventEntry(
    "internal-fault",
    Severity.ERROR,
    "a fault of the gateway's own program: something happened to an axis or a request that cannot happen in "
    "its state. The safest holds from then on: nobody knows where the axis is, a homed bit that decides is "
    "read again before positions pass, and triggers are refused until a complete target was accepted; stops "
    "pass. Of the request nothing more is sent",
    "a bug of the gateway; the detail says in which state it met what",
    "write the target again, or home the axis where it is not referenced; send the log and the configuration "
    "to the makers of the gateway",
)
TERM_FOLLOWS: Final = EventEntry(
    "term-follows",
    Severity.INFO,
    "what `thermal` or `cross` adds to the corrections of an axis follows its source",
    "the first value, or the end of a `term-held` or `term-fades`; `term` says which of the two",
)
TERM_HELD: Final = EventEntry(
    "term-held",
    Severity.WARNING,
    "nothing new is heard of what `thermal` or `cross` of an axis depends on: its last value is held",
    "thermal: no temperature for `timeout_s`; cross: the other axis lost its reference, or was stopped or "
    "jogged, has got no target since, and its actual position is not read",
    "thermal: look at the sensor, the broker or the address it is read from; cross: give the other axis a "
    "target; where it lost its reference, home it first",
)
TERM_FADES: Final = EventEntry(
    "term-fades",
    Severity.WARNING,
    "what `thermal` or `cross` adds to the corrections of an axis goes back to 0, with its next targets",
    "a `term-held` that went on: longer than `hold_s` of `thermal`, or `fresh_s` of `cross`",
    "as for `term-held`; the axis is corrected by its table alone meanwhile",
)
TERM_TOO_LARGE: Final = EventEntry(
    "term-too-large",
    Severity.WARNING,
    "what `thermal` and `cross` would add comes, together with the table, to more than `max_correction`: "
    "they stay as they were, or are left out where another table came",
    "a warm machine with a table that needs nearly all of `max_correction`, or a wrong `alpha` or `fixed_at`",
    "check `alpha`, `reference` and `fixed_at`, and start the gateway again after a change; raise "
    "`max_correction` only if the machine is that bad",
)
