"""What the system tells of a folder: each change once, and the end of the folder."""

import asyncio
import os
import select
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.supervisor import notices
from gateway.supervisor.watching import wake_on_change


@pytest.fixture
def queue_fd(tmp_path: Path) -> Iterator[int]:
    fd = notices.create()
    notices.add(fd, tmp_path)
    yield fd
    os.close(fd)


def is_told(fd: int) -> bool:
    return bool(select.select([fd], [], [], 0)[0])


def test_a_file_that_is_written_renamed_or_removed_is_told_of(queue_fd: int, tmp_path: Path) -> None:
    table, other = tmp_path / "x.tab", tmp_path / "y.tab"
    assert not is_told(queue_fd)
    for change in (lambda: table.write_text("1"), lambda: table.rename(other), other.unlink):
        change()
        assert is_told(queue_fd)
        assert notices.take(queue_fd)
        assert not is_told(queue_fd)


def test_to_look_at_files_is_no_change(queue_fd: int, tmp_path: Path) -> None:
    assert list(tmp_path.iterdir()) == []
    assert not is_told(queue_fd)


def test_after_a_folder_has_gone_nothing_more_is_told(tmp_path: Path) -> None:
    folder = tmp_path / "tables"
    folder.mkdir()
    fd = notices.create()
    try:
        notices.add(fd, folder)
        folder.rmdir()
        assert not notices.take(fd)
    finally:
        os.close(fd)


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    fd = notices.create()
    try:
        with pytest.raises(FileNotFoundError, match=str(tmp_path / "none")):
            notices.add(fd, tmp_path / "none")
    finally:
        os.close(fd)


def test_a_folder_that_was_replaced_is_followed_again(tmp_path: Path) -> None:
    async def follows() -> int:
        folder, woken, times = tmp_path / "tables", asyncio.Event(), 0
        folder.mkdir()
        waking = asyncio.create_task(wake_on_change(folder, woken.set, lambda _why: None))
        try:
            for _ in range(2):
                async with asyncio.timeout(30.0):
                    while not woken.is_set():
                        (folder / "x.tab").touch()
                        await asyncio.sleep(0)
                times += 1
                woken.clear()
                shutil.rmtree(folder)
                folder.mkdir()
        finally:
            waking.cancel()
            await asyncio.wait((waking,))
        return times

    assert asyncio.run(follows()) == 2
