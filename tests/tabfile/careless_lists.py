"""What the sample files of ISG, Fagor and Heidenhain say, found without their readers by plain sums."""

import re

Points = list[tuple[float, float]]
"""Positions, ascending, and what is added there."""


def isg(text: str) -> tuple[Points, Points]:
    """A list in 0.1 µm with setpoints; an error is subtracted."""
    bare = re.sub(r"(?s)(?<!\S)/\*.*?\*/|(?<!\S)#[^\r\n]*", " ", text)
    entries = re.findall(r"(?i)(kw\.\S+)\s+([-+.\de]+)", bare)
    found = {key.lower(): float(value) for key, value in entries}
    assert (found["kw.ssfk.unit"], found["kw.ssfk.interval"], found["kw.ssfk.bilateral"]) == (1, 0, 1)
    size = int(found["kw.ssfk.kw_nr_max"])
    table = {
        name: [found[f"kw.ssfk.table[{i}].{name}"] / 1e4 for i in range(size)]
        for name in ("setpoint", "pos", "neg")
    }
    up, down = ([-error for error in table[name]] for name in ("pos", "neg"))
    return list(zip(table["setpoint"], up, strict=True)), list(zip(table["setpoint"], down, strict=True))


def fagor(text: str) -> tuple[Points, Points]:
    """Lines of two fields, or of three; an error is subtracted."""
    up: Points = []
    down: Points = []
    for line in text.splitlines():
        if line.strip():
            place, *errors = (
                float(number.replace(" ", "")) for number in re.findall(r"-?[ \t]*[.\d]+", line)[1:]
            )
            up.append((place, -errors[0]))
            down.append((place, -errors[-1]))
    return up, up if not any(error for _, error in down) else down


def heidenhain(text: str) -> tuple[Points, Points]:
    """Columns NR, AXISPOS, one axis and BACKLASH; an error is subtracted."""
    rows = [[float(field) for field in line.split()] for line in text.strip().splitlines()[2:-1]]
    return [(x, -error) for _, x, error, _ in rows], [(x, -error) for _, x, _, error in rows]
