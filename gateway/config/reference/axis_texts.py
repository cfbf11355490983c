"""Texts of ``[axis.NAME]``."""

from typing import Final

from gateway.config.reference.text import Said, Texts

AXIS: Final[Texts] = {
    "line": Said(
        kind="name",
    ),
    "unit_id": Said(
        meaning=(
            "Modbus unit id of its drive; 0 only on Modbus TCP (on a serial line it is the broadcast). "
            "Several axes may share one if their registers do not"
        ),
    ),
    "drive": Said(
        meaning=(
            'a profile that comes with the gateway (`"oriental-az"`; `pitch-gateway drives` lists '
            'them), or a file of your own (`"./my-drive.toml"`, relative to this file); see '
            "[drives.md](drives.md). Warned of: a line of a kind that the drive does not have"
        ),
        kind="name or path",
    ),
    "registers": Said(
        more="See below; refused beside `drive`",
        default="required without `drive`",
    ),
    "units": Said(
        meaning=(
            "unit of every length of this axis. A table in the other unit of length is converted; "
            "angles and lengths never are"
        ),
    ),
    "counts_per_unit": Said(
        meaning=(
            "counts of the drive in one unit, negative where the drive counts down while the axis goes "
            "forward"
        ),
    ),
    "travel": Said(
        meaning="machine positions between which the axis moves. Its ends must fit the command registers",
        default="none, warned of",
    ),
    "travel_margin": Said(
        meaning="how far a corrected position may lie outside `travel` before it is refused",
        default="`max_correction`",
    ),
    "lead": Said(
        meaning=(
            "travel of one turn of its screw. `measure` takes random targets over it, warns of targets that "
            "meet the screw always at one angle, and looks for an error that repeats once and twice a turn"
        ),
        default="none: not looked for",
    ),
    "table": Said(
        meaning=(
            "table file in the tables folder, in any case of letters, without a path. A file that was "
            "renamed to `.bak`, or taken away while the gateway runs, is switched off: the axis is not "
            "corrected. Without touching the file: `compensation`"
        ),
        kind="file name",
        default="none: 1:1",
    ),
    "table_options": Said(
        more="See below",
    ),
    "compensation": Said(
        meaning=(
            "`on` corrects. `shadow` computes and shows corrections and passes positions unchanged: begin "
            "with it. `off` does neither. Write the key: where an axis with a table leaves it out, the axis "
            "is corrected, and `check` and each start warn"
        ),
    ),
    "referenced": Said(
        more="See below",
    ),
    "home_approach": Said(
        meaning=(
            "direction of the last movement of homing: the branch in force after it. `none`: half way "
            "between the branches until the first move"
        ),
    ),
    "setpoints": Said(
        meaning="`targets`: the drive profiles each move; `stream`: a setpoint in every cycle",
    ),
    "max_speed": Said(
        kind="units/s ≥ 0",
    ),
    "hysteresis": Said(
        meaning=(
            "`stream`: smallest motion that is a reversal; the setpoint has to come back by as much "
            "before the branch changes. `targets`: every target that differs from the last one is a "
            "motion in its direction, however short it is; `hysteresis` is only how far a measured "
            "position may lie beside another and still be the same place. Refused when as long as "
            "travel or table"
        ),
        default="2 counts, or 2 steps of registers that tell less than a count, at least 0.001 mm",
    ),
    "reload": Said(
        meaning=(
            "`stream`: setpoint travel over which one table gives way to another; made longer where it "
            "must be. No effect in `targets` (warned of)"
        ),
        kind="`{ distance = LENGTH }`",
        default="`1` mm",
    ),
    "modulo": Said(
        meaning=(
            "one turn of a rotary axis. The table must cover exactly one turn with equal corrections "
            'at both ends; without a table `units` must be `"degree"`'
        ),
    ),
    "max_correction": Said(
        meaning="larger corrections, with backlash, are refused",
        default="`0.5` mm, or 0.3 mm/m of `travel` where that is more",
    ),
    "max_slope": Said(
        meaning="steeper tables are refused: change of the correction per unit of travel",
    ),
    "fresh_ms": Said(
        meaning="age up to which a measured position counts",
    ),
    "in_position": Said(
        meaning=(
            "an axis whose actual position lies within this of its last target has arrived there, "
            "once its done bit says so; one that nobody has seen for `unseen_ms` and that is found "
            "within it stands where it was sent. Never less than `hysteresis`"
        ),
        default="`0.02` mm",
    ),
    "repeat_within": Said(
        meaning=(
            "`targets`: counts by which a target may differ from the last one and still be taken for "
            "the same with the noise of whoever resends it: it keeps its branch. An event "
            "(`branch-hunts`) tells of a branch that changes more than five times in ten seconds"
        ),
        kind="counts ≥ 0",
    ),
    "unseen_ms": Said(
        meaning=(
            "`targets`: where neither the axis was read nor a command sent to it for longer than "
            "this, its actual position is read once before the next target, repeat or distance: "
            "somebody may have jogged it at the drive's own panel. That read does not count towards "
            "`deadline_ms`. A status bit keeps an axis in sight only where it is read again within "
            "this. Where nothing may be read the direction is flagged"
        ),
    ),
    "lost_ms": Said(
        meaning=(
            "a drive that left requests unanswered for longer than this, from the first to the last of "
            "them, may have been switched off: base, modes and registers are forgotten, never the words "
            "of a place that was proved, and `referenced` has to be shown again. Its last target keeps "
            "its words only where a reading shows the axis there. One lost reply is no silence"
        ),
    ),
    "backlash": Said(
        more="Beside a table of one direction, or without a table",
        kind="`{ width = LENGTH, kind = … }`",
    ),
    "thermal": Said(
        more="See below; refused without `table` and `travel`, on a rotary axis and in a group",
    ),
    "cross": Said(
        more="See below; refused without `table` and `travel`, and in a group",
        kind="list of `{ axis, table, fresh_s }`",
    ),
    "added_frames": Said(
        meaning=(
            "`never`: the gateway sends no frame of its own. A trigger whose target would have to be written "
            "anew and a distance whose start would have to be read are refused; where only a reading would "
            "tell the direction it is kept and flagged"
        ),
    ),
    "writers": Said(
        meaning=(
            "`one`: whoever moves the axis holds it, and what would move it from another controller or host "
            "gets "
            "exception 6 (event `second-writer`). Stops always pass. `any`: all may move it at any time, "
            "and answer "
            "for what comes of it"
        ),
    ),
    "writer_hold_s": Said(
        meaning=(
            "so long after its last frame that moves the axis its writer still holds it, and 2 s at most "
            "after its last connection has closed"
        ),
    ),
    "budget_us": Said(
        meaning=(
            "what the gateway itself may take for one exchange of this axis: from the last byte in to "
            "the first byte out, of the request and of the reply together. Wires and drives are not in "
            "it"
        ),
    ),
    "deadline_ms": Said(
        meaning=(
            "age at which a target or its trigger is late, counted from its last byte from the "
            "controller to its first byte to the drive. A stop is never late"
        ),
        default="none",
    ),
    "late": Said(
        meaning=(
            "what happens to a late target: it goes all the same, because a move must not end short; "
            "or it is refused, because a stale setpoint is worse than none. Refused without "
            "`deadline_ms`"
        ),
        default='`"forward"` with `setpoints = "targets"`, `"reject"` with `"stream"`',
    ),
    "unmapped": Said(
        meaning=(
            "what happens to writes to `position_like` registers while the axis is corrected: "
            "exception 2, or they pass as they are"
        ),
    ),
    "stored_moves": Said(
        meaning=(
            "what happens to moves to positions that the drive keeps, and to triggers of targets that "
            "were not written through the gateway, whatever kind of move they are: exception 4, or they "
            "run as they are and the axis is flagged"
        ),
    ),
    "relative_unknown": Said(
        meaning=(
            "what happens to distances from a place that nobody knows: exception 6, or they pass as "
            "they are and are reported"
        ),
    ),
}

TABLE_OPTIONS: Final[Texts] = {
    "file_counts_per_unit": Said(
        meaning=(
            "version 1: encoder counts per unit of the control that the file was made for, negative "
            "for its Dir Rev"
        ),
    ),
    "v1_layout": Said(
        meaning="version 1: whether the first value belongs to home or to one interval from it",
    ),
    "file_start": Said(
        meaning=(
            "version 2: machine position of the first point. Mint: machine position of mark A, needed "
            "where `PRECISIONOFFSET` is missing or not 0"
        ),
    ),
    "increment": Said(
        meaning="Mint: distance of the points, where the program does not set `PRECISIONINCREMENT`",
    ),
    "file_home": Said(
        meaning="the end at which the axis of the file homes",
    ),
    "format": Said(
        meaning="name of the format where the text fits several, such as LinuxCNC's two types",
    ),
    "file_units": Said(
        meaning="units of a file that states none; every length in this table stays in units of the axis",
    ),
    "file_axis": Said(
        meaning="what a file that holds several axes calls this one",
    ),
    "fagor_sense": Said(
        meaning="Fagor tables: whether an error is where the nut was less where it should be, or the reverse",
    ),
    "isg_sense": Said(
        meaning="ISG and TwinCAT CNC tables: the same; where it is not told, actual less command",
    ),
    "error_sense": Said(
        meaning="the same for every format whose errors have no fixed sign, such as Heidenhain's",
    ),
}

THERMAL: Final[Texts] = {
    "alpha": Said(
        kind="per kelvin, 0 to 0.001",
        meaning="how much longer the screw becomes with each kelvin: about `11.5e-6` for steel",
    ),
    "fixed_at": Said(
        meaning=(
            "machine position that stays where it is when the screw grows: where its fixed bearing is, on "
            "the scale of `travel`. It may lie outside `travel`"
        ),
    ),
    "source": Said(
        more="`{ mqtt = … }` or `{ modbus = …, address = … }`, see below",
        kind="table",
    ),
    "hold_s": Said(
        meaning=(
            "so long after `timeout_s` the last temperature is held; then what is added goes back to 0, by "
            "`rate_per_min`"
        ),
    ),
    "rate_per_min": Said(
        meaning="what is added follows the temperature no faster, so that a sensor that jumps does no harm",
    ),
    "largest_dt": Said(
        meaning=(
            "a value that lies farther from `reference` is no temperature of a screw: it is refused, told, "
            "and counts as silence"
        ),
    ),
}

SOURCE: Final[Texts] = {
    "mqtt": Said(
        meaning=(
            "topic of the broker of `[mqtt]`. A message is a number in °C, or JSON with a number under "
            "`temperature`, `celsius` or `value`"
        ),
        kind="topic",
    ),
    "address": Said(default="required beside `modbus`"),
    "modbus": Said(
        more="It may be a monitor's address of the gateway itself, where the sensor is on a bus of drives",
    ),
}

CROSS: Final[Texts] = {
    "table": Said(
        meaning=(
            "table file in the tables folder, of any format and of one direction: corrections of this axis "
            "at machine positions of the other one. It is read with the configuration and not watched"
        ),
        kind="file name",
    ),
}
