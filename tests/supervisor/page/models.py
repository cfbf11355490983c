"""Status models as a gateway publishes them, small enough to read."""

from collections.abc import Mapping
from typing import Any, Final

BOUNDS_US: Final = [5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000]
BELOW: Final = [0, 0, 0, 120, 5200, 9100, 9900, 9985, 9998, 10_000, 10_000, 10_000, 10_000, 10_000, 10_000]
TIMES: Final = {"p50": 96.2, "p99": 310.5, "p999": 940.0, "max": 1902.4, "max_minute": 702.0, "below": BELOW}


def axis(**changes: Any) -> dict[str, Any]:
    """Return one axis that stands at -120 mm and is corrected by 22.1 µm; its place follows what is read."""
    found = {
        "compensation": "active",
        "verdict": verdict(),
        "units": "mm",
        "direction": "forward",
        "gain": {"forward": 1.0, "backward": 1.0},
        "travel": [-300.0, 0.0],
        "correction": 0.0221,
        "nominal_setpoint": -120.0,
        "corrected_setpoint": -119.9779,
        "nominal_actual": -120.0,
        "corrected_actual": -119.9779,
        "table": table(),
        "latency": {"gateway_us": TIMES, "budget_us": 1000.0, "budget_overruns": 15, "is_over_budget": False},
        **changes,
    }
    return {"position": place(found), **found}


def place(axis: Mapping[str, Any]) -> dict[str, Any]:
    """Return where an axis is that has just been read, or else was sent to a target a minute ago."""
    if axis["nominal_actual"] is not None:
        nominal, corrected = axis["nominal_actual"], axis["corrected_actual"]
        return {
            "of": "reading",
            "nominal": nominal,
            "corrected": corrected,
            "age_s": 0.1,
            "is_at_least": False,
        }
    is_shadow = axis["compensation"] == "shadow"
    return {
        "of": "target",
        "nominal": axis["nominal_setpoint"],
        "corrected": axis["nominal_setpoint" if is_shadow else "corrected_setpoint"],
        "age_s": 60.0,
        "is_at_least": False,
    }


def verdict(state: str = "healthy", kind: str = "active", title: str = "") -> dict[str, Any]:
    """Return how an axis is."""
    return {"state": state, "kind": kind, "title": title, "since": "2026-05-01T12:00:00+00:00"}


def table(**changes: Any) -> dict[str, Any]:
    """Return the state of a table that is in force."""
    return {
        "file": "cnc10x.tab",
        "format": "centroid-3",
        "sha256": "55" * 32,
        "compiled": "16" * 32,
        "points": 31,
        "status": "active",
        "error": None,
        "problems": [],
        "loaded_at": "2026-11-21T06:02:11+00:00",
        **changes,
    }


def line(**changes: Any) -> dict[str, Any]:
    """Return a line with a controller for motion and a monitor."""
    return {
        "state": "up",
        "exchanges": 10_000,
        "timeouts": 0,
        "crc_errors": 0,
        "exceptions": 2,
        "late": 0,
        "refused": 0,
        "budget_overruns": 15,
        "gateway_us": TIMES,
        "drives": {"address": "/dev/serial/by-id/usb-FTDI_B", "failure": "", "opens": 1},
        "controllers": [
            {
                "name": "cnc",
                "role": "motion",
                "address": "/dev/serial/by-id/usb-FTDI_A",
                "state": "up",
                "failure": "",
                "gateway_us": TIMES,
                "asked_s": 0.1,
                "silent_s": 0.2,
            },
            {
                "name": "hmi",
                "role": "monitor",
                "address": ["127.0.0.1:1502"],
                "connections": ["127.0.0.1:40944"],
                "gateway_us": TIMES,
            },
        ],
        **changes,
    }


def model(
    axes: Mapping[str, Any] | None = None,
    lines: Mapping[str, Any] | None = None,
    *troubles: Mapping[str, Any],
) -> dict[str, Any]:
    """Return a whole model, of one axis on one line where nothing else is said; its worst trouble decides."""
    severities = [each["severity"] for each in troubles]
    return {
        "gateway": {
            "name": "mill-1",
            "version": "0.1.0",
            "uptime_s": 273_725.0,
            "relay": "up",
            "snapshot_age_s": 0.1,
            "latency_bounds_us": BOUNDS_US,
        },
        "lines": {"xyz": line()} if lines is None else dict(lines),
        "axes": {"x": axis()} if axes is None else dict(axes),
        "supervisor": {},
        "verdict": {
            "state": min(severities, default="healthy", key="error warning".find),
            "since": "2026-05-01T12:00:00+00:00",
            "errors": severities.count("error"),
            "warnings": severities.count("warning"),
        },
        "troubles": list(troubles),
    }


def trouble(**changes: str) -> dict[str, str]:
    """Return what the gateway says of a rejected table."""
    return {
        "kind": "table-rejected",
        "severity": "error",
        "where": "axis x",
        "what": "cnc10x.tab:12:3: not a number: 0.0x (the last good table of 31 points stays)",
        "remedy": "correct the file: it is read again when saved",
        "audience": "operator",
        "since": "2026-05-01T12:00:00+00:00",
        **changes,
    }


def curve(**changes: Any) -> dict[str, Any]:
    """Return a table from -300 to 0 mm: forward up to 30 µm, backward 25 µm above it; gain included."""
    positions = [-300.0 + 10.0 * index for index in range(31)]
    forward = [0.0001 * -position for position in positions]
    return {
        "axis": "x",
        "units": "mm",
        "digest": "16" * 32,
        "positions": positions,
        "forward": forward,
        "backward": [correction + 0.025 for correction in forward],
        "travel": [-300.0, 0.0],
        "gain": {"forward": 1.0, "backward": 1.0},
        **changes,
    }
