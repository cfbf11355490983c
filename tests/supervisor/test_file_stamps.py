"""What is seen of table files from outside, on a real folder."""

import os
import shutil
from pathlib import Path

import pytest

from gateway.supervisor.debounce import FileStamp
from gateway.supervisor.file_stamps import ignore_broken_leases, scan

NAME = "x.tab"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / NAME).write_text("one")
    return tmp_path


def seen(folder: Path) -> FileStamp:
    return scan(folder, [NAME])[NAME]


def test_the_same_file_looks_the_same(folder: Path) -> None:
    assert seen(folder) == seen(folder)


def test_a_save_in_place_of_the_same_length_is_seen(folder: Path) -> None:
    before = seen(folder)
    times = (folder / NAME).stat()
    (folder / NAME).write_text("two")
    os.utime(folder / NAME, ns=(times.st_atime_ns, times.st_mtime_ns))  # as tools that keep times do
    assert seen(folder) != before


def test_a_file_renamed_over_it_is_seen(folder: Path) -> None:
    before = seen(folder)
    (folder / "new").write_text("two")
    (folder / "new").replace(folder / NAME)
    assert seen(folder) != before


def test_a_swapped_symlink_is_seen_as_kubernetes_does_it(tmp_path: Path) -> None:
    for version in ("..1", "..2"):
        (tmp_path / version).mkdir()
        (tmp_path / version / NAME).write_text(f"table {version}")
    (tmp_path / "..data").symlink_to("..1")
    (tmp_path / NAME).symlink_to(f"..data/{NAME}")
    before = seen(tmp_path)
    (tmp_path / "..data_tmp").symlink_to("..2")
    (tmp_path / "..data_tmp").replace(tmp_path / "..data")
    assert before.is_there
    assert seen(tmp_path).is_there
    assert seen(tmp_path) != before


def test_a_file_that_is_missing_or_renamed_to_bak_is_not_there(folder: Path) -> None:
    (folder / NAME).rename(folder / "x.bak")
    assert not seen(folder).is_there
    (folder / "x.bak").unlink()
    assert not seen(folder).is_there


def test_in_a_folder_that_vanished_nothing_is_gone(folder: Path) -> None:
    before = seen(folder)
    shutil.rmtree(folder)
    assert seen(folder).is_there
    assert seen(folder) != before


def test_a_symlink_loop_is_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / NAME).symlink_to(NAME)
    assert seen(tmp_path).is_there
    assert seen(tmp_path) == seen(tmp_path)


def test_a_file_that_a_program_has_open_for_writing_is_being_written(folder: Path) -> None:
    ignore_broken_leases()
    assert not seen(folder).is_being_written
    with (folder / NAME).open("a"):
        assert seen(folder).is_being_written
    with (folder / NAME).open():
        assert not seen(folder).is_being_written
    assert not seen(folder).is_being_written


def test_nothing_but_a_file_is_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / NAME)
    descriptor = os.open(tmp_path / NAME, os.O_RDWR | os.O_NONBLOCK)
    try:
        assert not seen(tmp_path).is_being_written
    finally:
        os.close(descriptor)
