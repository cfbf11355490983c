"""The whole status model: what the relay says, with what only the supervisor knows.

It is made anew for each snapshot and never changed afterwards.
"""

import time
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

import gateway
from gateway.supervisor.book import Entry
from gateway.supervisor.chronicle import Chronicle
from gateway.supervisor.trouble import of_axis, troubles


def whole_model(
    name: str,
    snapshot: Mapping[str, Any] | None,
    *,
    is_relay_up: bool,
    snapshot_age_s: float | None,
    tables: Mapping[str, Entry],
    supervisor: Mapping[str, Any],
    chronicle: Chronicle | None = None,
) -> dict[str, Any]:
    """Return the model.

    Args:
        name: of the gateway.
        snapshot: the relay's model; None when it has not been reached yet.
        is_relay_up: whether the relay is connected.
        snapshot_age_s: how old the snapshot is.
        tables: what is known of the table files, by axis.
        supervisor: what the supervisor says of itself: ``configuration``, ``tables_folder``,
            ``state_folder``, ``http`` and ``mqtt``, each with a ``problem`` that is None where all is well.
        chronicle: what is remembered of the time before; None: nothing is.
    """
    now_s = time.monotonic()
    chronicle = chronicle or Chronicle()
    chronicle.take(snapshot, now_s)
    relay_gateway = {} if snapshot is None else snapshot["gateway"]
    axes = {} if snapshot is None else snapshot["axes"]
    model: dict[str, Any] = {
        "gateway": {
            "name": name,
            "version": gateway.__version__,
            "uptime_s": None,
            **relay_gateway,
            "relay": "up" if is_relay_up else "down",
            "snapshot_age_s": None if snapshot_age_s is None else round(snapshot_age_s, 3),
        },
        "lines": {} if snapshot is None else snapshot["lines"],
        "axes": {axis: _with_file(status, tables.get(axis)) for axis, status in axes.items()},
        "supervisor": dict(supervisor),
    }
    found = troubles(model)
    chronicle.acknowledged.follow(found, now_s)
    model["troubles"] = chronicle.stamp(found, datetime.now(UTC))
    for axis, status in model["axes"].items():
        status["trouble"] = of_axis(found, axis)
        status["last_seen"] = chronicle.last(axis, now_s)
    return model


def _with_file(status: Mapping[str, Any], entry: Entry | None) -> dict[str, Any]:
    overlay = {} if entry is None else entry.overlay()
    return {**status, "table": {**status["table"], **overlay}}
