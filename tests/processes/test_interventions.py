"""Relay and supervisor, as processes: who intervened, and how, is in the journal with its digests."""

import hashlib
import json
import os
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

from paho.mqtt import publish

import gateway as program
from gateway.exchange.commands import Disable, SetGain
from gateway.ipc.client import ask
from gateway.ipc.messages import Done
from gateway.state.interventions import Verification, files_in, head_in, locked
from tests.support.commands import typed
from tests.support.config import RAMP, STEEPER
from tests.support.gateway import Site, gateway_of, site_in
from tests.support.mosquitto import Broker
from tests.support.processes import SECONDS, eventually, running

TOKEN = "a-token-of-forty-three-characters-or-so-0001"
JSON = {"Content-Type": "application/json", "Authorization": f"Bearer {TOKEN}"}
Entries = list[dict[str, Any]]


def entries_of(site: Site) -> Entries:
    """Return the entries of a journal that is whole."""
    folder = site.config.parent / "state" / "interventions"
    with locked(folder):
        verification = Verification(head_in(folder))
        entries = list(verification.read(files_in(folder)))
    verification.finish()
    assert verification.problems == []
    return entries


def until(site: Site, condition: Callable[[Entries], bool]) -> Entries:
    """Return the entries once the supervisor has written those that are meant."""
    head = site.config.parent / "state" / "interventions" / "head.json"
    return eventually(lambda: entries_of(site) if head.exists() else [], condition)


def has(entries: Entries, what: str, via: str, after: object = ...) -> bool:
    return any((one["what"], one["via"]) == (what, via) and after in (one["after"], ...) for one in entries)


def is_begun(entries: Entries) -> bool:
    """Whether the first status and the configuration are in the journal; their order is open."""
    return has(entries, "version", "start") and has(entries, "configuration", "start")


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def asked(address: str, path: str, body: object = None) -> Any:
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(f"{address}{path}", data, JSON)
    with urllib.request.urlopen(request, timeout=SECONDS) as answer:
        return json.load(answer)


def test_each_way_to_intervene_is_in_the_journal_with_before_after_and_who(tmp_path: Path) -> None:
    broker = Broker(tmp_path)
    broker.start()
    try:
        with site_in(tmp_path) as site:
            _intervene(site, broker)
    finally:
        broker.stop()


def _intervene(site: Site, broker: Broker) -> None:
    address = site.serve_page()
    token = site.config.parent / "shift.token"
    token.write_text(TOKEN)
    token.chmod(0o600)
    text = site.config.read_text().replace(
        f'listen = "{address.removeprefix("http://")}"',
        f'listen = "{address.removeprefix("http://")}"\n'
        'tokens = [{ name = "shift", file = "shift.token", acknowledge = true }]',
    )
    mqtt = f'\n[mqtt]\nhost = "127.0.0.1"\nport = {broker.port}\ncommands = true\n'
    site.config.write_text(text + mqtt)
    config_digest, ramp = sha256(site.config), sha256(site.table)
    assert ramp == hashlib.sha256(RAMP.encode()).hexdigest()
    with gateway_of(site) as (gateway, _):
        if "mqtt-connected" not in [note["event"] for note in gateway.notes]:
            gateway.until("mqtt-connected")
        entries = until(site, is_begun)
        first = {(one["what"], one["axis"] or one["file"]): one for one in entries}
        assert first["start", "supervisor"]["after"] == program.__version__
        assert first["version", "relay"]["after"] == program.__version__
        assert first["configuration", str(site.config)]["after"] == config_digest
        assert (first["table", "x"]["before"], first["table", "x"]["after"]) == (None, ramp)
        assert first["compensation", "x"]["after"] == "on"
        assert first["gain", "x"]["after"] == {"forward": 1.0, "backward": 1.0}
        count = len(entries)

        site.table.write_text(STEEPER)
        steeper = hashlib.sha256(STEEPER.encode()).hexdigest()
        [one] = until(site, lambda found: has(found, "table", "file"))[count:]
        assert (one["axis"], one["before"], one["after"], one["who"]) == ("x", ramp, steeper, None)

        assert typed("disable", str(site.config), "x").returncode == 0
        [one] = until(site, lambda found: has(found, "compensation", "socket"))[count + 1 :]
        assert (one["axis"], one["before"], one["after"]) == ("x", "on", "off")
        assert (one["who"]["user"], one["who"]["pid"]) == (os.geteuid(), os.getpid())

        topic = "pitch-gateway/trial/command/switch"
        publish.single(topic, '{"axes": ["x"], "on": true}', qos=1, hostname="127.0.0.1", port=broker.port)
        [one] = until(site, lambda found: has(found, "compensation", "mqtt"))[count + 2 :]
        assert (one["before"], one["after"]) == ("off", "on")
        assert f":{broker.port}" in one["who"]["broker"]

        asked_gain = SetGain(axes=("x",), forward=0.5, backward=0.25)
        assert ask(site.socket, asked_gain) == Done(changed=("x",), comes={"x": "next-target"})
        [one] = until(site, lambda found: has(found, "gain", "socket"))[count + 3 :]
        assert one["before"] == {"forward": 1.0, "backward": 1.0}
        assert one["after"] == {"forward": 0.5, "backward": 0.25}

        site.change('units = "mm"', 'units = "mm"\nmax_slope = 0.2')
        assert typed("reload", str(site.config)).returncode == 0
        changed = until(site, lambda found: has(found, "limits", "http"))[count + 4 :]
        by_what = {one["what"]: one for one in changed}
        assert by_what["configuration"]["before"] == config_digest
        assert by_what["configuration"]["after"] == sha256(site.config)
        limits = by_what["limits"]
        assert (limits["before"]["max_slope"], limits["after"]["max_slope"]) == (0.01, 0.2)
        assert by_what["configuration"]["who"]["pid"] == os.getpid()
        assert by_what["configuration"]["via"] == "http"

        assert ask(site.socket, Disable()) == Done(changed=("x",))
        alarm = eventually(lambda: asked(address, "/status")["troubles"], bool)[0]
        place = {key: alarm[key] for key in ("kind", "where", "since")}
        asked(address, "/acknowledge", place)
        one = until(site, lambda found: has(found, "acknowledged", "http"))[-1]
        assert one["after"] == place
        assert (one["who"]["name"], one["who"]["address"]) == ("shift", "127.0.0.1")

        _look_and_erase(site)


def _look_and_erase(site: Site) -> None:
    """The commands, while the gateway runs."""
    config = str(site.config)
    shown = typed("journal", "show", config, "--last", "1")
    assert (shown.returncode, shown.stderr) == (0, "")
    assert "acknowledged: – → {" in shown.stdout
    assert "http  address=127.0.0.1 name=shift" in shown.stdout
    assert json.loads(typed("journal", "show", config, "--json").stdout) == entries_of(site)
    last = entries_of(site)[-1]["digest"]
    exported = site.config.parent / "journal.jsonl"
    assert f"digest {last}\n" in typed("journal", "export", config, str(exported)).stdout
    assert typed("journal", "verify", config, "--head", last).returncode == 0
    done = typed("journal", "erase", config, "--person", "shift")
    assert (done.returncode, done.stdout) == (0, "who was taken out of 1 entries\n")
    entries = entries_of(site)
    assert entries[-2]["who"] is None
    assert (entries[-1]["what"], entries[-1]["who"]["pid"]) == ("erasure", os.getpid())
    assert typed("journal", "erase", config, "--person", "shift") == (
        1,
        "",
        f"{config}: no entry has exactly shift; `journal show --json` shows what is in `who`\n",
    )
    newest = {"seq": entries[-1]["seq"], "digest": entries[-1]["digest"]}
    eventually(
        lambda: json.loads(typed("status", config, "--json").stdout)["supervisor"]["journal"],
        lambda shown: shown == newest,
    )
    assert typed("journal", "verify", config, "--since", last).returncode == 0
    assert typed("journal", "verify", config, "--head", last).returncode == 1
    assert typed("journal", "verify", str(exported), "--head", last).returncode == 0


def test_what_changed_while_no_supervisor_ran_is_found_at_its_next_start(tmp_path: Path) -> None:
    with site_in(tmp_path) as site:
        site.compile()
        with running("relay", str(site.config)) as relay:
            relay.until("ready")
            with running("supervise", str(site.config)) as supervisor:
                supervisor.until("relay-reached")
                before = until(site, is_begun)
                supervisor.end()
            assert ask(site.socket, Disable()) == Done(changed=("x",))
            with running("supervise", str(site.config)) as supervisor:
                supervisor.until("relay-reached")
                start, one = until(site, lambda found: has(found, "compensation", "found"))[len(before) :]
        assert (start["what"], start["before"]) == ("start", program.__version__)
        assert (one["axis"], one["before"], one["after"], one["who"]) == ("x", "on", "off", None)


def test_a_supervisor_says_that_its_journal_was_changed_and_goes_on(tmp_path: Path) -> None:
    with site_in(tmp_path) as site:
        site.compile()
        with running("supervise", str(site.config)) as supervisor:
            supervisor.until("supervising")
            until(site, lambda found: has(found, "configuration", "start"))
            supervisor.end()
        [path] = files_in(site.config.parent / "state" / "interventions")
        path.write_bytes(path.read_bytes().replace(b'"what":"start"', b'"what":"stare"'))
        with running("supervise", str(site.config)) as supervisor:
            note = supervisor.until("interventions-damaged")
            assert note["detail"] == "000001.jsonl:1: entry 1 was changed: it has another digest"
            supervisor.end()
        assert b'"what":"start"' in path.read_bytes().splitlines()[-1]
        verified = typed("journal", "verify", str(site.config))
        assert (verified.returncode, verified.stderr.count("\n")) == (1, 1)
        assert "000001.jsonl:1: entry 1 was changed" in verified.stderr
