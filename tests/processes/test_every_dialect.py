"""One gateway with an axis for each dialect of table files: each drive is told what its file says."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.tabfile import dialect_named
from tests.processes.saving import in_place
from tests.processes.workshop import Workshop, workshop_in
from tests.support.config import axis
from tests.tabfile.mutants import Sample
from tests.tabfile.samples import SAMPLES


def table_name(sample: Sample) -> str:
    return f"{sample.title}{dialect_named(sample.dialect).suffix}"


def axis_name(sample: Sample) -> str:
    return sample.title.replace("-", "_")


def axis_text(sample: Sample, unit_id: int) -> str:
    context = sample.context
    assert context.units is not None
    assert context.travel is not None
    return axis(
        axis_name(sample),
        unit_id=unit_id,
        units=context.units.value,
        counts_per_unit=sample.counts_per_unit,
        travel=context.travel,
        compensation="on",
        table=table_name(sample),
        table_options=sample.table_options,
    )


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workshop]:
    axes = [axis_text(sample, unit_id) for unit_id, sample in enumerate(SAMPLES, start=1)]
    tables = {table_name(sample): sample.data for sample in SAMPLES}
    with workshop_in(tmp_path_factory.mktemp("workshop"), axes, tables) as workshop:
        yield workshop


def table_of(workshop: Workshop, sample: Sample) -> Path:
    return workshop.tables / table_name(sample)


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda sample: sample.title)
def test_the_drive_is_told_what_the_file_says(workshop: Workshop, sample: Sample) -> None:
    assert sample.context.travel is not None
    with workshop.master(SAMPLES.index(sample) + 1) as master:
        master.move(round(sample.context.travel[1] * sample.counts_per_unit))
        assert sample.moves
        assert [(target, master.move(target)) for target, _ in sample.moves] == list(sample.moves)


def moved(workshop: Workshop) -> dict[str, tuple[int, int]]:
    """The first move of each axis: its target, and what the drive is told."""
    told = {}
    for sample in SAMPLES:
        assert sample.context.travel is not None
        with workshop.master(SAMPLES.index(sample) + 1) as master:
            master.move(round(sample.context.travel[1] * sample.counts_per_unit))
            target = sample.moves[0][0]
            told[sample.title] = (target, master.move(target))
    return told


def until_all(workshop: Workshop, event: str) -> list[dict[str, object]]:
    """Read the log until all axes had an event."""
    notes, missing = [], {axis_name(sample) for sample in SAMPLES}
    while missing:
        note = workshop.gateway.until(event)
        missing.discard(note["axis"])
        notes.append(note)
    return notes


def test_files_of_every_kind_are_switched_off_by_renaming_them_and_on_again(workshop: Workshop) -> None:
    corrected = {sample.title: sample.moves[0] for sample in SAMPLES}
    plain = {sample.title: (sample.moves[0][0],) * 2 for sample in SAMPLES}
    tables = [table_of(workshop, sample) for sample in SAMPLES]
    # in place of the suffix, where that gives each a name of its own, and behind it
    for backups in (
        [table.with_suffix(".bak") for table in tables],
        [table.with_name(f"{table.name}.BAK") for table in tables],
    ):
        for table, backup in zip(tables, backups, strict=True):
            table.rename(backup)
        until_all(workshop, "table-taken-away")
        assert moved(workshop) == plain
        for table, backup in zip(tables, backups, strict=True):
            backup.rename(table)
        until_all(workshop, "table-handed-over")
        assert moved(workshop) == corrected


def test_files_of_every_kind_that_turn_bad_leave_the_last_good_one_in_force(workshop: Workshop) -> None:
    corrected = {sample.title: sample.moves[0] for sample in SAMPLES}
    for sample in SAMPLES:
        in_place(table_of(workshop, sample), "no table at all")
    rejected = {note["axis"]: note["file"] for note in until_all(workshop, "table-rejected")}
    assert rejected == {axis_name(sample): str(table_of(workshop, sample)) for sample in SAMPLES}
    assert moved(workshop) == corrected
    for sample in SAMPLES:
        table_of(workshop, sample).write_bytes(sample.data)
    until_all(workshop, "table-mended")
    assert moved(workshop) == corrected
