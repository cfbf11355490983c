"""Files of readings with one byte, line or number changed: an error, a remark, or what the change says.

Never silently other readings: where a mutant is read without an error and without a new remark, it is the
same readings, or one reading of them differs, at the same target, run and direction, in what was measured.
"""

from collections.abc import Iterator
from random import Random

import pytest

from gateway.metrology.formats import parse_survey
from gateway.metrology.readings import Reading, Survey
from gateway.tabfile import TabFileError
from tests.metrology.samples import POS, RTL, TB058_MANUAL
from tests.soak import repeated

MUTANTS = repeated(10_000)
CSV = "# axis: x\ntarget_mm,direction,run,measured_mm\n" + "".join(
    f"{x},{way},{run},{x + 0.001 * run + (0.01 if way == 'backward' else 0):.4f}\n"
    for run in (1, 2)
    for way, stops in (("forward", (0, 25, 50, 75)), ("backward", (75, 50, 25, 0)))
    for x in stops
)
SAMPLES = {"iso-csv": CSV, "manual": TB058_MANUAL, "renishaw-rtl": RTL, "api-pos": POS}


def mutants(text: str, random: Random, count: int) -> Iterator[str]:
    lines = text.splitlines(keepends=True)
    for _ in range(count):
        kind = random.randrange(6)
        at = random.randrange(len(lines))
        changed = list(lines)
        if kind == 0:
            del changed[at]
        elif kind == 1:
            changed.insert(at, lines[at])
        elif kind == 2:
            other = random.randrange(len(lines))
            # Where the order is all that tells a direction, two lines of one place, one of each way, are as
            # good a table when they change places. No reader can know.
            if text in {TB058_MANUAL, POS} and place_of(lines[at]) == place_of(lines[other]):
                continue
            changed[at], changed[other] = lines[other], lines[at]
        elif kind == 3:
            place = random.randrange(len(text))
            yield text[:place] + random.choice("0123456789.,;-+ \tex:#\n") + text[place + 1 :]
            continue
        elif kind == 4:
            place = random.randrange(len(text))
            yield text[:place] + text[place + 1 :]
            continue
        else:
            cells = lines[at].split(",")
            cell = random.randrange(len(cells))
            cells[cell] = random.choice(["0", "25", "-1", "1e9", "nan", "2.5", "forward", "backward", ""])
            changed[at] = ",".join(cells) if cell < len(cells) - 1 else ",".join(cells) + "\n"
        yield "".join(changed)


def place_of(line: str) -> str:
    return line.replace(",", " ").split(maxsplit=1)[0] if line.strip() else ""


def said(survey: Survey) -> set[str]:
    """Remarks without the numbers of their lines, which every inserted line moves."""
    return {remark.split(": ", 1)[1] for remark in survey.remarks}


def is_honest(base: Survey, found: Survey) -> bool:
    """Whether ``found`` is ``base``, or differs in one number measured, or in what a remark names."""
    if found.units is not base.units or said(found) - said(base):
        return found.units is base.units
    ours, theirs = sorted(base.readings, key=str), sorted(found.readings, key=str)
    lost = [reading for reading in ours if reading not in theirs]
    new = [reading for reading in theirs if reading not in ours]
    if not lost and not new:
        return True
    if len(lost) == len(new) == 1:
        one, two = lost[0], new[0]
        return (one.target, one.direction, one.run) == (two.target, two.direction, two.run)
    return is_one_target_moved(lost, new)


def is_one_target_moved(lost: list[Reading], new: list[Reading]) -> bool:
    """Whether one target of a file that lists them apart is another now, with the deviations as they were."""
    one, two = (
        sorted((str(reading.direction), reading.run, round(reading.deviation, 9)) for reading in readings)
        for readings in (lost, new)
    )
    return one == two and len({r.target for r in lost}) == len({r.target for r in new}) == 1


@pytest.mark.parametrize("name", SAMPLES)
def test_a_mutant_is_refused_named_or_means_what_it_says(name: str) -> None:
    text = SAMPLES[name]
    base = parse_survey(text.encode(), "file")
    read = 0
    for mutant in mutants(text, Random(58), MUTANTS):
        try:
            found = parse_survey(mutant.encode(), "file")
        except TabFileError:
            continue
        read += 1
        assert is_honest(base, found), mutant
    assert 0 < read < MUTANTS
