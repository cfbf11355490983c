"""Exceptions that the gateway itself answers. What a drive answers passes as it is, also with these codes.

Each sentence stands here, and the place that refuses fills it in. They come in the order of their codes.
"""

from typing import Final

from gateway.catalogue.entry import RefusalEntry

_WHOLE: Final = "write all of the position in one frame"
_MAPPED: Final = 'map the register, or set `unmapped = "pass"` if nothing moves by it'

ROLE: Final = RefusalEntry(
    0x01,
    "",
    "",
    "a `monitor` wrote something, or an `operator` something that is no stop",
    "give the controller another `role`, or let it read only",
)
FUNCTION_CODE: Final = RefusalEntry(
    0x01,
    "",
    "",
    "`function_codes` or `read_only` of the controller do not allow the request; event `request-refused`",
    "see which key its detail names, and whether the controller may do that",
)
NOT_MAPPED: Final = RefusalEntry(
    0x02,
    "register {address:#06x} holds a position that is not mapped",
    ' (unmapped = "pass" lets it through)',
    "a register listed under `position_like` was written while the axis is corrected",
    _MAPPED,
)
REPORTS_A_POSITION: Final = RefusalEntry(
    0x02,
    "register {address:#06x} reports a position",
    "; writing it would move the frame",
    "a register listed under `actual`, `commanded` or `aliases` was written while the axis is corrected",
    "leave it to the drive; where writing it sets the position, map it with `set_position = true`",
)
WRITE_CUTS: Final = RefusalEntry(
    0x02,
    "this write cuts a position",
    ", and {quantity} registers are more than the drive's {limit}",
    "a frame holds a part of a position, and the whole would be longer than the drive takes",
    "write the position in a frame of its own; check `max_registers`",
)
READ_CUTS: Final = RefusalEntry(
    0x02,
    "this read cuts a position",
    ", and {quantity} registers are more than the drive's {limit}",
    "a frame reads a part of a position, and the whole would be longer than the drive answers",
    "read the position in a frame of its own; check `max_registers`",
)
UNKNOWN_WIDTH: Final = RefusalEntry(
    0x02,
    "a {access} at {address:#06x} runs over an object of unknown width",
    " into a mapped one",
    "a frame holds several objects, and the width of one of them is not known",
    "list the object with its `words` under `objects`, or use frames of one object",
)
ADDRESS: Final = RefusalEntry(
    0x02,
    "",
    "",
    "an address that is not in `readable` or `writable` of the controller; event `request-refused`",
    "see which address its detail names, and whether the controller may touch it",
)
COUNTS_CONTRADICT: Final = RefusalEntry(
    0x03,
    "the counts of a write to {register} contradict each other",
    "",
    "the number of registers and the number of bytes of a write do not belong together",
    "correct the controller's program: the frame is malformed",
)
TOO_SHORT: Final = RefusalEntry(
    0x03,
    "a request that is shorter than its function code asks for",
    ": no drive can make sense of it",
    "a request lacks bytes that its function code always has",
    "correct the controller's program: the frame is malformed; where a device on a serial line takes "
    "such frames, as some inverters do, name its unit id in `other_units`",
)
OUTSIDE_TRAVEL: Final = RefusalEntry(
    0x04,
    "corrected machine position {position:.6g} leaves the travel",
    " {low:g} to {high:g} by more than travel_margin = {margin:g} {units}",
    "the target is beyond `travel` by more than `travel_margin`, with its correction",
    "correct the target, or `travel` where it is not that of the machine",
)
OUTSIDE_TABLE: Final = RefusalEntry(
    0x04,
    "machine position {position:.6g} lies outside the table",
    ' ({first:g} to {last:g}) and outside = "refuse"',
    'the target is outside the table, and `outside = "refuse"`',
    "measure the whole travel, or choose what holds outside with `outside`",
)
DOES_NOT_FIT: Final = RefusalEntry(
    0x04,
    "a value of {raw!r} does not fit {field}",
    ": it holds {limits}",
    "the corrected position, or the distance, is larger than its register can hold",
    "check `counts_per_unit` and `zero_counts`; else the target is one that the drive cannot go to",
)
NO_POSITION: Final = RefusalEntry(
    0x04,
    "a value of {raw} is not a position",
    "",
    "a float register was written with nan or infinity",
    "correct the controller's program; check `type` and `words` of the position",
)
NO_DISTANCE: Final = RefusalEntry(
    0x04,
    "a value of {raw} is not a distance",
    "",
    "a float register was written with nan or infinity",
    "correct the controller's program; check `type` and `words` of the position",
)
REST_UNKNOWN: Final = RefusalEntry(
    0x04,
    "part of the position at {register} was written and the rest is not known",
    "",
    "one word of a position was written before the gateway knew the others, and it may not read them",
    f"{_WHOLE}, or let the gateway read (`safe_read`)",
)
REST_UNCERTAIN: Final = RefusalEntry(
    0x04,
    "part of the position at {register} was written and the rest is not certain",
    ": what the drive holds may lie across a word's border from what was commanded; write all of it "
    "in one frame",
    "one word of a position was written, and the correction may have changed the other one",
    _WHOLE,
)
PART_LOST: Final = RefusalEntry(
    0x04,
    "a part of the position at {register} was lost before",
    ": write all of it again",
    "one of several writes of a position was refused or not answered",
    "write all of the position again",
)
PART_OF_LIMIT: Final = RefusalEntry(
    0x04,
    "a part of the limit at {register} was written",
    ": write all of it in one frame",
    "one word of a limit was written",
    "write all of the limit in one frame",
)
TARGET_LOST: Final = RefusalEntry(
    0x04,
    "a trigger, but a target, its mode or a part of it was lost before",
    ": write all of it again",
    "the axis is `blocked`: a write before the trigger did not reach the drive. The code is that of "
    "the loss, as a rule 4, 6, 0x0A or 0x0B",
    "write target and mode again, then trigger",
)
GROUP_CANNOT_FOLLOW: Final = RefusalEntry(
    0x04,
    "the first trigger of its group is refused",
    ", for this axis could not follow: {why}",
    "another axis of the group could not follow: the target that it holds cannot be written anew, or "
    "must not be gone to; the sentence behind the colon says why. Nothing has moved",
    "look that sentence up, write the targets of all axes of the group again, then trigger",
)
NOT_OURS: Final = RefusalEntry(
    0x04,
    "a trigger, and its target was not written through the gateway",
    ': write it again (stored_moves = "uncorrected" lets it pass)',
    "the drive holds a target from before the gateway was started, or from another master",
    'write the target again, or set `stored_moves = "uncorrected"`',
)
KEPT_POSITION: Final = RefusalEntry(
    0x04,
    "it runs a position that the drive keeps",
    ', and nobody knows which correction that carries (stored_moves = "uncorrected" lets it pass)',
    "a trigger or mode that is listed under `stored`",
    'let the controller write targets, or set `stored_moves = "uncorrected"`',
)
RESTAGING_STARTS: Final = RefusalEntry(
    0x04,
    "its target has to be written anew, and writing it starts the move",
    ": write it in the frame that runs it",
    "what stands in the drive is no distance from here, or not the target as it is corrected from here",
    "write the distance or the target in the frame that runs it",
)
RESTAGING_FORBIDDEN: Final = RefusalEntry(
    0x04,
    "the staged target has to be written anew for its trigger",
    ', and added_frames = "never" forbids it',
    'the correction has changed since the target was written, and `added_frames = "never"`',
    'write the target again, then trigger; to have the gateway do it, set `added_frames = "auto"`',
)
REPLY_NOT_NOMINAL: Final = RefusalEntry(
    0x04,
    "",
    "",
    "the reply of the drive cannot be turned back into what the controller asked for",
    "check `type`, `words` and `scale` of the positions; with the gateway stopped "
    "`pitch-gateway probe CONFIG` tells",
)
TOO_OFTEN: Final = RefusalEntry(
    0x06,
    "",
    "",
    "more requests in a second than `requests_per_s` of the controller allows; event `request-refused`",
    "let the controller ask less often, or raise the key",
)
SECOND_WRITER: Final = RefusalEntry(
    0x06,
    "",
    "",
    "another controller or host moves the axis; event `second-writer`",
    'let one of them finish, or set `writers = "any"` where both are to move it',
)
LATE: Final = RefusalEntry(
    0x06,
    "it waited {age_ms:.1f} ms, deadline_ms = {deadline_ms:g}: refused",
    ' (late = "reject")',
    "a target or trigger came too late to the front of the queue",
    "compare with `pitch-gateway budget CONFIG`; let monitors ask less often; "
    '`late = "forward"` sends it all the same',
)
BASE_UNKNOWN: Final = RefusalEntry(
    0x06,
    "a relative move, and {why}",
    ' (relative_unknown = "pass" lets it through unchanged)',
    "nobody knows where the distance starts from",
    "begin with an absolute move, map `actual` and `bits.done`, or set `relative_unknown`",
)
POSITION_WITHHELD: Final = RefusalEntry(
    0x06,
    "its drive was out of reach or lost its reference, and nothing tells whether it stands at this target",
    ": read its actual position, or command another target",
    "the last target was given again after a loss, and the gateway may not look where the axis stands: "
    "its drive may count from another zero now",
    "read the actual position, or command another target; let the gateway look (`added_frames`, "
    "`safe_read`, `actual`)",
)
STOPPED: Final = RefusalEntry(
    0x06,
    "",
    "",
    "a stop of the axis came while the request waited, and withdrew it; event `withdrawn`",
    "send the target again if it is still wanted",
)
QUEUE_FULL: Final = RefusalEntry(
    0x06,
    "",
    "",
    "64 KiB of requests from the controller's host wait on the line already; event `request-refused`",
    "let the controller wait for a reply before it sends the next request",
)
LINE_DOWN: Final = RefusalEntry(
    0x0A,
    "",
    "",
    "there is no way to the drives: the line is down. On a serial controller's port silence instead",
    "see `line-down` and `drives-not-reached`",
)
UNIT_NOT_NAMED: Final = RefusalEntry(
    0x0A,
    "",
    "",
    "a unit id that `unit_ids` of the controller does not name. On a serial controller's port silence "
    "instead",
    "see `request-refused`, and whether the controller may speak to that drive",
)
UNIT_NOT_MAPPED: Final = RefusalEntry(
    0x0A,
    "unit id {unit_id} is not mapped",
    ", and may reach an axis that is corrected",
    "on Modbus/TCP unit ids 0 and 255 may reach any drive, and one behind them is corrected",
    "let the controller use the `unit_id` of the axis",
)
UNIT_WITHOUT_AXIS: Final = RefusalEntry(
    0x0A,
    "unit id {unit_id} has no axis",
    ", and a drive that does not look at unit ids would take this for its own, uncorrected; "
    "other_units = [{unit_id}] names another device",
    "on a Modbus/TCP line with one axis a drive that does not look at unit ids would take it for its own",
    "let the controller use the `unit_id` of the axis, or name the other device in `other_units`",
)
BROADCAST_POSITION: Final = RefusalEntry(
    0x0A,
    "a broadcast cannot carry a position",
    " that each axis corrects differently",
    "a position was written to unit id 0, and each axis corrects it differently",
    "write the position to each axis",
)
NO_RESPONSE: Final = RefusalEntry(
    0x0B,
    "",
    "",
    "the drive did not answer in time. On a serial controller's port silence instead",
    "see `drive-silent`",
)
BACKED_OFF: Final = RefusalEntry(
    0x0B,
    "",
    "",
    "the drive, or another one of its group, left three requests in a row unanswered and is only tried "
    "from time to time: answered at once, on a serial controller's port too",
    "see `drive-backed-off`",
)
TOO_LATE: Final = RefusalEntry(
    0x0B,
    "",
    "",
    "the drive was silent, and the request could have left only with less than half of its controller's "
    "`timeout_ms` left: it was not sent, and answered at once, on a serial controller's port too",
    "see `drive-silent`; the counter `too_late` of the line says how often",
)
REFUSALS: Final = tuple(each for each in tuple(globals().values()) if isinstance(each, RefusalEntry))
