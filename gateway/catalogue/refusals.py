"""Exceptions from the gateway itself. Exceptions from a drive pass unchanged, also with these codes.

Each sentence is here; the code that refuses fills in its fields. They are in the order of their codes.
"""

from typing import Final

from gateway.catalogue.entry import RefusalEntry

_WHOLE: Final = "write the whole position in one frame"
_MAPPED: Final = 'map the register, or set `unmapped = "pass"` if nothing moves by it'

ROLE: Final = RefusalEntry(
    0x01,
    "",
    "",
    "a `monitor` wrote, or an `operator` wrote something other than a stop",
    "give the controller another `role`, or let it only read",
)
FUNCTION_CODE: Final = RefusalEntry(
    0x01,
    "",
    "",
    "`function_codes` or `read_only` of the controller forbid the request; event `request-refused`",
    "check the key that its detail names",
)
NOT_MAPPED: Final = RefusalEntry(
    0x02,
    "register {address:#06x} holds a position that is not mapped",
    ' (unmapped = "pass" lets it through)',
    "a write to a `position_like` register while the axis is corrected",
    _MAPPED,
)
REPORTS_A_POSITION: Final = RefusalEntry(
    0x02,
    "register {address:#06x} reports a position",
    "; writing it would move the frame",
    "a write to a register under `actual`, `commanded` or `aliases` while the axis is corrected",
    "do not write it. If writing it sets the position, map it with `set_position = true`",
)
WRITE_CUTS: Final = RefusalEntry(
    0x02,
    "this write cuts a position",
    ", and {quantity} registers are more than the drive's {limit}",
    "a frame holds part of a position, and the whole position would exceed the drive's frame length",
    "write the position in its own frame; check `max_registers`",
)
READ_CUTS: Final = RefusalEntry(
    0x02,
    "this read cuts a position",
    ", and {quantity} registers are more than the drive's {limit}",
    "a frame reads part of a position, and the whole position would exceed the drive's frame length",
    "read the position in its own frame; check `max_registers`",
)
UNKNOWN_WIDTH: Final = RefusalEntry(
    0x02,
    "a {access} at {address:#06x} runs over an object of unknown width",
    " into a mapped one",
    "a frame holds several objects, one of unknown width",
    "list the object with its `words` under `objects`, or use a frame for each object",
)
ADDRESS: Final = RefusalEntry(
    0x02,
    "",
    "",
    "an address outside `readable` or `writable` of the controller; event `request-refused`",
    "check the address that its detail names",
)
COUNTS_CONTRADICT: Final = RefusalEntry(
    0x03,
    "register count and byte count of a write to {register} do not match",
    "",
    "register count and byte count of a write do not match",
    "correct the controller's program: the frame is malformed",
)
TOO_SHORT: Final = RefusalEntry(
    0x03,
    "a request that is shorter than its function code asks for",
    ": no drive can make sense of it",
    "a request lacks bytes that its function code requires",
    "correct the controller's program: the frame is malformed. If a device on a serial line takes such "
    "frames, as some inverters do, name its unit id in `other_units`",
)
OUTSIDE_TRAVEL: Final = RefusalEntry(
    0x04,
    "corrected machine position {position:.6g} leaves the travel",
    " {low:g} to {high:g} by more than travel_margin = {margin:g} {units}",
    "the corrected target is beyond `travel` by more than `travel_margin`",
    "correct the target, or `travel` if it is not the machine's",
)
OUTSIDE_TABLE: Final = RefusalEntry(
    0x04,
    "machine position {position:.6g} lies outside the table",
    ' ({first:g} to {last:g}) and outside = "refuse"',
    'the target is outside the table with `outside = "refuse"`',
    "measure the whole travel, or change `outside`",
)
DOES_NOT_FIT: Final = RefusalEntry(
    0x04,
    "a value of {raw!r} does not fit {field}",
    ": it holds {limits}",
    "the corrected position or distance exceeds the range of its register",
    "check `counts_per_unit` and `zero_counts`. Otherwise the drive cannot reach this target",
)
NO_POSITION: Final = RefusalEntry(
    0x04,
    "a value of {raw} is not a position",
    "",
    "nan or infinity was written to a float register",
    "correct the controller's program; check `type` and `words` of the position",
)
NO_DISTANCE: Final = RefusalEntry(
    0x04,
    "a value of {raw} is not a distance",
    "",
    "nan or infinity was written to a float register",
    "correct the controller's program; check `type` and `words` of the position",
)
REST_UNKNOWN: Final = RefusalEntry(
    0x04,
    "part of the position at {register} was written and the rest is not known",
    "",
    "one word of a position was written, and the gateway neither knows nor may read the others",
    f"{_WHOLE}, or let the gateway read (`safe_read`)",
)
REST_UNCERTAIN: Final = RefusalEntry(
    0x04,
    "part of the position at {register} was written and the rest is not certain",
    ": what the drive holds may lie across a word's border from what was commanded; write all of it "
    "in one frame",
    "one word of a position was written, and the correction may have changed another",
    _WHOLE,
)
PART_LOST: Final = RefusalEntry(
    0x04,
    "a part of the position at {register} was lost before",
    ": write all of it again",
    "one of several writes of a position was refused or not answered",
    "write the whole position again",
)
PART_OF_LIMIT: Final = RefusalEntry(
    0x04,
    "a part of the limit at {register} was written",
    ": write all of it in one frame",
    "one word of a limit was written",
    "write the whole limit in one frame",
)
TARGET_LOST: Final = RefusalEntry(
    0x04,
    "a target of this trigger, its mode or a part of it was lost before",
    ": write all of it again",
    "the axis is `blocked`: a write before the trigger did not reach the drive. The code is that of the "
    "loss, usually 4, 6, 0x0A or 0x0B",
    "write target and mode again, then trigger",
)
GROUP_CANNOT_FOLLOW: Final = RefusalEntry(
    0x04,
    "the first trigger of its group is refused",
    ", for this axis could not follow: {why}",
    "another axis of the group could not follow: its target cannot be rewritten, or is not allowed. The "
    "text behind the colon says why. Nothing has moved",
    "look that text up, write the targets of all axes of the group again, then trigger",
)
NOT_OURS: Final = RefusalEntry(
    0x04,
    "the target of this trigger was not written through the gateway",
    ': write it again (stored_moves = "uncorrected" lets it pass)',
    "the drive holds a target from before the start of the gateway, or from another master",
    'write the target again, or set `stored_moves = "uncorrected"`',
)
KEPT_POSITION: Final = RefusalEntry(
    0x04,
    "it runs a position stored in the drive",
    ', whose correction is unknown (stored_moves = "uncorrected" lets it pass)',
    "a trigger or mode under `stored`",
    'have the controller write targets, or set `stored_moves = "uncorrected"`',
)
RESTAGING_STARTS: Final = RefusalEntry(
    0x04,
    "its target must be rewritten, and writing it starts the move",
    ": write it in the frame that runs it",
    "the staged distance or target no longer matches the axis, and rewriting it would start the move",
    "write the distance or target in the frame that starts it",
)
RESTAGING_FORBIDDEN: Final = RefusalEntry(
    0x04,
    "the staged target must be rewritten for its trigger",
    ', and added_frames = "never" forbids it',
    'the correction has changed since the write, with `added_frames = "never"`',
    'write the target again, then trigger. To let the gateway do it, set `added_frames = "auto"`',
)
REPLY_NOT_NOMINAL: Final = RefusalEntry(
    0x04,
    "",
    "",
    "the drive's reply cannot be converted back to the controller's scale",
    "check `type`, `words` and `scale` of the positions. With the gateway stopped, `pitch-gateway probe "
    "CONFIG` shows them",
)
TOO_OFTEN: Final = RefusalEntry(
    0x06,
    "",
    "",
    "more requests in a second than `requests_per_s` of the controller; event `request-refused`",
    "let the controller poll less often, or raise the key",
)
SECOND_WRITER: Final = RefusalEntry(
    0x06,
    "",
    "",
    "another controller or host is moving the axis; event `second-writer`",
    'let one of them finish. If both must move it, set `writers = "any"`',
)
LATE: Final = RefusalEntry(
    0x06,
    "it waited {age_ms:.1f} ms, deadline_ms = {deadline_ms:g}: refused",
    ' (late = "reject")',
    "a target or trigger waited too long in the queue",
    'compare with `pitch-gateway budget CONFIG`. Let monitors poll less often. `late = "forward"` sends '
    "it anyway",
)
BASE_UNKNOWN: Final = RefusalEntry(
    0x06,
    "a relative move is refused: {why}",
    ' (relative_unknown = "pass" lets it through unchanged)',
    "the start of the distance is unknown",
    "begin with an absolute move, map `actual` and `bits.done`, or set `relative_unknown`",
)
POSITION_WITHHELD: Final = RefusalEntry(
    0x06,
    "its drive was out of reach or lost its reference, and may no longer be at this target",
    ": read its actual position, or command another target",
    "the last target was repeated after a loss, and the gateway may not read the position: the drive's "
    "zero may have changed",
    "read the actual position, or command another target. Or let the gateway read (`added_frames`, "
    "`safe_read`, `actual`)",
)
STOPPED: Final = RefusalEntry(
    0x06,
    "",
    "",
    "a stop of the axis withdrew the waiting request; event `withdrawn`",
    "send the target again if it is still needed",
)
QUEUE_FULL: Final = RefusalEntry(
    0x06,
    "",
    "",
    "64 KiB of requests from the controller's host are already waiting; event `request-refused`",
    "let the controller wait for a reply before its next request",
)
LINE_DOWN: Final = RefusalEntry(
    0x0A,
    "",
    "",
    "the line is down. On a serial controller's port: silence",
    "see `line-down` and `drives-not-reached`",
)
UNIT_NOT_NAMED: Final = RefusalEntry(
    0x0A,
    "",
    "",
    "a unit id that `unit_ids` of the controller does not name. On a serial controller's port: silence",
    "see `request-refused`; check whether the controller may use that drive",
)
UNIT_NOT_MAPPED: Final = RefusalEntry(
    0x0A,
    "unit id {unit_id} is not mapped",
    ", and may reach an axis that is corrected",
    "on Modbus/TCP, unit ids 0 and 255 may reach any drive, and one there is corrected",
    "have the controller use the `unit_id` of the axis",
)
UNIT_WITHOUT_AXIS: Final = RefusalEntry(
    0x0A,
    "unit id {unit_id} has no axis",
    ", and a drive that does not look at unit ids would take this for its own, uncorrected; "
    "other_units = [{unit_id}] names another device",
    "on a Modbus/TCP line with one axis, a drive that ignores unit ids would execute it",
    "have the controller use the `unit_id` of the axis, or name the other device in `other_units`",
)
BROADCAST_POSITION: Final = RefusalEntry(
    0x0A,
    "a broadcast cannot carry a position",
    " that each axis corrects differently",
    "a position was written to unit id 0, but each axis needs its own correction",
    "write the position to each axis",
)
NO_RESPONSE: Final = RefusalEntry(
    0x0B,
    "",
    "",
    "the drive did not answer in time. On a serial controller's port: silence",
    "see `drive-silent`",
)
BACKED_OFF: Final = RefusalEntry(
    0x0B,
    "",
    "",
    "the drive, or another of its group, left three requests in a row unanswered. The gateway tries it "
    "only now and then. A serial controller gets this exception too",
    "see `drive-backed-off`",
)
TOO_LATE: Final = RefusalEntry(
    0x0B,
    "",
    "",
    "the drive was silent; less than half of its controller's `timeout_ms` would have been left, so the "
    "request was not sent. A serial controller gets this exception too",
    "see `drive-silent`. The counter `too_late` of the line says how often",
)
REFUSALS: Final = tuple(each for each in tuple(globals().values()) if isinstance(each, RefusalEntry))
