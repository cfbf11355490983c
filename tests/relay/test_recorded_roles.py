"""What came over TLS is recorded with the role of its certificate, and replayed with it."""

from dataclasses import replace
from pathlib import Path

import pytest

from gateway.exchange.plan import Role
from gateway.recording.replay import ReplayError
from gateway.recording.traffic import Request, decode
from gateway.recording.writer import Recorder
from gateway.relay.gateway import Relay
from gateway.state.plan import RoleRights, TlsPlan
from tests.relay.secure_site import WRITE, WRITTEN, Site, ask
from tests.support.recordings import HEADER, replayed
from tests.support.relay import Bench, until_up


async def test_a_recording_is_replayed_with_the_roles(bench: Bench, tmp_path: Path) -> None:
    site = Site(bench, tmp_path)
    await site.start()
    [line] = site.relay_plan.lines
    relay = Relay(site.relay_plan, recorder=Recorder(tmp_path / "record.jsonl", HEADER))
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
    result = replayed(site.relay_plan, entries)
    assert (result.different, result.outputs > 0) == (0, True)
    link = replace(line.controllers[0], tls=TlsPlan(site.files, {"Operator": RoleRights(Role.MOTION)}))
    other = replace(site.relay_plan, lines=(replace(line, controllers=(link,)),))
    before = entries[: entries.index(requests[0])]
    assert replayed(other, before).different == 0
    with pytest.raises(ReplayError, match="controller cnc has no role 'Beobachter Süd'"):
        replayed(other, [*before, requests[0]])
