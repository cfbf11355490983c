"""What came over TLS is recorded with the role of its certificate, and replayed with it."""

from dataclasses import replace
from pathlib import Path

import pytest

from gateway.exchange.plan import Role
from gateway.recording.replay import Replay, ReplayError
from gateway.recording.traffic import FORMAT, Header, Request, decode
from gateway.recording.writer import Recorder
from gateway.relay.gateway import Relay
from gateway.state.plan import RoleRights, TlsPlan
from tests.relay.secure_site import WRITE, WRITTEN, Site, ask
from tests.support.relay import Bench, until_up


async def test_a_recording_is_replayed_with_the_role_that_each_connection_had(
    bench: Bench, tmp_path: Path
) -> None:
    site = Site(bench, tmp_path)
    await site.start()
    [line] = site.relay_plan.lines
    recorder = Recorder(
        tmp_path / "record.jsonl", Header(FORMAT, "0", "2026-01-01T00:00:00+00:00", "g.toml", "")
    )
    relay = Relay(site.relay_plan, recorder=recorder)
    await relay.start()
    site.relay = relay
    await until_up(relay)
    monitor = await site.connect(site.shop.controller("hmi", "Beobachter Süd"))
    mover = await site.connect(site.shop.controller("mill", "Operator"))
    assert await ask(monitor, WRITE) == b"\x90\x01"
    assert await ask(mover, WRITE) == WRITTEN
    for stream in (monitor, mover):
        stream[1].close()
    await relay.stop()
    entries = [decode(each) for each in site.recorded(tmp_path / "record.jsonl")]
    requests = [each for each in entries if isinstance(each, Request)]
    assert [each.role for each in requests] == ["Beobachter Süd", "Operator"]
    replay = Replay(site.relay_plan)
    for number, entry in enumerate(entries, start=1):
        replay.feed(number, entry)
    assert (replay.result.different, replay.result.outputs > 0) == (0, True)
    link = replace(line.controllers[0], tls=TlsPlan(site.files, {"Operator": RoleRights(Role.MOTION)}))
    other = Replay(replace(site.relay_plan, lines=(replace(line, controllers=(link,)),)))
    before = entries.index(requests[0])
    for number, entry in enumerate(entries[:before], start=1):
        other.feed(number, entry)
    with pytest.raises(ReplayError, match="controller cnc has no role 'Beobachter Süd'"):
        other.feed(before + 1, requests[0])
