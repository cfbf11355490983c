"""Keys that a reload takes over while the gateway runs (docs/operations.md)."""

import pytest

from gateway.config.sections import is_live


@pytest.mark.parametrize(
    "key",
    [
        "axis.x.table",
        "axis.x.table_options.file_start",
        "axis.x.compensation",
        "axis.x.gain",
        "axis.x.gain.backward",
        "axis.x.max_correction",
        "axis.x.max_slope",
        "axis.x.travel_margin",
        "axis.x.budget_us",
        "axis.x.thermal.source.mqtt",
        "line.xyz.controllers[1].silent_after_s",
        "gateway.tables",
        "http",
        "http.tokens[2].file",
        "mqtt.tls.ca",
        "capture.on[1]",
        "capture.keep",
    ],
)
def test_a_reload_takes_over_what_the_relay_can_be_given_and_what_only_the_supervisor_needs(key: str) -> None:
    assert is_live(key)


@pytest.mark.parametrize(
    "key",
    [
        "axis.x",
        "axis.x.unit_id",
        "axis.x.travel[1]",
        "axis.x.unseen_ms",
        "axis.x.thermal.alpha",
        "axis.table",
        "line.xyz.controllers[1].timeout_ms",
        "line.xyz.cut_through",
        "gateway.state",
        "relay.fifo",
        "capture.size_mb",
        "status_unit.id",
        "tables",
    ],
)
def test_everything_else_needs_a_restart(key: str) -> None:
    assert not is_live(key)
