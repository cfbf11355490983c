"""What a remark about a table means: signs of a mistake (L), and what a reader had to take on trust (R)."""

from typing import Final

from gateway.catalogue.entry import RemarkEntry

REMARKS: Final = (
    RemarkEntry(
        "L1",
        "error",
        "the correction changes faster than `max_slope` (0.01) allows; at 1 no table at all, it could not"
        " be inverted",
        "look for a value with the wrong sign, unit or place; raise `max_slope` only where the screw "
        "really is so steep",
    ),
    RemarkEntry(
        "L2",
        "warning",
        "forward - backward is negative at most points, and on average; lost motion makes it positive: "
        "columns swapped?",
        "compare with the file of the instrument: which column is forward? "
        "`pitch-gateway signtest CONFIG --axis AXIS` proves it at the machine",
    ),
    RemarkEntry(
        "L3",
        "warning",
        "forward - backward would be less than half as rough with the backward list turned round: logged "
        "from the other end? Silent where the list ends with 0 at home, as it must, and turned round would "
        "not",
        "look up from which end the backward list was logged, and turn it round where it was the other end",
    ),
    RemarkEntry(
        "L4",
        "warning, but `lint` fails",
        "unit slip: a value below 0.001 among values of 0.1 and more; version 2 values all below 0.01; "
        "version 3 values above 0.1 inch or 0.5 mm, on an axis longer than 1.67 m in proportion",
        "write all values in the unit that the file states; where it states none, name it with `file_units` "
        "of `table_options`",
    ),
    RemarkEntry(
        "L5",
        "warning",
        "not 0 at home: first forward value if the table begins there, last backward if it ends there, "
        "else forward at 0",
        "subtract the value at home from all values, so that it is 0 there; `--home` of `table build` does "
        "it. Do not only write 0 at home: that leaves a step",
    ),
    RemarkEntry(
        "L6",
        "warning",
        "a point bends the curve more than 8 times as much as the median (and by more than 1 µm); it is "
        "left out, and the others are judged again. Up to 18 points that lie about evenly: without it, or"
        " without two, the others bend at most a quarter as much (and it bends by more than 3 µm). The value "
        "at home that is 0 by definition is never named",
        "look at this line of the file; measure the point once more where the file is as it was measured",
    ),
    RemarkEntry(
        "L7",
        "warning",
        "all corrections are below one count of the drive",
        "check the unit of the values and `counts_per_unit`; with both right the table changes nothing",
    ),
    RemarkEntry(
        "L8",
        "warning",
        "travel that the table does not cover, and what `hold` gives there",
        "measure the missing stretch, or say with `outside` what holds there: the remark stays, and says "
        "what you chose",
    ),
    RemarkEntry(
        "L9",
        "warning",
        "one column, or all of the table, is 0",
        "look whether the other column was measured at all, and whether the file is the right one",
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
        "positions that do not run one way (version 3)",
        "put the rows in the order of their positions",
    ),
    RemarkEntry(
        "L12",
        "error",
        "a correction above `max_correction` (0.5 mm, or 0.3 mm/m of travel or table where that is more)",
        "check the unit of the values and their sign; raise `max_correction` where the axis really is so "
        "far off, then `pitch-gateway reload CONFIG`",
    ),
    RemarkEntry(
        "L13",
        "warning",
        "a distance between points that differs from most others: a line lost, a position mistyped?",
        "look for a missing line or a mistyped position at these points",
    ),
    RemarkEntry(
        "L14",
        "warning",
        "the last two points at one end lie beyond the travel: a line too many?",
        "look for a line that stands there twice, and check `travel`",
    ),
    RemarkEntry(
        "L15",
        "warning",
        "forward - backward at one point, or at two of up to 18, is not like that at the others (in a "
        "longer table: bends as a slip in L6 does): one of both is a slip?",
        "look at both values of the point; measure it once more where the file is as it was measured",
    ),
    RemarkEntry(
        "R1",
        "warning",
        "the line between the lists is missing",
        "check that the first half of the values is forward and the second backward; add the line `; "
        "backward data`",
    ),
    RemarkEntry(
        "R2",
        "warning",
        "the start was inferred from travel on both sides of 0",
        "check the positions with `pitch-gateway table show FILE`, and name the start with `file_start`",
    ),
    RemarkEntry(
        "R3",
        "warning",
        "something was told that the format has no use for",
        "leave it out, or check that the file is of the format that you mean",
    ),
    RemarkEntry(
        "R4",
        "warning",
        "the file holds another compensation too, which nothing applies",
        "switch the other compensation off in the old control; move what it corrects into the table where"
        " it is needed, and take its lines out of the file",
    ),
    RemarkEntry(
        "R7",
        "warning",
        "LinuxCNC itself would have stopped reading before the last point",
        "mend the line after which LinuxCNC stops; the points behind it were never in force there",
    ),
    RemarkEntry(
        "R8",
        "warning",
        "the file states lost motion that is not in its table, and the axis has no `backlash`",
        "give the axis a `backlash` where the lost motion was corrected so far",
    ),
    RemarkEntry(
        "R9",
        "refused",
        "Mint's offset of the screw has two readings, and `file_start` does not say which",
        "look where mark A of the screw is on the machine and tell it with `file_start`; to prove it, send "
        "the axis to the target of the message with the compensation off: the nut stands as far to one side "
        "of it as the right figure lies to the other",
    ),
    RemarkEntry(
        "R10",
        "warning",
        "nothing in the file says how many values it should have (Aerotech), or how many points (Weihong)",
        "compare the number of points with the original; then add the comment of the message (Aerotech), or "
        "take the line without a point out (Weihong)",
    ),
    RemarkEntry(
        "R11",
        "warning",
        "the program that the table comes from leaves its compensation off",
        "ask why: the table may never have been in force. Where it is the right one, switch the compensation "
        "on in the file (`PRECISIONMODE`, `I51`)",
    ),
    RemarkEntry(
        "R12",
        "info",
        "first forward and last backward value are both not 0, which TB058 asks for; its own example breaks "
        "it",
        "nothing has to be done where the table was measured so",
    ),
    RemarkEntry(
        "R13",
        "warning",
        "a PMAC table has entries other than 0 where the travel never gets",
        "check the length in the file, `file_counts_per_unit` and `travel`: one of them may be wrong",
    ),
    RemarkEntry(
        "R14",
        "info",
        "an option of the table is told under its old name",
        "write the new name, with the same value; `check` warns until then. The old name stays accepted, for "
        "the formats that it was for",
    ),
)
"""Every code keeps its meaning for ever."""
