"""``pitch-gateway status URL…``: many gateways in one table, the worst first."""

import asyncio
import contextlib
import json
import os
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from tests.supervisor.http.doors import TOKEN, WRONG, asking, make_certificates, write_token
from tests.supervisor.http.http_bench import Served, model, serving
from tests.support.commands import Typed, typed
from tests.support.ports import free_port
from tests.support.status_models import model_of

SINCE = "2026-05-01T12:00:00+00:00"
SILENT = {
    "kind": "drive-silent",
    "severity": "error",
    "where": "line xyz",
    "what": "unit id 1 does not answer",
    "remedy": "check its supply",
    "since": SINCE,
    "axes": ["x"],
}


def gateway(name: str, state: str, *alarms: dict[str, Any], **axis: Any) -> dict[str, Any]:
    """A whole status: its name, its verdict, its alarms, what differs of its axis."""
    status = model()
    status["gateway"]["name"] = name
    status["troubles"] = list(alarms)
    errors = sum(each["severity"] == "error" for each in alarms)
    status["verdict"] = {"state": state, "since": SINCE, "errors": errors, "warnings": 0}
    status["axes"]["x"] |= axis
    return status


async def ask(*arguments: str) -> Typed:
    return await asyncio.to_thread(typed, "status", *arguments)


def url(served: Served) -> str:
    return f"http://127.0.0.1:{served.port}"


def http(code: int, body: bytes, header: str = "Server: other") -> bytes:
    """An answer of something else."""
    return f"HTTP/1.1 {code} Some\r\n{header}\r\nContent-Length: {len(body)}\r\n\r\n".encode() + body


@contextlib.asynccontextmanager
async def answering(answer: bytes) -> AsyncIterator[str]:
    """Something that answers each request with these bytes and closes; empty: with nothing, for good."""
    writers: list[asyncio.StreamWriter] = []

    async def answered(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writers.append(writer)
        if answer:
            await reader.readuntil(b"\r\n\r\n")
            writer.write(answer)
            writer.close()

    server = await asyncio.start_server(answered, "127.0.0.1", 0)
    yield f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}"
    server.close()
    for writer in writers:
        writer.close()
        with contextlib.suppress(ConnectionError):
            await writer.wait_closed()


async def test_the_worst_comes_first_and_each_row_says_what_is_wrong(tmp_path: Path) -> None:
    for name in "abc":
        (tmp_path / name).mkdir()
    well = gateway("mill-1", "healthy", compensation="active")
    waits = gateway("mill-2", "waiting", compensation="unreferenced")
    bad = gateway("mill-3", "error", SILENT, compensation="active")
    absent = f"http://127.0.0.1:{free_port()}"
    async with (
        serving(tmp_path / "a", newest=well) as a,
        serving(tmp_path / "b", newest=waits) as b,
        serving(tmp_path / "c", newest=bad) as c,
    ):
        shown = await ask(url(a), url(b), f"{url(c)}/", absent, url(a), f"{url(a)}/", f"{url(b)}/status")
        data = await ask("--json", url(a), url(b), url(c), absent)
    assert shown.returncode == 1
    rows = shown.stdout.splitlines()
    assert [row.split()[0] for row in rows[1:5]] == ["–", "mill-3", "mill-2", "mill-1"]
    assert rows[1].endswith("nothing listens there; by default the page is at port 8480")
    assert "error" in rows[2]
    assert rows[2].rstrip().endswith("1 of 1    line xyz: unit id 1 does not answer")
    assert "0 of 1" in rows[3]
    assert rows[-1] == "4 gateways: 1 unreachable, 1 error, 1 waiting, 1 healthy"
    seen = json.loads(data.stdout)
    assert seen["states"] == {"unreachable": 1, "error": 1, "waiting": 1, "healthy": 1}
    assert seen["gateways"][0]["url"] == absent
    assert seen["gateways"][1] == {
        "url": url(c),
        "state": "error",
        "problem": "",
        "name": "mill-3",
        "version": "0.1.0",
        "since": SINCE,
        "errors": 1,
        "warnings": 0,
        "worst": "line xyz: unit id 1 does not answer",
        "axes": 1,
        "compensated": 1,
    }


@pytest.mark.parametrize(
    ("verdicts", "code", "counted"),
    [
        (["healthy"], 0, "1 gateway: 1 healthy"),
        (["healthy", "waiting"], 0, "2 gateways: 1 waiting, 1 healthy"),
        (["healthy", "warning"], 4, "2 gateways: 1 warning, 1 healthy"),
        (["error", "warning"], 3, "2 gateways: 1 error, 1 warning"),
    ],
)
async def test_the_exit_code_says_how_the_worst_is(
    tmp_path: Path, verdicts: list[str], code: int, counted: str
) -> None:
    async with contextlib.AsyncExitStack() as stack:
        urls = []
        for verdict in verdicts:
            (tmp_path / verdict).mkdir()
            newest = gateway(verdict, verdict)
            urls.append(url(await stack.enter_async_context(serving(tmp_path / verdict, newest=newest))))
        shown = await ask(*urls)
    assert shown.returncode == code
    assert shown.stdout.splitlines()[-1] == counted


async def test_two_hundred_are_asked_at_the_same_time() -> None:
    """Each is answered only after all of them have asked."""
    body = json.dumps(gateway("mill", "healthy")).encode()
    asked = asyncio.Barrier(200)

    async def answered(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        await asked.wait()
        writer.write(http(200, body))
        await writer.drain()
        writer.close()

    server = await asyncio.start_server(answered, "127.0.0.1", 0, backlog=200)
    async with server, asyncio.timeout(60):
        page = f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}"
        shown = await ask("--json", *(f"{page}/{number}" for number in range(200)))
    assert json.loads(shown.stdout)["states"] == {"healthy": 200}
    assert shown.returncode == 0


async def test_a_page_with_tls_and_token_is_asked_with_its_authority_and_token(tmp_path: Path) -> None:
    make_certificates(tmp_path)
    async with asking(tmp_path, tmp_path) as visitor:
        visitor.served.broadcast.publish(model_of(gateway("mill-1", "healthy")))
        page = f"https://127.0.0.1:{visitor.served.port}"
        by = ["--token-file", str(tmp_path / "people.token"), "--ca", str(tmp_path / "ca.crt")]
        assert (await ask(page, *by)).returncode == 0
        without_authority = await ask(page, *by[:2])
        without_token = await ask(page, *by[2:])
        write_token(tmp_path, WRONG, "wrong.token")
        with_another = await ask(page, "--token-file", str(tmp_path / "wrong.token"), *by[2:])
    assert "name its authority with --ca" in without_authority.stdout
    assert "name its file with --token-file" in without_token.stdout
    assert "name its file with --token-file" in with_another.stdout
    for shown in (without_authority, without_token, with_another):
        assert shown.returncode == 1
        assert TOKEN not in shown.stdout + shown.stderr


async def test_a_page_that_wants_a_certificate_gets_ours(tmp_path: Path) -> None:
    make_certificates(tmp_path)
    async with asking(tmp_path, tmp_path, tokens=False, clients=True) as visitor:
        visitor.served.broadcast.publish(model_of(gateway("mill-1", "healthy")))
        page = f"https://127.0.0.1:{visitor.served.port}"
        ours = ["--certificate", str(tmp_path / "panel.crt"), "--key", str(tmp_path / "panel.key")]
        assert (await ask(page, "--ca", str(tmp_path / "ca.crt"), *ours)).returncode == 0


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (http(200, b"hi"), "its answer is no status of a gateway (HTTP 200)"),
        (http(200, b"{}"), "its release is older than 1.0: it says no verdict; upgrade it"),
        (http(302, b"", "Location: http://127.0.0.1:1/"), "its answer is no status of a gateway (HTTP 302)"),
        (http(503, b'{"problem": "nothing is known"}'), "nothing is known (HTTP 503)"),
        (bytes.fromhex("00010000000601831000"), "its answer is no HTTP; check host and port"),
        (http(200, b"[" * 100_000), "its answer is no status of a gateway (HTTP 200)"),
        (http(200, b" " * 9_000_000), "its answer is no status of a gateway: it is too long"),
        (
            http(200, b'{"verdict": {"state": "unreachable", "since": ""}}'),
            "its release is older than 1.0: it says no verdict; upgrade it",
        ),
        (
            http(200, b'{"verdict": {"state": "healthy", "since": "0001-01-01"}}'),
            "its answer is no status of a gateway",
        ),
    ],
    ids=["no JSON", "older", "elsewhere", "problem", "Modbus", "deep", "long", "no verdict", "no time"],
)
async def test_what_is_no_status_says_so(answer: bytes, why: str) -> None:
    async with answering(answer) as page:
        shown = await ask("--json", page)
    assert shown.returncode == 1
    [seen] = json.loads(shown.stdout)["gateways"]
    assert seen["state"] == "unreachable"
    assert seen["problem"] == why


async def test_one_that_hangs_delays_the_others_by_its_time_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.commissioning.fleet.ANSWER_WITHIN_S", 0.2)
    async with answering(b"") as page, answering(b"") as other:
        shown = await ask("--json", page, other)
    problems = [each["problem"] for each in json.loads(shown.stdout)["gateways"]]
    assert problems == ["no answer within 0.2 s"] * 2


@pytest.mark.parametrize(
    "begins", [b"HTTP/1.1 200 OK\r\nX: ", b"HTTP/1.1 200 OK\r\n\r\n"], ids=["header", "body"]
)
async def test_one_that_sends_a_byte_now_and_then_for_good_ends_in_time(
    monkeypatch: pytest.MonkeyPatch, begins: bytes
) -> None:
    monkeypatch.setattr("gateway.commissioning.fleet.ANSWER_WITHIN_S", 0.5)

    ended = asyncio.Event()

    async def drip(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(begins)
        with contextlib.suppress(ConnectionError):
            while True:
                writer.write(b"a")
                await writer.drain()
                await asyncio.sleep(0.05)
        writer.close()
        ended.set()

    server = await asyncio.start_server(drip, "127.0.0.1", 0)
    async with server, asyncio.timeout(60):
        shown = await ask("--json", f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}")
        await ended.wait()
    assert [each["problem"] for each in json.loads(shown.stdout)["gateways"]] == ["no answer within 0.5 s"]


async def test_a_text_of_a_gateway_does_not_control_the_terminal() -> None:
    async with answering(http(500, b'{"problem": "a\\u001b[2J\\nb\\u009bc"}')) as page:
        shown = await ask(page)
    assert "a\ufffd[2J b\ufffdc (HTTP 500)" in shown.stdout


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["http://"], "no address of a gateway's page, such as http://192.168.0.7:8480"),
        (["http://mill/ü"], "no address of a gateway's page"),
        (["http://mill/a b"], "no address of a gateway's page"),
        (["HTTP://mill..hall"], "no address of a gateway's page"),
        (["http://mill:99999"], "no address of a gateway's page"),
        (["https://me:secret@mill"], "give the address alone; a token comes from --token-file"),
        (["http://mill", "gateway.toml"], "gateway.toml: no address of a gateway's page"),
        (["http://mill", "--key", "k.pem"], "--key needs --certificate"),
        (
            ["http://mill", "--ca", "/nonexistent"],
            "--ca: /nonexistent: no such file; give the path",
        ),
        (["http://mill", "--certificate", "/nonexistent"], "--certificate: /nonexistent: no such file"),
        (["http://mill", "--token-file", "/nonexistent"], "--token-file: /nonexistent"),
    ],
)
def test_what_cannot_be_asked_is_refused_before_anything_is_sent(arguments: list[str], why: str) -> None:
    refused = typed("status", *arguments)
    assert refused.returncode == 1
    assert why in refused.stderr
    assert refused.stdout == ""


@pytest.mark.parametrize("option", ["--ca", "--certificate", "--key"])
def test_a_fifo_is_refused_and_not_waited_for(tmp_path: Path, option: str) -> None:
    fifo, other = tmp_path / "fifo", tmp_path / "own.pem"
    os.mkfifo(fifo)
    other.write_text("not read before")
    more = ["--certificate", str(other)] if option == "--key" else []
    refused = typed("status", "http://127.0.0.1:9", *more, option, str(fifo))
    assert refused.returncode == 1
    assert refused.stderr == f"{option}: {fifo}: a FIFO, not a regular file; give the path of a file in PEM\n"


@pytest.mark.parametrize("page", ["http://192.0.2.1:8480", "http://127.0.0.1.example:8480"])
def test_a_token_is_not_sent_unencrypted_to_another_computer(tmp_path: Path, page: str) -> None:
    write_token(tmp_path, TOKEN)
    refused = typed("status", page, "--token-file", str(tmp_path / "people.token"))
    assert refused.returncode == 1
    assert refused.stderr == f"{page}: a token is sent encrypted only; use https\n"


@pytest.mark.parametrize(
    "arguments",
    [
        ["http://mill", "--watch"],
        ["gateway.toml", "other.toml"],
        ["gateway.toml", "--ca", "ca.pem"],
        ["gateway.toml", "http://mill"],
    ],
)
def test_what_does_not_go_together_is_wrong_usage(arguments: list[str]) -> None:
    assert typed("status", *arguments).returncode == 2


def test_the_address_of_a_page_without_http_is_told_as_it_is_written() -> None:
    refused = typed("status", "mill-1:8480")
    assert refused.returncode == 2
    assert "for a gateway's page write http://mill-1:8480" in " ".join(
        refused.stderr.replace("│", " ").split()
    )
