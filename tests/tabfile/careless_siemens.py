"""What the Siemens sample says, found without its reader."""

import re
from pathlib import Path
from typing import Final

Points = list[tuple[float, float]]
"""Positions, ascending, and what is added there."""

_TABLES: Final = Path(__file__).parents[2] / "tables"
SIEMENS: Final = (_TABLES / "siemens" / "_N_AX_EEC_INI.ini").read_bytes()
_LINE_END: Final = re.compile("\r\n|\r|\n")


def _lines(text: str, marks: str) -> list[str]:
    bare = (re.split(f"[{marks}]", line)[0].strip() for line in _LINE_END.split(text))
    return [line for line in bare if line]


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
