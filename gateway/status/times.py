"""Times of the gateway and the drives, in microseconds since the start."""

from msgspec import UNSET, Struct, UnsetType


class Figures(Struct, frozen=True, kw_only=True):
    """Percentiles; None: not calculated yet. 0.0 if nothing was measured."""

    p50: float | None = None
    p99: float | None = None
    p999: float | None = None


NOT_WORKED_OUT = Figures()


class GatewayTimes(Struct, frozen=True, kw_only=True):
    """The gateway's own time for an exchange, both ways together."""

    p50: float | None = None
    p99: float | None = None
    p999: float | None = None
    max: float = 0.0
    max_minute: float = 0.0
    below: list[int] | UnsetType = UNSET
    """Exchanges up to each of ``gateway.latency_bounds_us``, and all."""


NOTHING_MEASURED = GatewayTimes()
