"""What sample files of LinuxCNC, Mint and Siemens say, found without their readers."""

import re
from pathlib import Path
from typing import Final

Points = list[tuple[float, float]]
"""Positions, ascending, and what is added there."""

_TABLES: Final = Path(__file__).parents[2] / "tables"
LINUXCNC_0: Final = (_TABLES / "linuxcnc" / "screwcompX.dat").read_bytes().replace(b"-4.2 ", b"-4.002 ")
"""Without the slip of the published file, which is refused."""
LINUXCNC_1: Final = b"""\
-10  0.001 -0.001
 -8  0.001 -0.001
 -6  0.002 -0.001
 -4  0.002 -0.002
 -2  0.003 -0.002
  0  0.003 -0.002
"""
MINT: Final = b"""\
DIM fwd(5) = 10.02, 20.01, 30.00, 40.01, 50.01
PRECISIONTABLE(0, fwd)
PRECISIONINCREMENT.0 = 10
PRECISIONOFFSET.0 = -5
BACKLASH.0 = 0.01 ' taken up in 20 cycles
BACKLASHMODE.0 = 1
"""
"""One table: with two, the points of one direction are also points of the other."""
SIEMENS: Final = (_TABLES / "siemens" / "_N_AX_EEC_INI.ini").read_bytes()
_LINE_END: Final = re.compile("\r\n|\r|\n")


def _lines(text: str, marks: str) -> list[str]:
    bare = (re.split(f"[{marks}]", line)[0].strip() for line in _LINE_END.split(text))
    return [line for line in bare if line]


def linuxcnc_0(text: str) -> tuple[Points, Points]:
    """Nominal, and both actual positions: the difference is added."""
    rows = [tuple(map(float, line.split())) for line in _lines(text, "#;")]
    return [(x, x - up) for x, up, _ in rows], [(x, x - down) for x, _, down in rows]


def linuxcnc_1(text: str) -> tuple[Points, Points]:
    """Nominal, and both amounts to add."""
    rows = [tuple(map(float, line.split())) for line in _lines(text, "#;")]
    return [(x, up) for x, up, _ in rows], [(x, down) for x, _, down in rows]


def mint(text: str) -> tuple[Points, Points]:
    """One table: entry i is where the nut is when the motor is i increments from mark A."""
    text = "\n".join(_lines(text, "'"))
    (listed,) = re.findall(r"(?im)^DIM\s+fwd\s*\(\s*\d+\s*\)\s*=\s*(.*[0-9.])", text)
    increment, start = (
        float(re.findall(rf"(?i)PRECISION{word}\D+0\D*?=\s*([-+0-9.eE]+)", text)[0])
        for word in ("INCREMENT", "OFFSET")
    )
    entries = [float(entry) for entry in listed.split(",")]
    points = [(start, 0.0), *((start + x, i * increment - x) for i, x in enumerate(entries, start=1))]
    return points, points


def siemens(text: str) -> tuple[Points, Points]:
    """Errors of the measuring system: subtracted."""
    errors: dict[int, float] = {}
    facts: dict[str, float] = {}
    for line in _lines(text, ";"):
        found = re.fullmatch(r"\$AA_ENC_COMP(\w*)\[0,(?:(\d+),)?X1\]=(\S+)", re.sub(r"\s", "", line).upper())
        if found is not None and found[1]:
            facts[found[1]] = float(found[3].replace("EX", "E"))
        elif found is not None:
            errors[int(found[2])] = float(found[3].replace("EX", "E"))
    points = [(facts["_MIN"] + n * facts["_STEP"], -errors[n]) for n in range(len(errors))]
    return points, points
