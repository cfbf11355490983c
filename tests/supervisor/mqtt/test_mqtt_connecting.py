"""Brokers that are away, refuse, stall or cannot prove who they are: what is said, and that it goes on."""

import asyncio
import gc
import signal
import socket
import subprocess
import sys
from datetime import timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.reasoncodes import ReasonCode

from gateway.catalogue.process_events import SUPERVISING
from gateway.supervisor.mqtt.connection import ANSWER_S, BrokerError
from gateway.supervisor.mqtt.reasons import why
from tests.supervisor.mqtt.mqtt_bench import ROOT, axis, connected, model, publishing, settings
from tests.support.certificates import Shop, authority, signed_by
from tests.support.mosquitto import Broker, broker_in, mosquitto_passwd, watching
from tests.support.ports import free_port
from tests.support.status_models import model_of

VERSIONS = pytest.mark.parametrize("version", ["3.1.1", "5"])
WITH_PASSWORD = "listener {port} 127.0.0.1\nallow_anonymous false\npassword_file FOLDER/passwd\n"
SECRET = "correct horse battery staple"


def password_file(folder: Path, **users: str) -> None:
    path = folder / "passwd"
    path.touch(mode=0o600)
    for user, password in users.items():
        subprocess.run([mosquitto_passwd(), "-b", str(path), user, password], check=True, capture_output=True)


async def why_lost(tmp_path: Path, port: int, **keys: Any) -> str:
    """Let a publisher try, and return what it says of it."""
    async with publishing(settings(port, tmp_path, **keys), tmp_path) as site:
        said = await site.until_said("mqtt-lost")
        assert said["severity"] == "warning"
        assert said["detail"] == site.status["problem"]
        assert (site.status["state"], site.status["connects"]) == ("connecting", 0)
    return str(said["detail"])


@VERSIONS
async def test_a_wrong_password_is_told_and_the_right_one_is_taken_without_a_restart(
    tmp_path: Path, version: str, capfd: pytest.CaptureFixture[str]
) -> None:
    password_file(tmp_path, mill=SECRET)
    mine = tmp_path / "password"
    mine.write_text("a wrong one\n")
    mine.chmod(0o600)
    with broker_in(tmp_path, WITH_PASSWORD.replace("FOLDER", str(tmp_path))) as broker:
        given = settings(broker.port, tmp_path, version=version, username="mill", password_file="password")
        async with publishing(given, tmp_path) as site:
            lost = await site.until_said("mqtt-lost")
            assert lost["detail"] == (
                'the broker refuses the user "mill": check [mqtt] username and password_file, and what the '
                "broker allows"
            )
            assert site.status["problem"] == lost["detail"]
            mine.write_text(SECRET + "\n")
            await site.until_said("mqtt-connected")
            assert site.status["problem"] is None
            everything = repr((site.broadcast.recent, site.status, given))
    assert SECRET not in everything
    assert "a wrong one" not in everything
    assert capfd.readouterr() == ("", "")


async def test_nobody_listens(tmp_path: Path) -> None:
    port = free_port()
    said = await why_lost(tmp_path, port)
    assert said == (f"nothing listens at 127.0.0.1:{port}: start the broker, or correct [mqtt] host and port")


async def test_a_name_that_nobody_knows(tmp_path: Path) -> None:
    said = await why_lost(tmp_path, 1883, host="no-such-broker.invalid")
    assert said.startswith("the name service does not know no-such-broker.invalid: correct [mqtt] host")


async def test_a_host_that_is_no_name_at_all(tmp_path: Path) -> None:
    said = await why_lost(tmp_path, 1883, host="a" * 64 + ".lan")
    assert "UnicodeError" in said


async def test_a_password_file_that_is_gone(tmp_path: Path) -> None:
    said = await why_lost(tmp_path, 1883, username="mill", password_file="gone")
    assert said == (
        f"mqtt.password_file: {tmp_path / 'gone'}: no such file; give the path of a file with the password"
    )


async def test_a_port_that_accepts_and_says_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.supervisor.mqtt.connection.ANSWER_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as mute:
        said = await why_lost(tmp_path, mute.getsockname()[1])
    assert said.endswith("does not answer: check that this is a broker's port without TLS")


async def test_a_port_that_hangs_up_before_it_accepts_is_told_of_at_once(tmp_path: Path) -> None:
    def hang_up(_reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.close()

    async with await asyncio.start_server(hang_up, "127.0.0.1", 0) as server:
        port = server.sockets[0].getsockname()[1]
        async with asyncio.timeout(ANSWER_S / 2):
            said = await why_lost(tmp_path, port)
    assert said.endswith("does not answer: check that this is a broker's port without TLS")


@pytest.mark.parametrize(
    ("version", "sent", "said"),
    [
        ("3.1.1", "20020000", "was lost: check that the broker runs. If it does, another client may have"),
        ("5", "2003000000", "was lost: check that the broker runs. If it does, another client may have"),
        (
            "5",
            "2003000000 e0028e00",
            "a [mqtt] client_id: another client has connected as pitch-gateway-mill-1",
        ),
    ],
)
@pytest.mark.parametrize("commands", [False, True])
async def test_a_broker_that_accepts_and_hangs_up_at_once_is_no_mistake_of_ours(
    tmp_path: Path, version: str, sent: str, said: str, *, commands: bool
) -> None:
    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read(1)
        writer.write(bytes.fromhex(sent))
        writer.close()

    async with await asyncio.start_server(accept, "127.0.0.1", 0) as server:
        given = settings(server.sockets[0].getsockname()[1], tmp_path, version=version, commands=commands)
        async with publishing(given, tmp_path) as site:
            assert said in (await site.until_said("mqtt-lost"))["detail"]


async def test_the_same_reason_is_told_once_and_a_new_one_again(tmp_path: Path) -> None:
    broker = Broker(tmp_path, WITH_PASSWORD.replace("FOLDER", str(tmp_path)))
    password_file(tmp_path, mill=SECRET)
    async with publishing(settings(broker.port, tmp_path), tmp_path) as site:
        await site.until_said("mqtt-lost")
        broker.start()
        try:
            said = await site.until_said("mqtt-lost", times=2)
        finally:
            broker.stop()
        assert said["detail"].startswith("the broker refuses clients without a username")
        assert len(site.said("mqtt-lost")) == 2


async def test_a_broker_that_stalls_costs_nothing_but_its_connection(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.supervisor.mqtt.connection.ANSWER_S", 1.0)
    async with connected(tmp_path, model()) as (broker, site):
        assert broker.process is not None
        async with watching(broker.port, f"{ROOT}/#") as watcher:
            await watcher.until(f"{ROOT}/availability", lambda payload: payload == b"online")
            broker.process.send_signal(signal.SIGSTOP)
            site.say(SUPERVISING)  # QoS 1: its acknowledgement does not come
            await site.until_said("mqtt-lost")
            broker.process.send_signal(signal.SIGCONT)
            await watcher.until(f"{ROOT}/availability", lambda payload: payload == b"offline")
            await site.until_said("mqtt-connected", times=2)
            await watcher.until(f"{ROOT}/availability", lambda payload: payload == b"online")
            await watcher.until(f"{ROOT}/axis/x")


async def test_two_that_call_themselves_the_same(tmp_path: Path) -> None:
    async with (
        connected(tmp_path, client_id="mine") as (broker, site),
        watching(broker.port, identifier="mine"),
    ):
        said = (await site.until_said("mqtt-lost"))["detail"]
    assert said.endswith("check that the broker runs. If it does, another client may have connected as mine")


@pytest.mark.parametrize("version", ["3.1.1", "5"])
async def test_two_gateways_with_one_client_id_are_told_so(tmp_path: Path, version: str) -> None:
    folders = tmp_path / "one", tmp_path / "other"
    for folder in folders:
        folder.mkdir()
    with broker_in(tmp_path) as broker:
        given = settings(broker.port, tmp_path, client_id="mine", version=version)
        async with publishing(given, folders[0]) as site, publishing(given, folders[1]):
            times = 0
            detail = ""
            while "ends each connection" not in detail:  # the third in a row that did not hold
                times += 1
                detail = (await site.until_said("mqtt-lost", times))["detail"]
            assert times <= 3
            assert "another client also connects as mine" in detail
            assert detail.startswith("give each gateway its own name, or a [mqtt] client_id")
            await site.until_said("mqtt-connected", times + 1)
            assert site.status["problem"] == detail  # as long as no connection has held


@pytest.mark.parametrize(
    ("packet", "code", "said"),
    [
        (
            PacketTypes.DISCONNECT,
            0x8E,
            "give each gateway its own name, or a [mqtt] client_id: another client has connected as mine",
        ),
        (PacketTypes.CONNACK, 0x84, 'the broker does not speak MQTT 3.1.1: set [mqtt] version to "5"'),
        (PacketTypes.CONNACK, 0x85, "the broker refuses the name mine: set another [mqtt] client_id"),
        (PacketTypes.CONNACK, 0x8C, "the broker requires another way to log in than username and password"),
        (PacketTypes.DISCONNECT, 0x96, "the connection to 127.0.0.1:1883 ended (message rate too high)"),
    ],
)
def test_what_a_code_of_mqtt_means_for_whoever_has_to_do_something(
    tmp_path: Path, packet: int, code: int, said: str
) -> None:
    reason = ReasonCode(packet, identifier=code)
    assert why(BrokerError(reason), settings(1883, tmp_path, client_id="mine")).startswith(said)


async def test_cancelled_while_the_broker_does_not_answer_it_ends(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as mute:
        mute.setblocking(False)
        async with publishing(settings(mute.getsockname()[1], tmp_path), tmp_path):
            connection, _ = await asyncio.get_running_loop().sock_accept(mute)
        connection.close()
    gc.collect()  # a socket that was left open would be seen
    assert capfd.readouterr() == ("", "")


def files_open() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


async def test_a_broker_that_comes_and_goes_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("gateway.supervisor.mqtt.publisher.LONGEST_WAIT_S", 0.01)
    open_files: list[int] = []
    with broker_in(tmp_path) as broker:
        async with publishing(settings(broker.port, tmp_path, version="5"), tmp_path) as site:
            for number in range(6):
                await site.until_said("mqtt-connected", times=number + 1)
                site.broadcast.publish(model_of(model({f"a{index}": axis(number) for index in range(8)})))
                async with watching(broker.port, f"{ROOT}/#") as watcher:
                    await watcher.until(f"{ROOT}/axis/a7")
                open_files.append(files_open())
                broker.stop(signal.SIGKILL if number % 2 else signal.SIGTERM)
                broker.start()
            await site.until_said("mqtt-connected", times=7)
            assert site.status["connects"] == 7
    gc.collect()
    assert capfd.readouterr() == ("", "")
    assert max(open_files) <= open_files[0] + 1


TLS = """listener {port} 127.0.0.1
allow_anonymous true
cafile FOLDER/ca.crt
certfile FOLDER/broker.crt
keyfile FOLDER/broker.key
"""


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("certificates")
    authority(folder, "ca")
    authority(folder, "other")
    signed_by(folder, "ca", "broker", "IP:127.0.0.1")
    signed_by(folder, "ca", "mill", "DNS:mill-1")
    return folder


@VERSIONS
async def test_with_tls_the_broker_proves_who_it_is(tmp_path: Path, certificates: Path, version: str) -> None:
    with broker_in(tmp_path, TLS.replace("FOLDER", str(certificates))) as broker:
        given = settings(broker.port, certificates, version=version, tls={"ca": "ca.crt"})
        async with publishing(given, tmp_path) as site:
            site.broadcast.publish(model_of(model()))
            await site.until_said("mqtt-connected")
            async with watching(broker.port, f"{ROOT}/#", tls_context=given.tls_context()) as watcher:
                await watcher.until(f"{ROOT}/axis/x")


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        (
            {"tls": {"ca": "other.crt"}},
            "(self-signed certificate in certificate chain): set [mqtt.tls] ca to",
        ),
        ({"tls": {}}, "(self-signed certificate in certificate chain): set [mqtt.tls] ca to"),
        ({"tls": {"ca": "ca.crt"}, "host": "localhost"}, "'localhost'): set [mqtt] host to a name in the"),
    ],
)
async def test_a_broker_that_cannot_prove_who_it_is(
    tmp_path: Path, certificates: Path, keys: dict[str, Any], said: str
) -> None:
    with broker_in(tmp_path, TLS.replace("FOLDER", str(certificates))) as broker:
        async with publishing(settings(broker.port, certificates, **keys), tmp_path) as site:
            assert said in (await site.until_said("mqtt-lost"))["detail"]


@pytest.mark.parametrize(
    ("times", "why_not"),
    [
        ({"ended": timedelta(days=1)}, "expired"),
        ({"begins_in": timedelta(days=1)}, "not yet valid"),
    ],
)
async def test_a_broker_whose_certificate_is_not_valid_now(
    tmp_path: Path, times: dict[str, timedelta], why_not: str
) -> None:
    shop = Shop(tmp_path)
    name = x509.SubjectAlternativeName([x509.IPAddress(ip_address("127.0.0.1"))])
    certificate, key = shop.leaf("broker", [name], purpose=ExtendedKeyUsageOID.SERVER_AUTH, **times)
    text = f"listener {{port}} 127.0.0.1\nallow_anonymous true\ncertfile {certificate}\nkeyfile {key}\n"
    with broker_in(tmp_path, text) as broker:
        async with publishing(settings(broker.port, tmp_path, tls={"ca": "ca.pem"}), tmp_path) as site:
            detail = (await site.until_said("mqtt-lost"))["detail"]
    assert f"{why_not}): renew the certificate of the broker. If it is valid, set the clock" in detail


async def test_tls_with_a_broker_that_speaks_none(tmp_path: Path, certificates: Path) -> None:
    with broker_in(tmp_path) as broker:
        async with publishing(settings(broker.port, certificates, tls={"ca": "ca.crt"}), tmp_path) as site:
            detail = (await site.until_said("mqtt-lost"))["detail"]
    assert detail.startswith(f"no TLS with 127.0.0.1:{broker.port} (")
    assert detail.endswith("): check that this is the broker's port for TLS")


@VERSIONS
async def test_a_broker_that_wants_a_certificate_gets_it_or_says_so(
    tmp_path: Path,
    certificates: Path,
    version: str,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    text = (
        TLS.replace("FOLDER", str(certificates)) + "require_certificate true\nuse_identity_as_username true\n"
    )
    with broker_in(tmp_path, text) as broker:
        both = {"ca": "ca.crt", "cert": "mill.crt", "key": "mill.key"}
        given = settings(broker.port, certificates, version=version, tls=both)
        async with publishing(given, tmp_path) as site:
            await site.until_said("mqtt-connected")
        monkeypatch.setattr("gateway.supervisor.mqtt.connection.ANSWER_S", 1.0)
        given = settings(broker.port, certificates, version=version, tls={"ca": "ca.crt"})
        async with publishing(given, tmp_path) as site:
            detail = (await site.until_said("mqtt-lost"))["detail"]
    assert "whether the broker requires a certificate ([mqtt.tls] cert and key)" in detail
    assert capfd.readouterr() == ("", "")


CHILD = """
import asyncio, sys
from pathlib import Path
import gateway.supervisor.mqtt.connection as connection
from tests.supervisor.mqtt.mqtt_bench import publishing, settings

connection.ANSWER_S = 0.5

async def main():
    port, folder = int(sys.argv[1]), Path(sys.argv[2])
    asyncio.get_running_loop().slow_callback_duration = 60.0  # a busy machine is no news
    async with publishing(settings(port, folder, tls={"ca": "ca.crt"}), Path(sys.argv[3])) as site:
        print((await site.until_said("mqtt-lost"))["detail"])

asyncio.run(main())
"""


def test_what_the_libraries_say_stays_out_of_the_log(tmp_path: Path, certificates: Path) -> None:
    """In a process without pytest's handlers: where there is none, Python prints warnings and errors."""
    with broker_in(
        tmp_path, TLS.replace("FOLDER", str(certificates)) + "require_certificate true\n"
    ) as broker:
        command = [
            sys.executable,
            "-X",
            "dev",
            "-c",
            CHILD,
            str(broker.port),
            str(certificates),
            str(tmp_path),
        ]
        folder = Path(__file__).parents[3]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, cwd=folder)
    assert (done.returncode, done.stderr) == (0, "")
    assert "whether the broker requires a certificate" in done.stdout
