"""The samples of the CSV dialects, Aerotech and Renishaw: a second reader and hand-worked moves agree."""

import pytest

from gateway.tabfile import LoadedTable, explain, read_table
from tests.tabfile.samples_csv import CSV_SAMPLES, CsvSample

COUNTS_PER_MM = 10_000.0


def read(sample: CsvSample) -> LoadedTable:
    return read_table(sample.path, sample.context)


@pytest.mark.parametrize("sample", CSV_SAMPLES, ids=lambda sample: sample.dialect)
def test_a_second_reader_finds_the_same(sample: CsvSample) -> None:
    loaded = read(sample)
    assert loaded.format == sample.dialect
    forward, backward = sample.read(sample.path.read_text())
    for points, curve in ((forward, loaded.table.forward), (backward, loaded.table.backward)):
        assert [place for place, _ in points] == pytest.approx(list(loaded.table.positions), abs=1e-9)
        assert [added for _, added in points] == pytest.approx(list(curve), abs=1e-12)


@pytest.mark.parametrize("sample", CSV_SAMPLES, ids=lambda sample: sample.dialect)
def test_moves_worked_out_by_hand(sample: CsvSample) -> None:
    loaded = read(sample)
    assert sample.context.travel is not None
    before = sample.context.travel[1]
    assert sample.moves
    for target, told in sample.moves:
        explained = explain(loaded, target / COUNTS_PER_MM, COUNTS_PER_MM)
        branch = explained.forward if target / COUNTS_PER_MM > before else explained.backward
        assert branch.counts == told
        before = target / COUNTS_PER_MM


@pytest.mark.parametrize("sample", CSV_SAMPLES, ids=lambda sample: sample.dialect)
def test_samples_are_sound(sample: CsvSample) -> None:
    assert read(sample).lints == ()
