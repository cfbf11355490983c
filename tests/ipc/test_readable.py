"""What was recorded, in words: each kind of entry has some."""

from typing import get_args

from gateway.ipc import traffic
from gateway.ipc.plan import GatewayPlan
from gateway.ipc.readable import Reader

KINDS = [*get_args(traffic.Input), *get_args(traffic.Output)]
SAID: dict[traffic.Input | traffic.Output, str] = {
    traffic.Request("xyz", 0, 1, "cnc", 7, 1, "0300640002"): (
        "controller → cnc#1  unit 1  read holding registers  03 00 64 00 02"
    ),
    traffic.Gone("xyz", 0, 1): "cnc#1 has gone",
    traffic.Sent("xyz", 1, "0300640002"): (
        "          → drive  unit 1  read holding registers  03 00 64 00 02"
    ),
    traffic.Reply("xyz", 0, 1, "8302"): (
        "          ← drive  unit 1  exception 2 (illegal data address)  83 02"
    ),
    traffic.Answered("xyz", 1, 7, 1, "8302"): (
        "controller ← cnc#1  unit 1  exception 2 (illegal data address)  83 02"
    ),
    traffic.Abandoned("xyz"): "          × the reply is not waited for any longer",
    traffic.Stray("xyz", 0, is_frame=True): "          ← bytes that answer nothing (a whole frame)",
    traffic.Unframed("xyz", 0): "          ← bytes of which no frame was made yet",
    traffic.RestFirst("xyz", 0): "the gateway before left something unanswered: the line rests first",
    traffic.Up("xyz", 0): "the drives can be reached",
    traffic.Down("xyz", 0): "the drives cannot be reached",
    traffic.Tick("xyz", 0): "a deadline passed",
    traffic.Stop("xyz", 0): "the gateway stops",
    traffic.Beginning("xyz", 0, (), is_up=True): "what holds while the line is idle: a replay may begin here",
    traffic.Control("xyz", 0, "disable", "x"): "command disable x",
    traffic.Tables(
        "xyz", 0, (traffic.Table("x", "x.tab", "csv", "", b""), traffic.Table("y", "y.tab", "csv", "", b""))
    ): "table of x, y",
    traffic.Share("xyz", 0, "x", 0.5, 1.0): "gain of x: forward 0.5, backward 1",
    traffic.Limits("xyz", 0, "x", 0.25, 0.01, 0.5, 1000.0): "limits of x: max_correction 0.25",
    traffic.Temperature("xyz", 0, "x", 21.5): "temperature of x: 21.5 °C",
}


def test_each_kind_of_entry_is_here() -> None:
    assert {type(entry) for entry in SAID} == set(KINDS)


def test_each_kind_of_entry_has_its_words() -> None:
    reader = Reader(GatewayPlan(name="mill", lines=()))
    assert {entry: reader.text(entry) for entry in SAID} == SAID
