"""The page over TLS, and its certificates."""

import asyncio
import contextlib
import logging
import socket
import ssl
from datetime import datetime, timedelta
from pathlib import Path

import pytest
import yaml
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID

from gateway.catalogue.tls_events import CERTIFICATE_ENDS_SOON
from gateway.clock import now_utc
from gateway.status.model import GatewayStatus, Model
from gateway.supervisor.http.answers import Limits
from gateway.supervisor.http.listener import http_settings_of
from gateway.supervisor.http.refusals import ignore_refused, site_of
from gateway.transport.certificates import SOON
from gateway.transport.listener import HandshakesAtOnce, ProtocolListener, Tls
from tests.supervisor.http.doors import (
    TOKEN,
    Asking,
    asking,
    bearer,
    make_certificates,
    section,
    trusting,
    write_token,
)
from tests.supervisor.http.exposition import samples
from tests.supervisor.http.http_bench import (
    CERTIFICATE,
    CONTROLLER,
    PATIENCE_S,
    STATUS,
    model,
    snapshot,
    until,
)
from tests.support.certificates import Shop, signed_by


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("certificates")
    make_certificates(folder)
    return folder


async def is_not_answered(visitor: Asking, client: str = "") -> None:
    with contextlib.suppress(ConnectionError, ssl.SSLError):
        line = await visitor.says(STATUS, client)
        assert await line.rest() == b""


async def test_a_token_over_tls(tmp_path: Path, certificates: Path) -> None:
    async with asking(tmp_path, certificates) as visitor:
        port = visitor.served.port
        assert visitor.served.service.status.address == f"https://127.0.0.1:{port}"
        assert (await visitor.ask("/status")).status == 401
        assert (await visitor.ask("/status", bearer(TOKEN))).status == 200
        answer = await visitor.log_in()
        cookie, *marks = answer.headers["set-cookie"].split("; ")
        assert cookie.startswith(f"__Host-pitch-gateway-mill-1-{port}=")
        assert marks == ["Path=/", "Max-Age=43200", "HttpOnly", "SameSite=Strict", "Secure"]
        assert (await visitor.ask("/status", f"Cookie: {cookie}")).status == 200
        assert "strict-transport-security" not in answer.headers


def test_gateways_behind_one_host_have_cookies_of_their_own(tmp_path: Path, certificates: Path) -> None:
    """Behind a proxy the browser sees one host; both listen on the same port of their machines."""
    wanted = [http_settings_of(section(8480, certificates), name, tmp_path) for name in ("mill-1", "lathe-2")]
    assert [each.cookie for each in wanted if each is not None] == [
        "__Host-pitch-gateway-mill-1-8480",
        "__Host-pitch-gateway-lathe-2-8480",
    ]


@pytest.mark.parametrize(
    "cipher",
    ["ECDHE-ECDSA-AES256-SHA384", "ECDHE-RSA-AES256-SHA384", "ECDHE-RSA-AES128-SHA", "AES256-GCM-SHA384"],
)
async def test_a_cipher_that_the_modbus_port_refuses_is_refused_here_too(
    tmp_path: Path, certificates: Path, cipher: str
) -> None:
    """CBC, or no forward secrecy; TLS 1.3 has neither."""
    context = trusting(certificates)
    context.maximum_version = ssl.TLSVersion.TLSv1_2
    context.set_ciphers(f"{cipher}:@SECLEVEL=0")
    async with asking(tmp_path, certificates) as visitor:
        with pytest.raises((ssl.SSLError, ConnectionError)):
            await asyncio.open_connection("127.0.0.1", visitor.served.port, ssl=context)


async def test_an_authenticated_cipher_of_tls_1_2_is_accepted(tmp_path: Path, certificates: Path) -> None:
    context = trusting(certificates)
    context.maximum_version = ssl.TLSVersion.TLSv1_2
    async with asking(tmp_path, certificates) as visitor:
        _, writer = await asyncio.open_connection("127.0.0.1", visitor.served.port, ssl=context)
        name, _, _ = writer.get_extra_info("cipher")
        writer.close()
    assert name.startswith("ECDHE-")
    assert "GCM" in name or "CHACHA20" in name


async def test_a_certificate_of_a_client_is_enough_beside_tokens(tmp_path: Path, certificates: Path) -> None:
    async with asking(tmp_path, certificates, clients=True) as visitor:
        assert (await visitor.ask("/status")).status == 401
        assert (await visitor.ask("/status", client="panel")).status == 200
        assert (await visitor.ask("/session", client="panel")).data == {
            "by": "panel",
            "how": "certificate",
            "ends_in_s": None,
            "may_acknowledge": False,
        }
        assert (await visitor.ask("/status", bearer(TOKEN))).status == 200


async def test_without_tokens_nobody_without_a_certificate_is_answered(
    tmp_path: Path, certificates: Path
) -> None:
    async with asking(tmp_path, certificates, tokens=False, clients=True) as visitor:
        assert (await visitor.ask("/status", client="panel")).status == 200
        await is_not_answered(visitor)
        event = await visitor.event("http-refused")
        assert event["detail"] == "no TLS: peer did not return a certificate"


async def test_a_certificate_of_somebody_else_is_refused(tmp_path: Path, certificates: Path) -> None:
    async with asking(tmp_path, certificates, clients=True) as visitor:
        await is_not_answered(visitor, "thief")
        event = await visitor.event("http-refused")
        assert str(event["detail"]).startswith("its certificate: ")


@pytest.mark.parametrize("tokens", [True, False])
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("expired", "certificate has expired"),
        ("early", "certificate is not yet valid"),
        ("server", "unsuitable certificate purpose"),
    ],
)
async def test_a_certificate_of_the_right_authority_that_is_not_good_lets_nobody_in(
    tmp_path: Path, name: str, said: str, tokens: bool
) -> None:
    folder = tmp_path / "certificates"
    folder.mkdir()
    shop = Shop(folder)
    shop.server("page")
    shop.server("server")
    shop.leaf("expired", ended=timedelta(days=1))
    shop.leaf("early", begins_in=timedelta(days=1))
    for path in folder.glob("*.pem"):
        path.rename(path.with_suffix(".crt"))
    async with asking(tmp_path, folder, tokens=tokens, clients=True) as visitor:
        await is_not_answered(visitor, name)
        event = await visitor.event("http-refused")
        assert event["detail"] == f"its certificate: {said}"


async def test_a_certificate_that_was_revoked_looks_no_more(tmp_path: Path) -> None:
    folder = tmp_path / "certificates"
    folder.mkdir()
    shop = Shop(folder)
    shop.server("page")
    panel, _ = shop.leaf("panel")
    shop.leaf("wall")
    for path in folder.glob("*.pem"):
        path.with_suffix(".crt").write_bytes(path.read_bytes())
    shop.revoke()
    async with asking(tmp_path, folder, clients=True) as visitor:
        port = visitor.served.port
        await visitor.configured(section(port, folder, clients=True, revoked="crl.pem"))
        assert (await visitor.ask("/status", client="panel")).status == 200
        shop.revoke(panel)
        await visitor.configured(section(port, folder, clients=True, revoked="crl.pem"))
        await is_not_answered(visitor, "panel")
        assert (await visitor.event("http-refused"))["detail"] == "its certificate: certificate revoked"
        assert (await visitor.ask("/status", client="wall")).status == 200


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1, ssl.TLSVersion.TLSv1_1])
async def test_old_tls_is_not_spoken(tmp_path: Path, certificates: Path, version: ssl.TLSVersion) -> None:
    async with asking(tmp_path, certificates) as visitor:
        context = trusting(certificates)
        with pytest.warns(DeprecationWarning, match="TLSv1"):
            context.minimum_version = ssl.TLSVersion.TLSv1
        context.set_ciphers("DEFAULT:@SECLEVEL=0")
        with pytest.warns(DeprecationWarning, match="TLSv1"):
            context.maximum_version = version
        with pytest.raises((ssl.SSLError, ConnectionError)):
            await asyncio.open_connection("127.0.0.1", visitor.served.port, ssl=context)
        await visitor.event("http-refused")
        context = trusting(certificates)
        context.maximum_version = ssl.TLSVersion.TLSv1_2
        _, writer = await asyncio.open_connection("127.0.0.1", visitor.served.port, ssl=context)
        writer.transport.abort()


def met_again(port: int, context: ssl.SSLContext) -> bool:
    """Ask twice, the second time with what the first left; returns whether that was taken for the first."""
    session: ssl.SSLSession | None = None
    for _ in range(2):
        plain = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
        with context.wrap_socket(plain, server_hostname="127.0.0.1", session=session) as line:
            line.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
            while line.recv(4096):
                pass
            session = line.session
            is_reused = line.session_reused
    return bool(is_reused)


async def test_nobody_comes_in_by_a_ticket_of_before(tmp_path: Path, certificates: Path) -> None:
    async with asking(tmp_path, certificates, clients=True) as visitor:
        context = trusting(certificates, "panel")
        assert not await asyncio.to_thread(met_again, visitor.served.port, context)


async def test_whoever_does_not_know_the_authority_is_named(tmp_path: Path, certificates: Path) -> None:
    async with asking(tmp_path, certificates) as visitor:
        context = ssl.create_default_context(cafile=certificates / "foreign.crt")

        def shake_hands() -> None:
            with socket.create_connection(("127.0.0.1", visitor.served.port), PATIENCE_S) as connection:
                context.wrap_socket(connection, server_hostname="127.0.0.1")

        with pytest.raises(ssl.SSLCertVerificationError):
            await asyncio.to_thread(shake_hands)
        assert (await visitor.event("http-refused"))["detail"] == (
            "the client did not accept the certificate of the page"
        )


async def test_what_is_no_tls_is_closed(
    tmp_path: Path, certificates: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with asking(tmp_path, certificates) as visitor:
        line = await visitor.served.says(STATUS)
        assert b"HTTP/1.1" not in await line.rest()
        assert (await visitor.event("http-refused"))["detail"] == "no TLS: http request"
        assert (await visitor.ask("/status", bearer(TOKEN))).status == 200
    assert [record for record in caplog.records if record.levelno >= logging.WARNING] == []


async def test_a_handshake_that_never_ends_is_ended(tmp_path: Path, certificates: Path) -> None:
    limits = HandshakesAtOnce(time_s=0.05)
    async with asking(tmp_path, certificates, handshakes=limits) as visitor:
        line = await visitor.served.connect()
        await line.say(b"\x16\x03\x01\x02\x00\x01")  # the beginning of a ClientHello
        assert await line.rest() == b""
        assert (await visitor.event("http-refused"))["detail"] == "the TLS handshake did not end in time"


@pytest.mark.parametrize("turns", range(6))
async def test_who_connected_just_before_the_end_is_not_left_hanging(certificates: Path, turns: int) -> None:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificates / "page.crt", certificates / "page.key")
    listening = socket.create_server(("127.0.0.1", 0))
    tls = Tls(context, HandshakesAtOnce(), ignore_refused, site_of)
    listener = ProtocolListener(asyncio.Protocol, tls)
    listener.open([listening])
    with socket.create_connection(listening.getsockname(), timeout=30) as there:
        for _ in range(turns):
            await asyncio.sleep(0)
        await listener.close()
        with contextlib.suppress(ConnectionResetError):
            assert await asyncio.get_running_loop().run_in_executor(None, there.recv, 1) == b""
    assert listener.handshakes == 0


@pytest.mark.parametrize("limits", [HandshakesAtOnce(at_once=8), HandshakesAtOnce(from_one_site=8)])
async def test_the_oldest_of_too_many_handshakes_ends(
    tmp_path: Path, certificates: Path, limits: HandshakesAtOnce
) -> None:
    async with asking(tmp_path, certificates, handshakes=limits) as visitor:
        lines = [await visitor.served.connect() for _ in range(8)]
        assert (await visitor.ask("/status", bearer(TOKEN))).status == 200
        assert await lines[0].rest() == b""
        assert visitor.events("http-refused")[0]["detail"] == "too many TLS handshakes at once"
        for _ in range(40):
            await visitor.served.connect()
        assert (await visitor.ask("/status", bearer(TOKEN))).status == 200
        await lines[7].rest()
        assert visitor.served.connections() <= 8


async def test_bad_requests_and_idle_ones_end_over_tls_too(tmp_path: Path, certificates: Path) -> None:
    limits = Limits(whole_request_s=0.05, sweep_s=0.01)
    async with asking(tmp_path, certificates, tcp=limits) as visitor:
        line = await visitor.says("nonsense\r\n\r\n")
        assert (await line.hear()).status == 400
        assert await line.rest() == b""
        slow = await visitor.says("GET / HTTP/1.1\r\nHo")
        assert await slow.rest() == b""


async def test_events_over_tls_come_whole(tmp_path: Path, certificates: Path) -> None:
    async with asking(tmp_path, certificates) as visitor:
        line = await visitor.says(f"GET /events HTTP/1.1\r\nHost: localhost\r\n{bearer(TOKEN)}\r\n\r\n")
        await line.until(b"event: status\n")
        visitor.served.broadcast.publish(Model(gateway=GatewayStatus(name="another")))
        await line.until(b'"name":"another"')


async def test_a_renewed_certificate_is_shown_after_a_reload(tmp_path: Path, certificates: Path) -> None:
    mine = tmp_path / "certificates"
    mine.mkdir()
    for name in ("ca.crt", "ca.key", "page.crt", "page.key"):
        (mine / name).write_bytes((certificates / name).read_bytes())
        (mine / name).chmod(0o600)
    async with asking(tmp_path, mine) as visitor:

        async def shown() -> bytes:
            line = await visitor.connect()
            found: bytes = line.writer.get_extra_info("ssl_object").getpeercert(binary_form=True)
            return found

        cookie = await visitor.cookie()
        old = await shown()
        same = section(visitor.served.port, mine)
        visitor.served.service.configure(same, "mill-1", tmp_path)
        assert await shown() == old
        for new, file in zip(
            signed_by(mine, "ca", "page-2", "IP:127.0.0.1"), ("page.crt", "page.key"), strict=True
        ):
            (mine / file).write_bytes(new.read_bytes())
        visitor.served.service.configure(
            same, "mill-1", tmp_path
        )  # tables were read anew, and not the configuration
        assert await shown() == old
        said = len(visitor.served.said)
        await visitor.configured(section(visitor.served.port, mine))
        assert await shown() != old
        assert [event for event, _ in visitor.served.said[said:]] == ["certificates-renewed", "http-ready"]
        assert (await visitor.ask("/status", cookie)).status == 200  # nobody has to log in for that


async def test_whoever_does_not_take_leave_of_tls_does_not_end_the_service(
    tmp_path: Path, certificates: Path
) -> None:
    """The page has closed the connection, and waits for the other side, when it is opened anew."""
    async with asking(tmp_path, certificates) as visitor:

        def ask() -> ssl.SSLSocket:
            connection = socket.create_connection(("127.0.0.1", visitor.served.port), timeout=PATIENCE_S)
            secured = trusting(certificates).wrap_socket(connection, server_hostname="127.0.0.1")
            secured.sendall(b"GET /session HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
            assert secured.recv(8) == b"HTTP/1.1"
            return secured

        with await asyncio.to_thread(ask):
            await visitor.configured(section(visitor.served.port, certificates, clients=True))
            assert (await visitor.ask("/status", bearer(TOKEN))).status == 200


async def test_a_certificate_that_is_gone_is_a_problem_that_says_so(
    tmp_path: Path, certificates: Path
) -> None:
    async with asking(tmp_path) as visitor:
        write_token(tmp_path, TOKEN)
        visitor.served.service.configure(section(visitor.served.port, tmp_path / "none"), "mill-1", tmp_path)
        await visitor.event("http-not-open")
        assert "page.crt: no such file" in str(visitor.served.service.status.problem)
        visitor.served.service.configure(section(visitor.served.port, certificates), "mill-1", tmp_path)
        visitor.certificates = certificates
        async with asyncio.timeout(PATIENCE_S):
            await until(lambda: visitor.served.service.status.problem is None)
            await until(lambda: visitor.served.service.status.address is not None)
        assert (await visitor.ask("/status", bearer(TOKEN))).status == 200


# The certificates of the page while it is served: told of before and at their end, and in the status.


ALERTS = Path(__file__).parents[3] / "deploy" / "monitoring" / "alerts.yml"


def two_days(folder: Path) -> None:
    """Make a certificate for the page that is good for two days, of an authority that is for 100."""
    folder.mkdir()
    shop = Shop(folder)
    shop.leaf("page", purpose=ExtendedKeyUsageOID.SERVER_AUTH)
    for path in folder.glob("*.pem"):
        path.rename(path.with_suffix(".crt"))


async def test_the_end_of_the_pages_certificate_is_told_before_and_when_it_comes(tmp_path: Path) -> None:
    folder = tmp_path / "certificates"
    two_days(folder)
    start = now_utc()
    clock = [start]

    def now() -> datetime:
        return clock[0]

    async with asking(tmp_path, folder, clients=True, now=now) as visitor:
        soon = await visitor.event("certificate-ends-soon")
        page = folder / "page.crt"
        ends = x509.load_pem_x509_certificate(page.read_bytes()).not_valid_after_utc
        # It was made a moment before the clock was read: not quite two days are left, and not quite 100.
        assert (soon["file"], soon["days_left"]) == (str(page), 1)
        assert soon["detail"] == f"http.tls.certificate: CN=page expires on {ends.date()}"
        certificates = visitor.served.service.status.certificates
        assert [(each.key, each.days_left) for each in certificates] == [("certificate", 1), ("clients", 99)]
        clock[0] = start + timedelta(days=2, minutes=2)
        ended = await visitor.event("certificate-ended")
        assert (ended["days_left"], ended["remedy"]) == (
            -1,
            "give a valid one; if this one is valid, set the clock",
        )
        assert len(visitor.events("certificate-ends-soon")) == 1


def test_files_are_named_from_the_root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    two_days(tmp_path / "certificates")
    monkeypatch.chdir(tmp_path)
    wanted = http_settings_of(section(1, Path("certificates")), "mill-1", Path())
    assert wanted is not None
    assert [held.file for held in wanted.held()] == [str(tmp_path / "certificates" / "page.crt")]


async def test_serving_anew_does_not_tell_of_the_same_certificate_again(tmp_path: Path) -> None:
    folder = tmp_path / "certificates"
    two_days(folder)
    async with asking(tmp_path, folder) as visitor:
        await visitor.event("certificate-ends-soon")
        before = len(visitor.events("http-ready"))
        wanted = section(visitor.served.port, folder, clients=True)
        visitor.served.service.configure(wanted, "mill-1", tmp_path)
        await until(lambda: len(visitor.events("http-ready")) > before)
        assert len(visitor.served.service.status.certificates) == 2
        assert len(visitor.events("certificate-ends-soon")) == 1
        assert visitor.events("certificates-renewed") == []
        visitor.served.service.configure(section(visitor.served.port, None), "mill-1", tmp_path)
        await until(lambda: visitor.served.service.status.certificates == [])


def test_each_file_of_certificates_says_when_it_ends() -> None:
    own = {**CERTIFICATE, "file": "/etc/s.pem", "ends": "2001-09-09T02:46:41+01:00"}
    forever = {**CERTIFICATE, "key": "revoked", "ends": None, "days_left": None}
    cnc = {**CONTROLLER, "tls": {"certificates": [own, forever]}}
    found = samples(model(snapshot(line={"controllers": [cnc]})))
    ends = {
        (of["where"], of["key"], of["file"], of["subject"]): value
        for (name, labels), value in found.items()
        if name == "pitch_gateway_certificate_end_timestamp_seconds" and (of := dict(labels))
    }
    # 1 000 000 000 s of Unix time are 2001-09-09 01:46:40 UTC.
    assert ends == {
        ("http", "certificate", "/etc/page.pem", "CN=mill"): 1_000_000_000,
        ("line xyz, controller cnc", "certificate", "/etc/s.pem", "CN=mill"): 1_000_000_001,
    }


def test_event_and_alert_come_when_the_check_warns() -> None:
    rules = yaml.safe_load(ALERTS.read_text())["groups"][0]["rules"]
    [rule] = [rule for rule in rules if rule["alert"] == "PitchGatewayCertificateEndsSoon"]
    assert rule["expr"].endswith(f" - time() < {SOON.days} * 86400")
    assert f"expires within {SOON.days} days " in CERTIFICATE_ENDS_SOON.description
