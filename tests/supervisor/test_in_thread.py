"""Work in a thread of its own: what comes of it, and who waits for it."""

import asyncio
import threading

import pytest

from gateway.supervisor.in_thread import in_thread


def test_what_comes_of_it_is_returned_or_raised() -> None:
    assert asyncio.run(in_thread(lambda: 3)) == 3
    with pytest.raises(ZeroDivisionError):
        asyncio.run(in_thread(lambda: 1 // 0))


def test_who_is_cancelled_does_not_wait_for_what_never_returns() -> None:
    begun, never = threading.Event(), threading.Event()

    def hang() -> None:
        begun.set()
        never.wait()

    async def cancelled() -> None:
        hanging = asyncio.create_task(in_thread(hang))
        await asyncio.to_thread(begun.wait)
        hanging.cancel()
        with pytest.raises(asyncio.CancelledError):
            await hanging

    asyncio.run(cancelled())
    assert not never.is_set()
    never.set()


def test_what_is_nearly_done_is_finished_before_the_loop_ends() -> None:
    begun, may_end = threading.Event(), threading.Event()
    finished: list[bool] = []

    def slow() -> None:
        begun.set()
        may_end.wait()
        finished.append(True)

    async def cancelled() -> None:
        working = asyncio.create_task(in_thread(slow))
        await asyncio.to_thread(begun.wait)
        working.cancel()
        await asyncio.sleep(0)
        may_end.set()
        with pytest.raises(asyncio.CancelledError):
            await working

    asyncio.run(cancelled())
    assert finished == [True]
