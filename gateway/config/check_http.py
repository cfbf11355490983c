"""Whether the status page can be where it should be, and who can see it there."""

from collections.abc import Mapping
from typing import Final

from gateway.config.check_lines import WILDCARDS, controller_key, is_loopback, is_same
from gateway.config.findings import Findings
from gateway.config.gateway_model import HttpSection
from gateway.config.line_model import LineSection
from gateway.config.problems import key_text
from gateway.transport.endpoints import TcpEndpoint

KEY: Final = ("http", "listen")


def check_http(findings: Findings, http: HttpSection, lines: Mapping[str, LineSection]) -> None:
    """Refuse an address that a controller connects to; warn of one that others than this machine reach."""
    place = http.endpoint
    if place is None or findings.is_refused(KEY):
        return
    _check_controllers(findings, place, lines)
    if not is_loopback(place.host):
        findings.warn(
            KEY,
            f"whoever reaches {place} can read the status of the gateway; nothing can be changed there",
            "listen on 127.0.0.1, or let a firewall or a proxy decide who may",
        )


def _check_controllers(findings: Findings, place: TcpEndpoint, lines: Mapping[str, LineSection]) -> None:
    for name, line in lines.items():
        for i, controller in enumerate(line.controllers):
            if controller.tcp is not None and is_same(place, controller.tcp, wildcard_hosts=WILDCARDS):
                key = (*controller_key(findings, name, controller.name, i), "tcp")
                findings.refuse(
                    KEY,
                    f"{place} is listened on by {key_text(key)} already",
                    'give the page another port, or listen = "" for none',
                )
