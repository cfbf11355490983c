"""Modbus/TCP Security on a listener, on both loops: who is let in, as what, and what is told."""

import asyncio
import contextlib
import re
import ssl
from collections.abc import Callable, Coroutine
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID
from pymodbus.client import AsyncModbusTlsClient

from gateway.modbus.mbap import encode_mbap
from gateway.transport.certificates import ROLE_OID
from gateway.transport.loop import RelayLoop
from tests.relay.secure_site import CORRECTED, READ, WRITE, WRITTEN, Site, ask
from tests.support.certificates import Shop, client_context
from tests.support.relay import Bench, eventually

LOOPS = {"relay": RelayLoop, "asyncio": asyncio.new_event_loop}
Scenario = Callable[["Site"], Coroutine[Any, Any, None]]


def on(loop: str, folder: Path, scenario: Scenario) -> None:
    async def run() -> None:
        bench = Bench()
        async with bench.stack:
            await scenario(Site(bench, folder))

    with asyncio.Runner(loop_factory=LOOPS[loop]) as runner:
        runner.run(run())


@pytest.fixture
async def site(bench: Bench, tmp_path: Path) -> Site:
    site = Site(bench, tmp_path)
    await site.start()
    return site


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
@pytest.mark.parametrize("loop", LOOPS)
def test_a_controller_with_a_role_moves_the_drive(tmp_path: Path, loop: str, version: ssl.TLSVersion) -> None:
    async def scenario(site: Site) -> None:
        await site.start()
        shown = site.shop.controller("mill", "Operator")
        context = client_context(site.shop.path, shown)
        context.minimum_version = context.maximum_version = version
        stream = await site.connect(shown, context)
        site.drive.data = b""
        assert await ask(stream, WRITE) == WRITTEN
        assert site.drive.data[7:] == CORRECTED
        [session] = site.status["sessions"]
        assert (session["certified"], session["role"], session["subject"]) == (
            "Operator",
            "motion",
            "CN=mill",
        )
        assert site.status["handshakes"] == 1
        stream[1].close()
        await stream[1].wait_closed()
        await eventually(lambda: site.status["sessions"] == [])

    on(loop, tmp_path, scenario)


@pytest.mark.parametrize("loop", LOOPS)
def test_each_certificate_has_the_rights_of_its_own_role(tmp_path: Path, loop: str) -> None:
    async def scenario(site: Site) -> None:
        await site.start()
        monitor = await site.connect(site.shop.controller("hmi", "Beobachter Süd"))
        mover = await site.connect(site.shop.controller("mill", "Operator"))
        assert await ask(monitor, WRITE) == b"\x90\x01"
        assert await ask(mover, WRITE) == WRITTEN
        assert await ask(monitor, READ) == bytes.fromhex("03 02 0007")
        for stream in (monitor, mover):
            stream[1].close()
            await stream[1].wait_closed()

    on(loop, tmp_path, scenario)


async def test_an_independent_client_moves_and_reads_back(site: Site) -> None:
    context = client_context(site.shop.path, site.shop.controller("mill", "Operator"))
    client = AsyncModbusTlsClient("127.0.0.1", port=site.port, sslctx=context)
    assert await client.connect()
    site.drive.data = b""
    written = await client.write_registers(100, [0x0000, 0xC350], device_id=1)
    assert not written.isError()
    assert site.drive.data[7:] == CORRECTED
    read = await client.read_holding_registers(110, count=2, device_id=1)
    assert read.registers == [0x0000, 0xC350]  # 50 000: what it had asked for
    client.close()


ROLE = x509.ObjectIdentifier(ROLE_OID)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (None, f"it has no role (extension {ROLE_OID})"),
        (b"\x0c\x04Gast", 'its role "Gast" is not in `roles`'),
        (b"\x0c\x08Operator\x0c\x08Operator", "its role is not one UTF8String with 1 to 64 characters"),
        (b"\x30\x0a\x0c\x08Operator", "its role is not one UTF8String with 1 to 64 characters"),
        (b"\x13\x08Operator", "its role is not one UTF8String with 1 to 64 characters"),  # PrintableString
        (
            b"\x0c\x08\xff\xff\xff\xff\xff\xff\xff\xff",
            "its role is not one UTF8String with 1 to 64 characters",
        ),
        (b"\x0c\x00", "its role is not one UTF8String with 1 to 64 characters"),
    ],
)
async def test_without_one_known_role_nobody_comes_in(site: Site, value: bytes | None, said: str) -> None:
    extensions = [] if value is None else [x509.UnrecognizedExtension(ROLE, value)]
    shown = site.shop.leaf("stranger", extensions)
    site.drive.data = b""
    await site.is_refused(shown)
    [detail] = site.told("certificate-refused")
    serial = x509.load_pem_x509_certificate(shown[0].read_bytes()).serial_number
    assert detail.startswith(f"127.0.0.1: {said}: 127.0.0.1:")
    assert detail.endswith(f", CN=stranger, serial {serial:X}")
    assert site.drive.data == b""
    assert site.status["failed_handshakes"] == 1


async def test_a_certificate_of_another_authority_is_refused(site: Site, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    await site.is_refused(Shop(tmp_path / "other").controller("mill", "Operator"))
    [detail] = site.told("certificate-refused")
    assert "127.0.0.1: " in detail
    assert "signature" in detail or "issuer" in detail


async def test_who_shows_no_certificate_is_refused(site: Site) -> None:
    await site.is_refused(None)
    assert site.told("certificate-refused") == ["127.0.0.1: it sent no certificate"]


async def test_a_certificate_that_has_expired_or_not_begun_is_refused(site: Site) -> None:
    role = x509.UnrecognizedExtension(ROLE, b"\x0c\x08Operator")
    await site.is_refused(site.shop.leaf("late", [role], ended=timedelta(minutes=30)))
    await site.is_refused(site.shop.leaf("early", [role], begins_in=timedelta(days=1)))
    assert site.told("certificate-refused") == [
        "127.0.0.1: certificate has expired",
        "127.0.0.1: certificate is not yet valid",
    ]


async def test_the_certificate_of_a_server_is_no_controller_s(site: Site) -> None:
    role = x509.UnrecognizedExtension(ROLE, b"\x0c\x08Operator")
    await site.is_refused(site.shop.leaf("other", [role], purpose=ExtendedKeyUsageOID.SERVER_AUTH))
    [detail] = site.told("certificate-refused")
    assert re.fullmatch("127.0.0.1: un(supported|suitable) certificate purpose", detail)


@pytest.mark.parametrize(
    ("version", "ciphers", "said"),
    [
        (ssl.TLSVersion.TLSv1_1, "DEFAULT@SECLEVEL=0", "unsupported protocol"),
        (ssl.TLSVersion.TLSv1_2, "ECDHE-ECDSA-AES128-SHA256", "no shared cipher"),
    ],
)
@pytest.mark.filterwarnings("ignore:ssl.TLSVersion.TLSv1_1 is deprecated")
async def test_old_tls_and_ciphers_are_refused(
    site: Site, version: ssl.TLSVersion, ciphers: str, said: str
) -> None:
    shown = site.shop.controller("mill", "Operator")
    context = client_context(site.shop.path, shown)
    context.set_ciphers(ciphers)
    context.minimum_version = context.maximum_version = version
    await site.is_refused(shown, context)
    assert site.told("handshake-failed") == [f"127.0.0.1: {said}"]


async def test_plain_modbus_is_refused_at_its_first_byte(site: Site) -> None:
    reader, writer = await site.connect_plain()
    writer.write(b"\0")
    async with asyncio.timeout(30):
        assert await reader.read(100) == b""
    writer.close()
    assert site.told("handshake-failed") == ["127.0.0.1: no TLS: the data received is not a handshake"]


async def test_a_handshake_in_pieces_succeeds_and_garbage_behind_it_ends_the_session(site: Site) -> None:
    """Whatever splits and joins the bytes of both sides; and records that nobody sealed are not opened."""
    reader, writer = await site.connect_plain()
    incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
    context = client_context(site.shop.path, site.shop.controller("mill", "Operator"))
    tls = context.wrap_bio(incoming, outgoing, server_hostname="127.0.0.1")

    async def until(step: Callable[[], object]) -> object:
        while True:
            try:
                done = step()
            except ssl.SSLWantReadError:
                done = None
            data = outgoing.read()
            # The header of a record in single bytes, the rest in pieces that fit nothing.
            pieces = [data[n : n + 1] for n in range(6)] + [data[n : n + 97] for n in range(6, len(data), 97)]
            for piece in pieces:
                writer.write(piece)
                await asyncio.sleep(0)
            if done is not None:
                return done
            async with asyncio.timeout(30):
                incoming.write(await reader.read(97))
                assert not reader.at_eof()

    def shake_hands() -> bool:
        tls.do_handshake()
        return True

    await until(shake_hands)
    tls.write(encode_mbap(1, 1, READ))
    tls.write(encode_mbap(2, 1, READ))
    answer = encode_mbap(1, 1, bytes.fromhex("03 02 0007"))
    assert await until(lambda: tls.read(len(answer))) == answer
    assert await until(lambda: tls.read(len(answer))) == b"\0\x02" + answer[2:]
    writer.write(b"\x17\x03\x03\x00\x20" + bytes(32))
    async with asyncio.timeout(30):
        await reader.read()
    writer.close()
    await eventually(lambda: site.status["sessions"] == [])


async def test_a_peer_that_hangs_up_in_a_handshake_is_counted_and_told_of_once(site: Site) -> None:
    for number in range(1, 4):
        _, writer = await site.connect_plain()
        writer.write(b"\x16\x03\x01\x02\x00\x01")
        writer.close()
        await eventually(lambda number=number: site.status["failed_handshakes"] == number)  # type: ignore[misc]
    assert site.told("handshake-failed") == ["127.0.0.1: the peer disconnected"]
    assert site.told("unexpected") == []
    assert site.status["running_handshakes"] == 0


async def test_a_connection_ends_with_a_goodbye_when_the_relay_stops(site: Site) -> None:
    reader, writer = await site.connect(site.shop.controller("mill", "Operator"))
    await site.relay.stop()
    async with asyncio.timeout(30):
        assert await reader.read() == b""  # without close_notify it would be an error
    writer.close()


async def test_a_revoked_certificate_is_refused_with_the_next_connection(site: Site) -> None:
    shown = site.shop.controller("mill", "Operator")
    before = await site.connect(shown)
    site.shop.revoke(shown[0])
    with contextlib.suppress(OSError):
        reader, writer = await site.connect(shown)
        with contextlib.suppress(OSError):
            assert await reader.read(100) == b""
        writer.close()
    await eventually(lambda: bool(site.told("certificate-refused")))
    assert site.told("certificate-refused") == ["127.0.0.1: certificate revoked"]
    assert len(site.told("certificates-renewed")) == 1
    assert await ask(before, READ) == bytes.fromhex("03 02 0007")
    before[1].close()


async def test_a_certificate_of_the_gateway_that_is_renewed_is_shown_next(site: Site) -> None:
    shown = site.shop.controller("mill", "Operator")
    first = await site.connect(shown)
    site.shop.server("server", "127.0.0.1", "mill-1.local")
    second = await site.connect(shown)
    names = [
        [name for _, name in stream[1].get_extra_info("peercert")["subjectAltName"]]
        for stream in (first, second)
    ]
    assert names == [["127.0.0.1"], ["127.0.0.1", "mill-1.local"]]
    assert await ask(first, READ) == await ask(second, READ)
    for stream in (first, second):
        stream[1].close()


async def test_files_that_became_bad_are_told_of_and_the_last_good_ones_stay(site: Site) -> None:
    shown = site.shop.controller("mill", "Operator")
    site.shop.spoil(Path(site.files.key))
    stream = await site.connect(shown)
    assert await ask(stream, READ) == bytes.fromhex("03 02 0007")
    [detail] = site.told("certificates-not-renewed")
    assert detail.startswith("tls.certificate: ")
    assert detail.endswith("; the previous ones stay in force")
    stream[1].close()
