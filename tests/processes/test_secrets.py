"""A password, tokens and keys, and everything that could show them: nothing does."""

import asyncio
import json
import os
import signal
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.ipc.supervisor_client import ask_supervisor
from tests.supervisor.http.doors import make_certificates, trusting, write_token
from tests.support.commands import typed
from tests.support.gateway import Site, gateway_of
from tests.support.mosquitto import broker_in, mosquitto_passwd, watching
from tests.support.processes import SECONDS, children, running

PASSWORD = "marker-of-the-password"
TOKEN = "marker-of-the-token-0123456789abcdefgh"
GUESS = "marker-of-a-guess-0123456789abcdefghij"
SHORT = "marker-too-short"
ALWAYS = ("marker-",)
WITH_PASSWORD = "listener {port} 127.0.0.1\nallow_anonymous false\npassword_file "
SECTIONS = """
[mqtt]
port = {port}
username = "trial"
password_file = "mqtt.password"

"""
PAGE = """tokens = [{ name = "people", file = "people.token" }]
tls = { certificate = "page.crt", key = "page.key", clients = "ca.crt" }
"""


class Shown:
    """Everything that was shown, by where; what holds a secret fails the test with the place only."""

    def __init__(self, folder: Path) -> None:
        lines = (folder / "page.key").read_text().splitlines()
        self._secrets = [secret.encode() for secret in (*ALWAYS, *lines[1:-1])]
        assert all(len(secret) > 6 for secret in self._secrets)

    def look_at(self, where: str, what: bytes | str) -> None:
        found = what.encode() if isinstance(what, str) else what
        assert found, f"{where} shows nothing at all"
        for secret in self._secrets:
            assert secret not in found, f"{where} shows a secret"

    def look_at_processes(self, pids: list[int]) -> None:
        for pid in pids:
            for name in ("cmdline", "environ"):
                self.look_at(f"{name} of {pid}", Path(f"/proc/{pid}/{name}").read_bytes())

    def look_at_folder(self, folder: Path) -> None:
        files = [path for path in folder.rglob("*") if path.is_file()]
        assert files
        for path in files:
            if path.stat().st_size:
                self.look_at(path.name, path.read_bytes())


@pytest.fixture
def guarded(site: Site, tmp_path: Path) -> Iterator[Site]:
    """A site with everything on that has a secret."""
    make_certificates(tmp_path)
    write_token(tmp_path, TOKEN)
    write_token(tmp_path, PASSWORD, "mqtt.password")
    passwords = tmp_path / "passwords"
    passwords.touch(mode=0o600)
    os.spawnl(os.P_WAIT, mosquitto_passwd(), "mosquitto_passwd", "-b", str(passwords), "trial", PASSWORD)
    with broker_in(tmp_path, f"{WITH_PASSWORD}{passwords}\n") as broker:
        address = site.serve_page()
        text = site.config.read_text()
        listen = f'listen = "{address.removeprefix("http://")}"\n'
        assert listen in text
        text = SECTIONS.format(port=broker.port) + text.replace(listen, listen + PAGE)
        site.config.write_text(text)
        yield site


def over_https(site: Site, folder: Path, path: str, token: str) -> bytes:
    listen = next(line for line in site.config.read_text().splitlines() if line.startswith("listen"))
    url = f"https://{json.loads(listen.partition('=')[2])}{path}"
    request = urllib.request.Request(url, headers={"Authorization": f"Bearer {token}"})
    try:
        with urllib.request.urlopen(request, context=trusting(folder), timeout=20) as answer:
            found: bytes = answer.read() + str(answer.headers).encode()
    except urllib.error.HTTPError as error:
        with error:
            return error.read() + str(error.headers).encode()
    return found


async def retained(port: int) -> bytes:
    async with watching(port, "#", username="trial", password=PASSWORD) as watcher:
        message = await watcher.until("pitch-gateway/trial/info")
        assert isinstance(message.payload, bytes)
        return message.payload


def test_a_gateway_with_everything_on_shows_no_secret(guarded: Site, tmp_path: Path) -> None:
    shown = Shown(tmp_path)
    state = tmp_path / "state"
    port = int(guarded.config.read_text().partition("port = ")[2].split()[0])
    for arguments in (["check"], ["check", "--json"], ["check", "--compile"]):
        done = typed(*arguments, str(guarded.config))
        assert done.returncode == 0, done.stderr
        shown.look_at(" ".join(arguments), done.stdout + done.stderr)
    with gateway_of(guarded) as (gateway, master):
        gateway.until("mqtt-connected")
        if all(note["event"] != "http-ready" for note in gateway.notes):
            gateway.until("http-ready")
        master.move(20_000)
        for path in ("/status", "/metrics", "/session", "/tables/x"):
            shown.look_at(path, over_https(guarded, tmp_path, path, TOKEN))
            shown.look_at(path, over_https(guarded, tmp_path, path, GUESS))
        shown.look_at("info", asyncio.run(retained(port)))
        pids = [gateway.process.pid, *children(gateway.process).values()]
        assert len(pids) == 3
        shown.look_at_processes(pids)
        for name, words in (("people.token", SHORT), ("mqtt.password", f"{PASSWORD}\n{SHORT}")):
            good = (tmp_path / name).read_text()
            write_token(tmp_path, words, name)
            refused = ask_supervisor(state, "/reload", "POST", timeout_s=20)
            assert refused["problems"]
            shown.look_at("reload", json.dumps(refused))
            shown.look_at("status", json.dumps(ask_supervisor(state, "/status")))
            done = typed("check", str(guarded.config))
            assert done.returncode == 1
            shown.look_at("check", done.stderr)
            write_token(tmp_path, good.strip(), name)
        (tmp_path / "page.key").chmod(0o644)
        shown.look_at("check", typed("check", str(guarded.config)).stderr)
        (tmp_path / "page.key").chmod(0o600)
        shown.look_at("status", typed("status", str(guarded.config)).stdout)
        shown.look_at_folder(state)
    shown.look_at("log", json.dumps(gateway.notes))


def test_a_recording_holds_no_secret(guarded: Site, tmp_path: Path) -> None:
    shown, file = Shown(tmp_path), tmp_path / "monday.jsonl"
    with running("record", str(guarded.config), str(file)) as gateway:
        gateway.until("line-up")
        master = guarded.master()
        assert master.move(20_000) == 20_020
        master.close()
        gateway.process.send_signal(signal.SIGTERM)
        shown.look_at("log", "".join(iter(gateway.line, "")))
        assert gateway.process.wait(SECONDS) == 0
    shown.look_at("recording", file.read_bytes())
    assert "people.token" in file.read_text()  # the name of its file it has
    for name in ("people.token", "mqtt.password", "page.key", "page.crt"):
        (tmp_path / name).unlink()
    done = typed("replay", str(file))  # on another machine, which has none of the files
    assert done.returncode == 0, done.stderr
