"""The page of metrics, read as Prometheus reads it."""

from typing import Any

from prometheus_client.metrics_core import Metric
from prometheus_client.openmetrics.parser import text_string_to_metric_families as parse_openmetrics
from prometheus_client.parser import text_string_to_metric_families as parse_text

from gateway.supervisor.broadcast import Broadcast
from gateway.supervisor.http.metrics import Metrics
from tests.support.status_models import model_of

Samples = dict[tuple[str, tuple[tuple[str, str], ...]], float]


def families(newest: dict[str, Any] | None, accept: str = "") -> list[Metric]:
    broadcast = Broadcast()
    if newest is not None:
        broadcast.publish(model_of(newest))
    body, media_type = Metrics(broadcast).page(accept)
    parse = parse_openmetrics if "openmetrics" in media_type else parse_text
    return list(parse(body.decode()))


def samples(newest: dict[str, Any] | None, accept: str = "") -> Samples:
    """Return all samples by name and labels."""
    return {
        (sample.name, tuple(sorted(sample.labels.items()))): sample.value
        for family in families(newest, accept)
        for sample in family.samples
    }
