"""What this version of the gateway can do already: asked of itself, so that the bench grows with it."""

from dataclasses import dataclass, replace

from bench.candidates import free_port
from bench.gateway_process import refusal
from bench.gateway_setup import GatewaySetup


@dataclass(frozen=True, slots=True)
class Outputs:
    """A setup with the outputs that there are: a page, a broker that nobody runs."""

    setup: GatewaySetup
    page: str
    """Its address; empty where there is none."""
    missing: tuple[str, ...]


def with_outputs(setup: GatewaySetup) -> Outputs:
    """Add a page, and a broker at a port where nothing listens, as far as the gateway takes them."""
    missing: list[str] = []
    page = ""
    with_page = replace(setup, http_port=free_port())
    if refusal(with_page):
        missing.append("page")
    else:
        setup, page = with_page, f"http://127.0.0.1:{with_page.http_port}/"
    with_broker = replace(setup, mqtt_port=free_port())
    if refusal(with_broker):
        missing.append("MQTT")
    else:
        setup = with_broker
    return Outputs(setup, page, tuple(missing))
