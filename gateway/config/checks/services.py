"""Services: the page and MQTT."""

import os
from collections.abc import Mapping
from datetime import datetime
from ipaddress import ip_address
from pathlib import Path
from typing import Final

from gateway.config.checks.lines import WILDCARDS, controller_key, is_ipv6_alone, is_loopback, is_same
from gateway.config.files import (
    PASSWORD_KEY,
    TLS_KEY,
    NamedFileError,
    is_out_of_reach,
    path_of,
    read_password,
    read_token,
    server_context,
    tls_context,
    warn_of_list,
    warn_of_times,
    warn_out_of_reach,
)
from gateway.config.findings import Findings
from gateway.config.gateway_model import AlarmOutputSection, why_no_gpio
from gateway.config.http_model import HttpSection
from gateway.config.line_model import LineSection
from gateway.config.mqtt_model import MqttSection, TlsSection
from gateway.config.problems import key_text
from gateway.config.toml import KeyPath
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint

# --- Whether the status page can be served at its address, and who can see it there

KEY: Final = ("http", "listen")
TOKENS_KEY: Final = ("http", "tokens")


def check_http(findings: Findings, http: HttpSection, lines: Mapping[str, LineSection]) -> None:
    """Refuse an address that a controller connects to, and one beyond this machine without authentication."""
    _check_names(findings, http)
    endpoint = http.endpoint
    if endpoint is None or findings.is_refused(KEY):
        return
    _check_controllers(findings, endpoint, lines)
    if not is_loopback(endpoint.host):
        _check_open(findings, http, endpoint)
    if is_ipv6_alone(endpoint):
        findings.warn(
            KEY,
            f"{endpoint} takes IPv6 connections alone",
            f'for IPv4 only, write listen = "0.0.0.0:{endpoint.port}"; for both, use your own proxy, which '
            "reaches the page at 127.0.0.1; for IPv6 only, write the address of this machine",
        )


def check_http_files(findings: Findings, http: HttpSection, folder: Path, now: datetime) -> None:
    """Refuse token and TLS files that are missing, of another kind, or readable by every user.

    Warn of certificates that have expired or expire soon.
    """
    first: dict[str, str] = {}
    for index, token in enumerate(http.tokens):
        key = (*TOKENS_KEY, index, "file")
        if is_out_of_reach(token.file):
            warn_out_of_reach(findings, key, token.file)
            continue
        try:
            text = read_token(key, token.file, folder)
        except NamedFileError as error:
            findings.refuse(key, error.found, error.remedy)
            continue
        if text in first:
            found = f'the same token as that of "{first[text]}"'
            findings.refuse(key, found, f"make another one with pitch-gateway token {token.file} --force")
        first.setdefault(text, token.name)
    _check_tls(findings, http, folder, now)


def _check_tls(findings: Findings, http: HttpSection, folder: Path, now: datetime) -> None:
    if http.tls is None:
        return
    if http.tls.revoked is not None and http.tls.clients is None:
        findings.refuse(
            (*TLS_KEY, "revoked"),
            "a list of revoked certificates, but no clients",
            "add clients, the authority that signs certificates of clients, or remove the list",
        )
        return
    named = {
        "certificate": http.tls.certificate,
        "key": http.tls.key,
        "clients": http.tls.clients,
        "revoked": http.tls.revoked,
    }
    away = [key for key, file in named.items() if file is not None and is_out_of_reach(file)]
    for key in away:
        warn_out_of_reach(findings, (*TLS_KEY, key), str(named[key]))
    if away:
        return
    try:
        server_context(http.tls, folder, needs_client=False)
    except NamedFileError as error:
        findings.refuse(error.key, error.found, error.remedy)
        return
    for name in ("certificate", "clients"):
        file, path = named[name], (*TLS_KEY, name)
        if file is not None:
            warn_of_times(findings, path, path_of(path, file, folder), now)
    if named["revoked"] is not None:
        path = (*TLS_KEY, "revoked")
        warn_of_list(findings, path, path_of(path, named["revoked"], folder), now)


def _check_names(findings: Findings, http: HttpSection) -> None:
    names = [token.name for token in http.tokens]
    for index, name in enumerate(names):
        if name in names[:index]:
            key = (*TOKENS_KEY, index, "name")
            findings.refuse(key, f'a second token "{name}"', "give each token its own name")


def _check_open(findings: Findings, http: HttpSection, endpoint: TcpEndpoint) -> None:
    """Beyond this machine the page requires authentication, and secrets are never sent as plain text."""
    if findings.is_refused(TOKENS_KEY) or findings.is_refused(TLS_KEY):
        return  # the intended setting may be safe
    local = "or listen on 127.0.0.1 behind your own proxy, which can check the users"
    if http.tls is None and http.tokens:
        findings.refuse(
            KEY,
            f"anyone who reads the network traffic of {endpoint} could copy and use the tokens",
            f"add [http.tls] with certificate and key, {local}",
        )
    elif http.tls is None:
        findings.refuse(
            KEY,
            f"anyone who reaches {endpoint} could read the status of the gateway",
            f"add tokens or clients, and [http.tls] with certificate and key, {local}",
        )
    elif not http.tokens and http.tls.clients is None:
        findings.refuse(
            KEY,
            f"anyone who reaches {endpoint} could read the status of the gateway",
            f"add tokens, or clients to [http.tls], {local}",
        )


def _check_controllers(findings: Findings, endpoint: TcpEndpoint, lines: Mapping[str, LineSection]) -> None:
    for name, line in lines.items():
        for i, controller in enumerate(line.controllers):
            if is_same(endpoint, controller.endpoint, wildcard_hosts=WILDCARDS):
                key = (*controller_key(findings, name, controller.name, i), controller.way)
                findings.refuse(
                    KEY,
                    f"{endpoint} is already the listener of {key_text(key)}",
                    'give the page another port, or listen = "" for none',
                )


# --- Whether the device of ``[alarm_output]`` is one of its own


def check_alarm_output(
    findings: Findings, output: AlarmOutputSection | None, lines: Mapping[str, LineSection]
) -> None:
    """Refuse a GPIO line without the package for it.

    Refuse a device of a line: a coil of a drive may start a motion, and a serial port serves one program.

    The address of a controller leads to the drives, through the gateway.
    """
    if output is None:
        return
    if output.gpio is not None:
        if missing := why_no_gpio():
            found, _, remedy = missing.partition("; ")
            findings.refuse(("alarm_output", "gpio"), found, remedy)
        return
    endpoint = output.modbus.endpoint
    for name, line in lines.items():
        uses: list[tuple[KeyPath, TcpEndpoint | SerialEndpoint]] = [
            (("line", name, "drives"), line.drives.endpoint)
        ]
        for i, controller in enumerate(line.controllers):
            uses.append((controller_key(findings, name, controller.name, i), controller.endpoint))
        for key, other in uses:
            if _is_one_device(endpoint, other):
                findings.refuse(
                    ("alarm_output", "device"),
                    f"{endpoint} is already used by {key_text(key)}",
                    "name a device with an address or a serial port of its own; a coil of a drive may start "
                    "a motion",
                )
    if output.unit_id == 0 and (isinstance(endpoint, SerialEndpoint) or endpoint.rtu):
        findings.refuse(
            ("alarm_output", "unit_id"),
            "found 0, which on RTU is all devices, and none replies",
            "write the unit id of the device",
        )


def _is_one_device(one: TcpEndpoint | SerialEndpoint, other: TcpEndpoint | SerialEndpoint) -> bool:
    if isinstance(one, SerialEndpoint) and isinstance(other, SerialEndpoint):
        return os.path.realpath(one.device) == os.path.realpath(other.device)
    return is_same(one, other, wildcard_hosts=WILDCARDS)


# --- Whether ``[mqtt]`` can work: its files, and who could intercept its password


def check_mqtt(findings: Findings, mqtt: MqttSection | None, folder: Path, now: datetime) -> None:
    """Refuse files that are missing, of another kind, or secret and readable by every user.

    Warn of a certificate that has expired or expires soon.
    """
    if mqtt is None:
        return
    if mqtt.password_file is not None:
        _check_password(findings, mqtt, mqtt.password_file, folder)
    if mqtt.username is not None and mqtt.tls is None and not _is_here(mqtt.host):
        findings.warn(
            ("mqtt", "username"),
            f"the password goes to {mqtt.host} as plain text",
            "add tls, if the broker offers it",
        )
    if mqtt.tls is not None:
        _check_broker_tls(findings, mqtt.tls, folder, now)


def _check_broker_tls(findings: Findings, tls: TlsSection, folder: Path, now: datetime) -> None:
    for name, other in (("cert", "key"), ("key", "cert")):
        if getattr(tls, name) is not None and getattr(tls, other) is None:
            findings.refuse(("mqtt", "tls", name), f"without {other}", f"give {other} as well, or neither")
            return
    named = {key: file for key in ("ca", "cert", "key") if (file := getattr(tls, key)) is not None}
    away = [key for key, file in named.items() if is_out_of_reach(file)]
    for key in away:
        warn_out_of_reach(findings, ("mqtt", "tls", key), named[key])
    if away:
        return
    try:
        tls_context(tls, folder)
    except NamedFileError as error:
        findings.refuse(error.key, error.found, error.remedy)
        return
    if tls.cert is not None:
        path = ("mqtt", "tls", "cert")
        warn_of_times(findings, path, path_of(path, tls.cert, folder), now)


def _check_password(findings: Findings, mqtt: MqttSection, file: str, folder: Path) -> None:
    if mqtt.username is None:
        remedy = "give username as well: MQTT 3.1.1 has no password without one"
        findings.refuse(PASSWORD_KEY, "without username", remedy)
    elif is_out_of_reach(file):
        warn_out_of_reach(findings, PASSWORD_KEY, file)
    else:
        try:
            read_password(file, folder)
        except NamedFileError as error:
            findings.refuse(error.key, error.found, error.remedy)


def _is_here(host: str) -> bool:
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
