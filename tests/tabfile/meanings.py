"""A second, careless reader for the samples of each dialect: plain sums, and no code of the real one."""

import itertools
import math
import re
from collections.abc import Sequence
from typing import Final

from gateway.compensation.units import Units
from tests.tabfile.mutants import Curve, Meaning, at

NUMBER: Final = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")


def _lines(text: str) -> list[str]:
    return [line.strip() for line in re.split("\r\n|\r|\n", text)]


def _both(units: Units, points: Sequence[tuple[float, float]]) -> Meaning:
    return Meaning(units, points, points)


def _two(units: Units, rows: Sequence[Sequence[float]], sign: float = 1.0) -> Meaning:
    """Position, forward and backward value of each row."""
    ascending = sorted(map(tuple, rows))
    return Meaning(units, [(x, sign * f) for x, f, _ in ascending], [(x, sign * b) for x, _, b in ascending])


def _columns(lines: Sequence[str], separator: str | None = None) -> list[list[float]]:
    return [[float(cell) for cell in line.split(separator)] for line in lines if line]


def centroid_v1(text: str) -> Meaning:
    """Home listed, 64000 counts per inch."""
    (_, total), *values = ([int(word) for word in line.split()] for line in _lines(text) if line)
    step = total / 64000 / (len(values) - 1)
    return _both(Units.INCH, sorted((i * step, value / 64000) for i, (value,) in enumerate(values)))


def centroid_v2(text: str) -> Meaning:
    """TB058: the table ends at 0."""
    lines = [line.split(";")[0].strip() for line in _lines(text)]
    size, step = int(lines[0].split()[1]) + 1, float(lines[0].split()[2])
    values = [float(line) / 10_000 for line in lines[1:] if line]
    places = [(i - size + 1) * step for i in range(size)]
    curves = (list(zip(places, part, strict=True)) for part in (values[:size], values[size:]))
    return Meaning(Units.INCH, *curves)


def centroid_v3(text: str) -> Meaning:
    """Home at the plus end: the second column is for the way down."""
    return _two(Units.INCH, [(x, up, down) for x, down, up in _columns(_lines(text)[5:])])


def csv_of_errors(text: str) -> Meaning:
    """Decimal commas, errors in micrometres."""
    lines = [line.replace(",", ".") for line in _lines(text) if not line.startswith("#")]
    return _two(Units.MM, _columns(lines[1:], ";"), -0.001)


def csv_of_corrections(text: str) -> Meaning:
    """Points and commas, mm."""
    return _two(Units.MM, _columns([line for line in _lines(text) if not line.startswith("#")][1:], ","))


def fanuc(text: str) -> Meaning:
    """1000 pulses per mm; a point owns the section that ends at it."""
    head, rows = _increments(text)
    reference, *_, magnification, interval = head
    return _summed({number - reference: value * magnification / 1000 for number, value in rows}, interval)


def mitsubishi(text: str) -> Meaning:
    """2000 values per mm; a point owns the section on its side towards the reference."""
    head, rows = _increments(text)
    reference, *_, magnification, interval = head
    sections = {
        number - reference + (number < reference): value * magnification / 2000
        for number, value in rows
        if number != reference
    }
    return _summed(sections, interval)


def _increments(text: str) -> tuple[list[float], list[list[float]]]:
    lines = [line for line in _lines(text) if line and not line.startswith("#")]
    return [float(line.split(",")[1]) for line in lines[:5]], _columns(lines[6:], ",")


def _summed(sections: dict[float, float], interval: float) -> Meaning:
    """Sections by the number of their upper end; 0 at the reference."""
    points = {0.0: 0.0}
    for end in sorted(n for n in sections if n > 0):
        points[end] = points[end - 1] + sections[end]
    for end in sorted((n for n in sections if n <= 0), reverse=True):
        points[end - 1] = points[end] - sections[end]
    return _both(Units.MM, sorted((n * interval, c) for n, c in points.items()))


def linuxcnc_0(text: str) -> Meaning:
    """Places where the nut stood."""
    rows = _columns([re.split("[#;]", line)[0] for line in _lines(text)])
    return _two(Units.MM, [(x, x - f, x - b) for x, f, b in rows])


def linuxcnc_1(text: str) -> Meaning:
    """Trims."""
    return _two(Units.MM, _columns([re.split("[#;]", line)[0] for line in _lines(text)]))


def isg(text: str) -> Meaning:
    """Unit 1: 0.1 µm."""
    bare = re.sub(r"/\*.*?\*/", " ", text, flags=re.DOTALL)
    facts = dict(line.split("#")[0].lower().split() for line in _lines(bare) if line.split("#")[0].strip())

    def at_point(index: int, name: str) -> float:
        return float(facts[f"kw.ssfk.table[{index}].{name}"]) / 10_000

    size, step, start = (float(facts[f"kw.ssfk.{name}"]) for name in ("kw_nr_max", "interval", "kw_startpos"))
    rows = []
    for index in range(int(size)):
        place = (start + index * step) / 10_000 if step else at_point(index, "setpoint")
        rows.append((place, at_point(index, "pos"), at_point(index, "neg")))
    return _two(Units.MM, rows, -1.0)


def fagor(text: str) -> Meaning:
    """Errors are actual - commanded; without a third field in both directions."""
    rows = []
    for line in _lines(text):
        if line:
            numbers = [
                float(sign.strip() + number)
                for sign, number in re.findall(r"[XYZ]\s*(-?)\s*([0-9.]+)", line, re.IGNORECASE)
            ]
            rows.append([*numbers, numbers[-1]][:3])
    if not any(backward for _, _, backward in rows):
        rows = [[x, forward, forward] for x, forward, _ in rows]
    return _two(Units.MM, rows, -1.0)


def fagor_8065(text: str) -> Meaning:
    """Errors are actual - commanded, in mm."""
    facts = dict(re.findall(r"/LSCRWDATA/(?:DATA/)?(\S+(?: \d+)?)\s*;(\S+)", text))
    ways = ("POSERROR", "NEGERROR" if facts["BIDIR"] == "1" else "POSERROR")
    rows = [
        [float(facts[f"{name} {number}"]) for name in ("POSITION", *ways)]
        for number in range(1, int(facts["NPOINTS"]) + 1)
    ]
    return _two(Units.MM, rows, -1.0)


def siemens(text: str) -> Meaning:
    """Errors of the measuring system, of axis X1."""
    text = "\n".join(re.sub(r"\s", "", line.split(";")[0]).upper() for line in _lines(text))
    facts = dict(re.findall(r"^\$AA_ENC_COMP(\w*\[[^]]*\])=([^\n]*)$", text, re.MULTILINE))
    low, step = (float(facts[f"_{name}[0,X1]"]) for name in ("MIN", "STEP"))
    size = sum(name.startswith("[") for name in facts)
    errors = [float(facts[f"[0,{index},X1]"].replace("EX", "E")) for index in range(size)]
    return _both(Units.MM, [(low + index * step, -error) for index, error in enumerate(errors)])


def siemens_cec(text: str) -> Meaning:
    """Table 0 forward, table 1 backward, of axis X1; values are commanded - actual."""
    text = "\n".join(re.sub(r"\s", "", line.split(";")[0]).upper() for line in _lines(text))
    facts = dict(re.findall(r"^\$AN_CEC(\w*\[[^]]*\])=([^\n]*)$", text, re.MULTILINE))
    low, step = (float(facts[f"_{name}[0]"]) for name in ("MIN", "STEP"))
    size = sum(name.startswith("[0,") for name in facts)
    values = [[float(facts[f"[{table},{index}]"]) for table in (0, 1)] for index in range(size)]
    return _two(Units.MM, [(low + index * step, *pair) for index, pair in enumerate(values)])


def weihong(text: str) -> Meaning:
    """Errors are actual - nominal; one axis."""
    rows = [line for line in _lines(text) if line and line[0] not in ";[u"]
    return _two(Units.MM, _columns(rows, ","), -1.0)


def carvera(text: str) -> Meaning:
    """Trapezia under multiplier - 1, less what lies between the first point and 0."""
    points = sorted((float(x), float(m)) for _, x, m in (line.split() for line in _lines(text) if line))
    sums = [0.0]
    for (x, m), (next_x, next_m) in itertools.pairwise(points):
        sums.append(sums[-1] + (next_x - x) * ((m + next_m) / 2 - 1))
    start, first = points[0]
    at_zero = -start * (first - 1)
    for (x, m), (next_x, next_m), total in zip(points, points[1:], sums, strict=False):
        if x <= 0:
            end = min(0.0, next_x)
            there = m + (end - x) / (next_x - x) * (next_m - m)
            at_zero = total + (end - x) * ((m + there) / 2 - 1)
    if points[-1][0] <= 0:
        at_zero = sums[-1] - points[-1][0] * (points[-1][1] - 1)
    return _both(Units.MM, [(x, total - at_zero) for (x, _), total in zip(points, sums, strict=True)])


def pmac(text: str) -> Meaning:
    """1000 counts per mm, a travel from -300 to 500; 1/16 counts, added."""
    lines = [re.split(";|//", line)[0].strip() for line in _lines(text)]
    index = next(i for i, line in enumerate(lines) if re.match(r"(?i)(#\d+\s*)?def(ine)?\s+comp\b", line))
    size, *_, length = map(int, re.sub(r"(?i).*comp|#\d+d?,", "", lines[index]).split(","))
    entries = [int(word) for word in " ".join(lines[index + 1 :]).split()[:size]]
    step = length / size / 1000
    steps = range(math.floor(-300 / step), math.ceil(500 / step) + 1)
    return _both(Units.MM, [(n * step, entries[(n - 1) % size] / 16_000) for n in steps])


def heidenhain(text: str) -> Meaning:
    """NR, AXISPOS, forward, backward; errors are actual - commanded."""
    lines = [line for line in _lines(text) if line]
    return _two(Units.MM, [row[1:] for row in _columns(lines[2:-1])], -1.0)


def heidenhain_wide(text: str) -> Meaning:
    """NR, AXISPOS and one more number, which begins below the Z; errors are actual - commanded, both ways."""
    lines = [line for line in _lines(text) if line]
    place = lines[1].upper().index("Z")
    return _both(Units.MM, [(float(line.split()[1]), -float(line[place:])) for line in lines[2:-1]])


def renishaw_ren(text: str) -> Meaning:
    """Number, position, forward, reverse; 1000 values per mm."""
    rows = [line for line in _lines(text) if re.match("[0-9]", line)]
    return _two(Units.MM, [(x, f / 1000, b / 1000) for _, x, f, b in _columns(rows)])


def aerotech(text: str) -> Meaning:
    """Thousandths of a mm, from -300 upwards."""
    step = float(re.findall("(?i)SAMPLEDIST=([^ \t\r\n]+)", text)[0])
    sign = -1 if re.search("(?i)NEGCOR", text) else 1
    rows = [line for line in _lines(text) if re.match("[-+.0-9]", line)]
    values = [sign * float(word) / 1000 for line in rows for word in line.split()]
    return _both(Units.MM, [(-300 + i * step, value) for i, value in enumerate(values)])


def mint(text: str) -> Meaning:
    """The motor stands at i x increment when the nut stands at entry i."""
    lines = [re.split(r":\s*REM", line, flags=re.IGNORECASE)[0] for line in _lines(text)]
    step = float(next(line for line in lines if "INCREMENT" in line.upper()).split("=")[1])
    offset = float(next(line for line in lines if "OFFSET" in line.upper()).split("=")[1])
    curves: list[Curve] = []
    for name in ("fwd", "rev"):
        line = next(line for line in lines if re.match(f"(?i)DIM {name}", line))
        entries = [0.0, *map(float, line.split("=")[1].split(","))]
        curves.append([(offset + entry, i * step - entry) for i, entry in enumerate(entries)])
    places = sorted({x for curve in curves for x, _ in curve})
    forward, backward = ([(x, at(curve, x)) for x in places] for curve in curves)
    return Meaning(Units.MM, forward, backward)
