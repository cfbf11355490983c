"""Tables of systems that are known by sight and not read: what they are, and how to bring them over.

Each is told by its own words on any line. What is missing of each is said, so that nobody has to guess it: a
sign that no manual states, a unit that is not in the file, or lines that no source at hand shows.
"""

import re
from dataclasses import dataclass
from typing import Final

from gateway.tabfile.text import SourceText

CSV: Final = "write it as CSV: position_mm,{} (the other units: pitch-gateway table formats)"
BOTH: Final = "error_um or correction_um"


@dataclass(frozen=True, slots=True)
class Stranger:
    """A kind of file that is known and not read."""

    title: str
    sign: re.Pattern[str]
    remedy: str


def _of(title: str, sign: str, remedy: str) -> Stranger:
    return Stranger(title, re.compile(sign, re.IGNORECASE | re.ASCII), remedy)


STRANGERS: Final = (
    _of(
        "a PMAC backlash table (DEFINE BLCOMP)",
        r"(#[0-9]+[ \t]*)?DEF(INE)?[ \t]+BLCOMP\b.*",
        "it belongs to a DEFINE COMP table: "
        + CSV.format("forward_um,backward_um")
        + "; an entry is 1/16 count, taken off in the negative direction only",
    ),
    _of(
        "a PMAC torque table (DEFINE TCOMP)",
        r"(#[0-9]+[ \t]*)?DEF(INE)?[ \t]+TCOMP\b.*",
        "it corrects torque and no position: take it out of the file; DEFINE COMP tables are read",
    ),
    _of(
        "a list of a Heidenhain display unit (ND)",
        r"[#*]?[ \t]*(ND[ -]?[0-9]{3}\b.*|(COMP\. ?NO\.|[A-Z][ \t]+NR\.)[ \t]*[0-9]+[ \t]*=.*)",
        "it corrects what a scale reads, spaced by a power of two from a datum; measure the axis, and "
        + CSV.format(BOTH),
    ),
    _of(
        "parameters of a Fanuc control (N... P...)",
        r"N[0-9]{4,5}[ \t]*([AQ][0-9]+[ \t]*)*P-?[0-9]+.*",
        "their numbers differ between series: put 3620 to 3624 and the points into format fanuc-csv",
    ),
    _of(
        "a COMP.ERR of PC-DMIS (Hexagon, STARTW)",
        r"START[A-Z]",
        "each line is what the scale reads = what the laser reads: "
        + CSV.format("error_mm")
        + "; position_degree,error_degree of a rotary table"
        + "; the error is the right number less the left one",
    ),
    _of(
        "a look-up table of ecmc (PREC=)",
        r"PREC[ \t]*=[ \t]*[0-9]+",
        "it holds position and correction of an encoder, in units of the axis; the program that uses it "
        "decides on the sign: " + CSV.format("correction_mm"),
    ),
    _of(
        "a screw map of Mach3 or Mach4",
        r".*\bscrew ?map.*",
        "its guide does not say which of expected and actual position is taken from the other: make one test "
        "move, and " + CSV.format(BOTH),
    ),
)


def stranger_of(source: SourceText) -> tuple[Stranger, int] | None:
    """Return which known kind of file a text is, and the line that shows it; None where it is like none."""
    for stranger in STRANGERS:
        for line in source.lines:
            if stranger.sign.fullmatch(line.text):
                return stranger, line.number
    return None
