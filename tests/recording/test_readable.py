"""Every entry of a recording is read out in words: nothing that a line can meet stops ``capture``."""

from typing import Final, get_args

import pytest

from gateway.exchange.commands import (
    Enable,
    SetGain,
    SetLimits,
    SetReference,
    SetTable,
    SetTemperature,
    TableFor,
)
from gateway.recording import traffic
from gateway.recording.readable import Reader
from gateway.state.plan import GatewayPlan

LIMITS: Final = SetLimits(axis="x", max_correction=0.5, max_slope=0.1, travel_margin=2.0, budget_us=150.0)
ENTRIES: Final[dict[traffic.Input | traffic.Output, str]] = {
    traffic.Request("xyz", 7, 1, "cnc", 0, 2, "0300640002"): (
        "controller → cnc#1  unit 2  read holding registers  03 00 64 00 02"
    ),
    traffic.Gone("xyz", 7, 3): "#3 has disconnected",
    traffic.Reply("xyz", 7, 2, "8302"): "← drive  unit 2  exception 2 (illegal data address)  83 02",
    traffic.Stray("xyz", 7, is_frame=True, unit=2): "← bytes that are no reply (a whole frame)",
    traffic.RestFirst("xyz", 7): "the previous gateway left a request unanswered: the line rests first",
    traffic.Up("xyz", 7): "the drives can be reached",
    traffic.Down("xyz", 7): "the drives cannot be reached",
    traffic.Unframed("xyz", 7): "← bytes of which no frame was made yet",
    traffic.Tick("xyz", 7): "a deadline passed",
    traffic.Stop("xyz", 7): "the gateway stops",
    traffic.Beginning("xyz", 7, (), is_up=True): "the line is idle: a replay may begin here",
    traffic.Commanded("xyz", 7, Enable(axes=("x",))): "command enable x",
    traffic.Commanded("xyz", 7, SetReference(axis="x")): "command reference x",
    traffic.Commanded("xyz", 7, SetTable(tables=(TableFor("x", "x.tab", "centroid-3", "0" * 64),)), (b"",)): (
        "command set-table x x.tab"
    ),
    traffic.Commanded("xyz", 7, SetGain(axes=("x",), forward=0.5, backward=1.0)): "command set-gain x 0.5 1",
    traffic.Commanded("xyz", 7, LIMITS): "command set-limits x",
    traffic.Commanded("xyz", 7, SetTemperature(axis="x", celsius=21.5)): "command set-temperature x 21.5 °C",
    traffic.Sent("xyz", 2, "06006400ff"): "→ drive  unit 2  write single register  06 00 64 00 ff",
    traffic.Abandoned("xyz"): "× the reply is not waited for any longer",
    traffic.Paced("xyz", 9): "… the wire needs a silence before the next frame",
    traffic.Answered("xyz", 1, 9, 2, "0304000000ff"): (
        "controller ← #1  unit 2  read holding registers  03 04 00 00 00 ff"
    ),
}


@pytest.mark.parametrize("kind", get_args(traffic.Input) + get_args(traffic.Output))
def test_each_kind_of_entry_is_read_out(kind: type) -> None:
    found = {entry: words for entry, words in ENTRIES.items() if isinstance(entry, kind)}
    assert found, f"{kind.__name__} is missing in ENTRIES"
    for entry, words in found.items():
        assert Reader(GatewayPlan("mill", ())).text(entry).strip() == words
