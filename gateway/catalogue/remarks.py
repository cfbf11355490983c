"""Meaning of the remarks about a table: signs of a mistake (L), and a reader's assumptions (R)."""

from typing import Final

from gateway.catalogue.entry import RemarkEntry

REMARKS: Final = (
    RemarkEntry(
        "L1",
        "error",
        "the correction changes faster than `max_slope` (0.01) allows; a slope of 1 cannot be inverted "
        "and is never a table",
        "look for a value with the wrong sign, unit or place. Raise `max_slope` only if the screw really "
        "is so steep",
    ),
    RemarkEntry(
        "L2",
        "warning",
        "forward - backward is negative at most points and on average, but lost motion makes it "
        "positive: columns swapped?",
        "compare with the instrument's file: which column is forward? `pitch-gateway signtest CONFIG "
        "--axis AXIS` proves it at the machine",
    ),
    RemarkEntry(
        "L3",
        "warning",
        "forward - backward would be less than half as rough with the backward list reversed: logged from "
        "the other end? Not reported if the list ends with 0 at home, and reversed would not",
        "check from which end the backward list was logged, and reverse it if necessary",
    ),
    RemarkEntry(
        "L4",
        "warning, but `lint` fails",
        "unit slip: a value below 0.001 among values of 0.1 or more; version 2: all values below 0.01; "
        "version 3: values above 0.1 inch or 0.5 mm, on an axis longer than 1.67 m in proportion",
        "write all values in the unit that the file states. If it states none, name it with `file_units` "
        "of `table_options`",
    ),
    RemarkEntry(
        "L5",
        "warning",
        "not 0 at home: the first forward value if the table begins there, the last backward value if it "
        "ends there, otherwise forward at 0",
        "subtract the value at home from all values (`--home` of `table build` does it). Do not write 0 "
        "only at home: that makes a step",
    ),
    RemarkEntry(
        "L6",
        "warning",
        "a point bends the curve more than 8 times as much as the median, and by more than 1 µm; the "
        "others are judged again without it. Up to 18 evenly spaced points: without it, or without two, "
        "the others bend at most a quarter as much, and it bends by more than 3 µm. The value at home is "
        "never named",
        "check this line of the file. If the file matches the measurement, measure the point again",
    ),
    RemarkEntry(
        "L7",
        "warning",
        "all corrections are below one count of the drive",
        "check the unit of the values and `counts_per_unit`. If both are right, the table has no effect",
    ),
    RemarkEntry(
        "L8",
        "warning",
        "travel that the table does not cover, and what `hold` gives there",
        "measure the missing stretch, or set `outside`; the remark stays and shows your choice",
    ),
    RemarkEntry(
        "L9",
        "warning",
        "one column, or the whole table, is 0",
        "check whether the other column was measured, and whether this is the right file",
    ),
    RemarkEntry(
        "L10",
        "warning",
        "file name, AXIS line, comment and configured axis name different axes",
        "check that the file belongs to this axis",
    ),
    RemarkEntry(
        "L11",
        "refused",
        "positions are not in order (version 3)",
        "sort the rows by position",
    ),
    RemarkEntry(
        "L12",
        "error",
        "a correction above `max_correction` (0.5 mm, or 0.3 mm/m of travel or table where that is more)",
        "check unit and sign of the values. If the axis really is so far off, raise `max_correction`, "
        "then `pitch-gateway reload CONFIG`",
    ),
    RemarkEntry(
        "L13",
        "warning",
        "a distance between points differs from most others: a line lost, a position mistyped?",
        "look for a missing line or a mistyped position there",
    ),
    RemarkEntry(
        "L14",
        "warning",
        "the last two points at one end are beyond the travel: a line too many?",
        "look for a duplicate line, and check `travel`",
    ),
    RemarkEntry(
        "L15",
        "warning",
        "forward - backward at one point, or at two of up to 18, differs from the others (in a longer "
        "table: bends like a slip in L6): is one value a slip?",
        "check both values of the point. If the file matches the measurement, measure it again",
    ),
    RemarkEntry(
        "R1",
        "warning",
        "the line between the lists is missing",
        "check that the first half of the values is forward and the second backward, then add the line "
        "`; backward data`",
    ),
    RemarkEntry(
        "R2",
        "warning",
        "the start was inferred, because travel lies on both sides of 0",
        "check the positions with `pitch-gateway table show FILE`, and name the start with `file_start`",
    ),
    RemarkEntry(
        "R3",
        "warning",
        "an option that this format does not use",
        "remove it, or check that the file has the format that you mean",
    ),
    RemarkEntry(
        "R4",
        "warning",
        "the file holds another compensation too, which is not applied",
        "switch it off in the old control. If it is needed, move it into the table; then remove its "
        "lines from the file",
    ),
    RemarkEntry(
        "R7",
        "warning",
        "LinuxCNC itself stops reading before the last point",
        "correct the line after which LinuxCNC stops; it never used the points behind it",
    ),
    RemarkEntry(
        "R8",
        "warning",
        "the file has lost motion outside its table, and the axis has no `backlash`",
        "if the lost motion was corrected so far, give the axis a `backlash`",
    ),
    RemarkEntry(
        "R9",
        "refused",
        "the screw offset in Mint has two readings, and `file_start` does not choose",
        "find mark A of the screw on the machine, and set `file_start`. To prove it, send the axis to the "
        "target in the message with the compensation off: the nut is as far to one side of it as the right "
        "figure is to the other",
    ),
    RemarkEntry(
        "R10",
        "warning",
        "the file does not say how many values (Aerotech) or points (Weihong) it has",
        "compare the number of points with the original. Then add the comment in the message (Aerotech), "
        "or remove the line without a point (Weihong)",
    ),
    RemarkEntry(
        "R11",
        "warning",
        "the program that wrote the table leaves its compensation off",
        "ask why: the table may never have been in force. If it is the right one, switch the "
        "compensation on in the file (`PRECISIONMODE`, `I51`)",
    ),
    RemarkEntry(
        "R12",
        "info",
        "first forward and last backward value are both not 0, although TB058 asks for it; its own "
        "example breaks this rule",
        "nothing, if the table was measured so",
    ),
    RemarkEntry(
        "R13",
        "warning",
        "a PMAC table has non-zero entries beyond the travel",
        "check the length in the file, `file_counts_per_unit` and `travel`: one of them may be wrong",
    ),
    RemarkEntry(
        "R14",
        "info",
        "an option of the table has its old name",
        "use the new name with the same value. The old name remains accepted for its formats; `check` warns",
    ),
)
"""Every code keeps its meaning for ever."""
