"""The listeners: where they are, what happens when they cannot be, and how they come and go."""

import asyncio
import contextlib
import logging
import signal
import socket
from pathlib import Path

import pytest

from gateway.config.http_model import HttpSection
from gateway.ipc.address import SUPERVISOR_SOCKET_NAME, SocketFile
from gateway.status.model import HttpStatus
from gateway.supervisor.broadcast import Broadcast
from gateway.supervisor.http import service as service_module
from gateway.supervisor.http.documents import Window
from tests.supervisor.http.http_bench import EVENTS, Served, serving, until
from tests.support.ports import free_port
from tests.support.status_models import model_of


async def test_a_port_that_is_taken_is_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service_module, "FIRST_WAIT_S", 0.001)
    async with serving(tmp_path) as served:
        with socket.create_server(("127.0.0.1", 0)) as taken:
            address = f"127.0.0.1:{taken.getsockname()[1]}"
            served.said.clear()
            served.service.configure(HttpSection(listen=address), "mill-1", Path())
            for _ in range(5):  # meanwhile it is tried a few times, and said once
                assert (await served.ask("/metrics", is_local=True)).status == 200
            await until(lambda: bool(served.said))
            problem = f"{address}: Address already in use"
            assert served.said == [
                (
                    "http-not-open",
                    {
                        "listen": address,
                        "detail": f"{problem}; the gateway tries again, and everything else continues",
                    },
                )
            ]
            assert served.service.status == HttpStatus(listen=address, problem=problem)
            served.said.clear()
        await until(lambda: bool(served.said))
        assert served.said == [("http-ready", {"address": f"http://{address}"})]
        assert served.service.status == HttpStatus(listen=address, address=f"http://{address}")


async def test_a_host_that_does_not_exist_is_a_problem(served: Served) -> None:
    served.said.clear()
    served.service.configure(HttpSection(listen="nowhere.invalid:8480"), "mill-1", Path())
    await until(lambda: bool(served.said))
    assert served.said[0][0] == "http-not-open"
    assert str(served.service.status.problem).startswith("nowhere.invalid:8480: ")


async def test_another_address_in_the_configuration_is_taken_over(served: Served) -> None:
    reader = await served.says(EVENTS)
    await reader.until(b"retry: 2000\n\n")
    old, served.port = served.port, free_port()
    served.service.configure(HttpSection(listen=f"[::1]:{served.port}"), "mill-1", Path())
    await until(lambda: len(served.said) == 2)
    assert served.said[1] == ("http-ready", {"address": f"http://[::1]:{served.port}"})
    await reader.rest()  # it is closed: whoever reads comes back where the gateway is now
    with pytest.raises(ConnectionRefusedError):
        await asyncio.open_connection("127.0.0.1", old)
    _, writer = await asyncio.open_connection("::1", served.port)
    writer.transport.abort()
    served.service.configure(HttpSection(listen=""), "mill-1", Path())
    await until(lambda: served.service.status.address is None)
    assert served.service.status == HttpStatus()
    with pytest.raises(ConnectionRefusedError):
        await asyncio.open_connection("::1", served.port)
    assert (await served.ask("/metrics", is_local=True)).status == 200


@pytest.mark.parametrize("turns", range(5))
async def test_who_connected_just_before_the_end_is_not_left_hanging(served: Served, turns: int) -> None:
    with socket.create_connection(("127.0.0.1", served.port), timeout=30) as there:
        for _ in range(turns):
            await asyncio.sleep(0)
        served.service.configure(HttpSection(listen=""), "mill-1", Path())
        with contextlib.suppress(ConnectionError):
            there.sendall(b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n")
            while await asyncio.get_running_loop().run_in_executor(None, there.recv, 65536):
                pass


async def test_what_stays_the_same_disturbs_nobody(served: Served) -> None:
    line = await served.connect()
    served.service.configure(HttpSection(listen=f"127.0.0.1:{served.port}"), "mill-1", Path())
    await line.say("GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n")
    assert (await line.hear()).status == 200
    assert len(served.said) == 1


async def test_the_end_waits_for_nobody_and_leaves_nothing(tmp_path: Path) -> None:
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    async with serving(tmp_path) as served:
        assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before
        for is_local in (False, True):
            reader = await served.says(EVENTS, is_local=is_local)
            await reader.until(b"retry: 2000\n\n")
    assert served.broadcast._subscribers == set()
    assert not served.local.exists()
    with pytest.raises(ConnectionRefusedError):
        await asyncio.open_connection("127.0.0.1", served.port)


async def test_a_socket_that_was_left_behind_is_replaced(tmp_path: Path) -> None:
    left = socket.socket(socket.AF_UNIX)
    left.bind(str(tmp_path / SUPERVISOR_SOCKET_NAME))
    left.close()
    async with serving(tmp_path) as served:
        assert (await served.ask("/metrics", is_local=True)).status == 200


async def test_a_local_socket_that_cannot_be_is_a_problem_and_no_end(tmp_path: Path) -> None:
    said: list[str] = []
    state = tmp_path / ("s" * 100)
    window = Window(
        Broadcast(),
        state,
        lambda axis: None,
        lambda _who: asyncio.Future(),
        lambda event, *_, **fields: said.append(event.name),
    )
    service = service_module.HttpService(window)
    port = free_port()
    service.configure(HttpSection(listen=f"127.0.0.1:{port}"), "mill-1", Path())
    running = asyncio.create_task(service.run())
    await until(lambda: len(said) == 2)
    assert sorted(said) == ["http-not-open", "http-ready"]
    assert "supervisor.sock" in str(service.status.problem)
    served = Served(service, window.broadcast, port, state)
    assert (await served.ask("/metrics")).status == 200
    running.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await running


async def test_the_place_of_another_is_left_alone(tmp_path: Path) -> None:
    place = SocketFile(tmp_path, SUPERVISOR_SOCKET_NAME, lock_name=None)
    with place.take():
        said: list[str] = []
        window = Window(
            Broadcast(),
            tmp_path,
            lambda axis: None,
            lambda _who: asyncio.Future(),
            lambda event, *_, **fields: said.append(event.name),
        )
        running = asyncio.create_task(service_module.HttpService(window).run())
        await until(lambda: said == ["http-not-open"])
        running.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await running
        assert (tmp_path / SUPERVISOR_SOCKET_NAME).exists()
        place.leave()


async def test_a_mistake_of_ours_is_an_answer_and_a_note(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with serving(tmp_path) as served:
        served.broadcast.publish(model_of({"troubles": [{"kind": "none"}]}))
        failed = await served.ask("/healthz")
        assert (failed.status, failed.data) == (500, {"problem": "an error in the supervisor; see its log"})
        assert (await served.ask("/healthz")).status == 500
        assert served.said[1:] == [("http-failed", {"detail": "/healthz: KeyError: 'none'"})]  # once a minute
        assert (await served.ask("/status")).status == 200
    assert [record for record in caplog.records if record.levelno >= logging.WARNING] == []
