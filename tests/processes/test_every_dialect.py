"""One gateway with an axis for each dialect of table files: each drive is told what its file says."""

import contextlib
import json
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from gateway.tabfile import dialect_named
from tests.ports import free_port
from tests.processes.bench import Drive, Master, Running, running, typed
from tests.processes.saving import in_place
from tests.tabfile.mutants import Sample
from tests.tabfile.samples import SAMPLES

HEAD = """[gateway]
name = "trial"

[http]
listen = ""

[line.all]
drives = {{ tcp = "127.0.0.1:{drives}" }}

[[line.all.controllers]]
name = "cnc"
tcp = "127.0.0.1:{port}"
"""
AXIS = """
[axis.{name}]
line = "all"
unit_id = {unit_id}
units = "{units}"
counts_per_unit = {counts_per_unit}
travel = {travel}
referenced = "absolute"
table = "{table}"
table_options = {{ {options} }}
registers.command = [{{ address = 100, type = "int32" }}]
"""


@dataclass(frozen=True, slots=True)
class Workshop:
    """A gateway that runs, its drives, and where its tables are."""

    gateway: Running
    drive: Drive
    port: int
    config: Path

    def table_of(self, sample: Sample) -> Path:
        return self.config.parent / "tables" / table_name(sample)

    @contextlib.contextmanager
    def master_of(self, sample: Sample) -> Iterator[Master]:
        master = Master(self.port, self.drive, SAMPLES.index(sample) + 1)
        try:
            yield master
        finally:
            master.close()


def table_name(sample: Sample) -> str:
    return f"{sample.dialect}{dialect_named(sample.dialect).suffix}"


def axis_name(sample: Sample) -> str:
    return sample.dialect.replace("-", "_")


def axis_text(sample: Sample, unit_id: int) -> str:
    context = sample.context
    assert context.units is not None
    assert context.travel is not None
    return AXIS.format(
        name=axis_name(sample),
        unit_id=unit_id,
        units=context.units.value,
        counts_per_unit=sample.counts_per_unit,
        travel=list(context.travel),
        table=table_name(sample),
        options=", ".join(f"{key} = {json.dumps(value)}" for key, value in sample.table_options.items()),
    )


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workshop]:
    folder = tmp_path_factory.mktemp("workshop")
    (folder / "tables").mkdir()
    port = free_port()
    with socket.create_server(("127.0.0.1", 0)) as listening:
        text = HEAD.format(drives=listening.getsockname()[1], port=port)
        for unit_id, sample in enumerate(SAMPLES, start=1):
            (folder / "tables" / table_name(sample)).write_bytes(sample.data)
            text += axis_text(sample, unit_id)
        config = folder / "gateway.toml"
        config.write_text(text)
        checked = typed("check", str(config))
        assert checked.returncode == 0, checked.stdout + checked.stderr
        drive = Drive(listening)
        with running("run", str(config)) as gateway:
            assert gateway.process.stderr is not None
            seen: set[str] = set()
            while not {"line-up", "relay-reached"} <= seen:
                line = gateway.process.stderr.readline()
                assert line
                if line.startswith("{"):  # before it come the warnings of the configuration
                    seen.add(json.loads(line)["event"])
            yield Workshop(gateway, drive, port, config)
            assert gateway.end() == 0


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda sample: sample.dialect)
def test_the_drive_is_told_what_the_file_says(workshop: Workshop, sample: Sample) -> None:
    assert sample.context.travel is not None
    with workshop.master_of(sample) as master:
        master.move(round(sample.context.travel[1] * sample.counts_per_unit))
        assert sample.moves
        assert [(target, master.move(target)) for target, _ in sample.moves] == list(sample.moves)


def moved(workshop: Workshop) -> dict[str, tuple[int, int]]:
    """The first move of each axis: its target, and what the drive is told."""
    told = {}
    for sample in SAMPLES:
        assert sample.context.travel is not None
        with workshop.master_of(sample) as master:
            master.move(round(sample.context.travel[1] * sample.counts_per_unit))
            target = sample.moves[0][0]
            told[sample.dialect] = (target, master.move(target))
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
    corrected = {sample.dialect: sample.moves[0] for sample in SAMPLES}
    plain = {sample.dialect: (sample.moves[0][0],) * 2 for sample in SAMPLES}
    tables = [workshop.table_of(sample) for sample in SAMPLES]
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
    corrected = {sample.dialect: sample.moves[0] for sample in SAMPLES}
    for sample in SAMPLES:
        in_place(workshop.table_of(sample), "no table at all")
    rejected = {note["axis"]: note["file"] for note in until_all(workshop, "table-rejected")}
    assert rejected == {axis_name(sample): str(workshop.table_of(sample)) for sample in SAMPLES}
    assert moved(workshop) == corrected
    for sample in SAMPLES:
        workshop.table_of(sample).write_bytes(sample.data)
    until_all(workshop, "table-mended")
    assert moved(workshop) == corrected
