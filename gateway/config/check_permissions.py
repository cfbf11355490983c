"""What the user may not open: ports below 1024, serial ports of a group that he is not in."""

import os
from collections.abc import Iterator

from gateway.config.check_lines import controller_key, drives_key
from gateway.config.findings import Findings
from gateway.config.sections import Sections
from gateway.config.toml_lines import KeyPath
from gateway.ipc.place import ROOT_UID
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.permissions import why_no_device, why_no_port


def check_permissions(findings: Findings, sections: Sections, *, is_start: bool) -> None:
    """Refuse what this user may not open where he is about to; where he only checks he is warned.

    Root often checks what another user will run, and is told nothing of that.
    """
    if not is_start and os.geteuid() == ROOT_UID:
        return
    say = findings.refuse if is_start else findings.warn
    for key, place in _opened(findings, sections):
        why = why_no_device(place) if isinstance(place, SerialEndpoint) else why_no_port(place)
        if why is not None and not findings.is_refused(key):
            say(key, *why)


def _opened(findings: Findings, sections: Sections) -> Iterator[tuple[KeyPath, TcpEndpoint | SerialEndpoint]]:
    for name, line in sections.lines.items():
        if isinstance(line.drives.endpoint, SerialEndpoint):
            yield drives_key(name, line), line.drives.endpoint
        for index, controller in enumerate(line.controllers):
            key = (*controller_key(findings, name, controller.name, index), controller.way)
            yield key, controller.endpoint
    if sections.http.endpoint is not None:
        yield ("http", "listen"), sections.http.endpoint
