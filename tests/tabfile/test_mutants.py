"""Damaged copies of a file of each dialect, 10 000 in `make soak`: an error, or no other table in silence."""

from collections import Counter
from dataclasses import replace

import pytest

from gateway.tabfile import DIALECTS, parse_table
from tests.soak import repeated
from tests.tabfile.mutants import Judge, Meaning, Mutant, Sample, meaning_of, mutants
from tests.tabfile.samples import SAMPLES

COUNT = repeated(10_000)


def names(sample: Sample) -> str:
    return sample.title


@pytest.mark.parametrize("sample", SAMPLES, ids=names)
def test_no_damaged_copy_is_read_as_another_table_in_silence(sample: Sample) -> None:
    judge = Judge(sample)
    ends: Counter[str] = Counter()
    for mutant in mutants(sample.data, f"1 {sample.title}", COUNT):
        end = judge.judge(mutant)
        assert not end.startswith("silent"), f"{mutant.what}: {end}"
        ends[end] += 1
    # most damage is an error; some is a comment or a last digit
    assert ends["error"] > COUNT // 4, ends


@pytest.mark.parametrize("sample", SAMPLES, ids=names)
def test_the_sample_is_what_the_second_reader_says(sample: Sample) -> None:
    judge = Judge(sample)
    meaning, read = sample.meaning(sample.data.decode()), meaning_of(judge.sound)
    assert meaning.units is read.units
    for ours, theirs in ((meaning.forward, read.forward), (meaning.backward, read.backward)):
        assert [x for x, _ in ours] == pytest.approx([x for x, _ in theirs], abs=1e-9)
        assert [c for _, c in ours] == pytest.approx([c for _, c in theirs], abs=1e-12)


def test_every_dialect_has_a_sample() -> None:
    assert {sample.dialect for sample in SAMPLES} == {dialect.name for dialect in DIALECTS}


def test_the_judge_sees_what_is_silent() -> None:
    sample = next(sample for sample in SAMPLES if sample.dialect == "centroid-3")
    judge = Judge(sample)
    other = sample.data.replace(b"+0.00013000", b"+0.00019000")
    assert judge.judge(Mutant(other, "a digit")) == "said"
    lines = sample.data.split(b"\n")
    # the reader believes a smaller ENTRIES without the last point; that -4 is not covered is said
    shorter = b"\n".join([*lines[:4], b"ENTRIES 8", *lines[5:-2], b""])
    assert judge.judge(Mutant(shorter, "a point less")) == "remark"
    without_travel = Judge(replace(sample, context=replace(sample.context, travel=None)))
    assert without_travel.judge(Mutant(shorter, "a point less")).startswith("silent: lines 5 to 14 came")
    # a change that reaches further than its own line, and one that the second reader understands otherwise
    elsewhere = Judge(replace(sample, data=other))
    elsewhere.lines = [*judge.lines[:9], "a line that changed", *elsewhere.lines[10:]]
    assert elsewhere.judge(Mutant(sample.data, "digits")).startswith("silent")
    wrong = Judge(replace(sample, meaning=lambda text: sample.meaning(text.replace("13000", "19000"))))
    assert wrong.judge(Mutant(sample.data.replace(b"00014", b"00015"), "a digit")).startswith("silent")


def test_the_judge_sees_a_reader_to_which_a_number_does_not_count() -> None:
    sample = next(sample for sample in SAMPLES if sample.dialect == "fanuc-csv")
    judge = Judge(sample)
    moved = Mutant(sample.data.replace(b"3620,40", b"3620,41"), "a digit")
    # what a reader without an eye for 3620 makes of it is what the sound file says
    blind = Judge(sample)
    blind.sound = parse_table(moved.data, sample.name, sample.context)
    assert judge.judge(moved) != "equal"
    assert blind.judge(Mutant(sample.data.replace(b"3620,40", b"3620, 41"), "a digit")) == "equal"
    blind.sample = replace(sample, meaning=lambda text: sample.meaning(text.replace("3620,41", "3620,40")))
    assert blind.judge(moved).startswith("silent: equal to a text")


def test_the_judge_sees_a_reader_that_stops_at_a_damaged_line() -> None:
    sample = next(sample for sample in SAMPLES if sample.dialect == "linuxcnc-1")
    # the last point becomes a comment, and a remark says that its travel is not covered
    shorter = Mutant(sample.data.replace(b" 10 0.001", b"#10 0.001"), "a byte")
    assert Judge(sample).judge(shorter) == "remark"

    def strict(text: str) -> Meaning:
        return sample.meaning(text.replace("#", "x"))

    assert Judge(replace(sample, meaning=strict)).judge(shorter).endswith("are not read as they stand")
