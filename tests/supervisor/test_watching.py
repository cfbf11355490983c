"""The watch over the tables folder: what it lets be read, and when it looks again."""

import asyncio
import time
from pathlib import Path

import pytest

from gateway.supervisor.file_stamps import scan
from gateway.supervisor.watching import Watch

NAMES = {"x": "x.tab"}


async def test_following_the_same_files_again_does_not_cut_the_rest_short(tmp_path: Path) -> None:
    watch = Watch()
    watch.follow(tmp_path, NAMES)
    await watch.rest()  # woken once, by the files that are new
    watch.follow(tmp_path, NAMES)
    resting = asyncio.create_task(watch.rest())
    for _ in range(5):
        await asyncio.sleep(0)
    is_resting = not resting.done()
    resting.cancel()
    assert is_resting


@pytest.mark.parametrize("turns", range(6))
async def test_a_rest_that_is_woken_and_ended_at_once_ends(turns: int) -> None:
    """``asyncio.wait_for`` of Python 3.11 loses a cancellation that comes with what it waits for."""
    watch = Watch()

    async def go_on() -> None:
        while True:
            await watch.rest()

    resting = asyncio.create_task(go_on())
    for _ in range(5):
        await asyncio.sleep(0)
    watch.wake()
    for _ in range(turns):
        await asyncio.sleep(0)
    resting.cancel()
    for _ in range(10):
        await asyncio.sleep(0)
    assert resting.done()


async def test_a_file_counts_as_it_was_seen_once_it_was_taken(tmp_path: Path) -> None:
    (tmp_path / "x.tab").write_text("one")
    watch = Watch()
    watch.follow(tmp_path, NAMES)
    assert watch.still == {}
    await watch.scan()
    assert watch.still == {"x.tab": None}
    began_s = time.monotonic()
    seen = scan(tmp_path, ["x.tab"])
    watch.take(seen, began_s=began_s)
    assert watch.still == seen
    watch.take({}, waiting={"x"}, began_s=began_s)
    assert watch.moving == {"x"}


async def test_a_file_that_was_read_since_the_last_look_does_not_move(tmp_path: Path) -> None:
    table = tmp_path / "x.tab"
    table.write_text("one")
    watch = Watch()
    watch.follow(tmp_path, NAMES)
    await watch.scan()
    watch.take(scan(tmp_path, ["x.tab"]), began_s=time.monotonic())
    table.write_text("another")
    began_s = time.monotonic()
    seen = scan(tmp_path, ["x.tab"])  # as a reload that somebody asks for does
    watch.take(seen, began_s=began_s)
    assert watch.moving == frozenset()
    assert watch.still == seen


async def test_a_file_that_changed_while_it_was_read_moves(tmp_path: Path) -> None:
    table = tmp_path / "x.tab"
    table.write_text("one")
    watch = Watch()
    watch.follow(tmp_path, NAMES)
    began_s = time.monotonic()
    seen = scan(tmp_path, ["x.tab"])
    table.write_text("another")
    await watch.scan()
    watch.take(seen, began_s=began_s)
    assert watch.moving == {"x"}


async def test_what_was_seen_in_another_folder_says_nothing(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "x.tab").write_text("one")
    watch = Watch()
    watch.follow(tmp_path, NAMES)
    await watch.scan()
    watch.follow(tmp_path / "other", NAMES)
    assert (dict(watch.still), dict(watch.stamps)) == ({}, {})
