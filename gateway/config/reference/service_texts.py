"""Texts of the sections that are about the gateway as a program."""

from typing import Final

from gateway.config.reference.text import Said, Texts

GATEWAY: Final[Texts] = {
    "tables": Said(
        kind="path",
    ),
    "state": Said(
        meaning=(
            "folder of what the gateway keeps, relative to the configuration file: the compiled "
            "configuration and tables, `axis-NAME.record`, with which an axis goes on after a restart, "
            "and while it runs `relay.sock`, over which commands and the supervisor find it (see "
            "[operations.md](operations.md)). Made where it is missing; one for each gateway"
        ),
        kind="path",
    ),
}

RELAY: Final[Texts] = {
    "fifo": Said(
        meaning=(
            "real-time priority (SCHED_FIFO): goes before everything without one. 0: as the process "
            "was started"
        ),
    ),
    "cpus": Said(
        meaning=(
            "CPUs to run on, each once; `[]`: any. When one of them is not there, at the start, none "
            "of them is kept to"
        ),
    ),
}

HTTP: Final[Texts] = {
    "listen": Said(
        meaning=(
            "address of the page and of everything else that is served over HTTP ([http](http.md)); "
            '`""`: none over TCP. `[::]` takes IPv6 connections alone. Changes nothing at the machine'
        ),
        kind='`"HOST:PORT"`, `"[IPv6]:PORT"` or `""`',
    ),
    "tokens": Said(
        meaning=(
            '`[{ name = "prometheus", file = "prometheus.token" }]`: with one of these tokens somebody may '
            "look; with `acknowledge = true` he may also acknowledge alarms "
            "([http](http.md#post-acknowledge)). `name` is for the log, `file` holds the token on one "
            "line and nothing else; `pitch-gateway token FILE` makes one. Files are read again when "
            "they change. Asked for over TCP everywhere, this machine included, never on the Unix socket"
        ),
        kind="list of tables, 16 at most",
        default="none: nobody is asked for one",
    ),
    "tls": Said(
        meaning=(
            "`certificate` and its `key`, both in PEM, the key not encrypted; with `clients`, the "
            "authorities that sign certificates of "
            "clients, whoever has such a certificate may look, with or without a token, but for those in the "
            "authorities' list `revoked`. Read anew by `reload`"
        ),
        default="none: no TLS",
    ),
}

MQTT: Final[Texts] = {
    "port": Said(
        more="Brokers have TLS at 8883 as a rule",
    ),
    "base_topic": Said(
        meaning=(
            "what every topic begins with, followed by the name of the gateway. Levels between "
            "slashes; refused: `+`, `#`, control characters, an empty level, a `$` in front"
        ),
        kind="topic",
    ),
    "version": Said(
        meaning=(
            "of MQTT. Every broker speaks 3.1.1; 5 says more exactly why it refuses something, and "
            "lets who commands say where the answer shall go"
        ),
    ),
    "client_id": Said(
        meaning="what the gateway calls itself; a broker lets only one client of a name in",
        default='`"pitch-gateway-NAME"`',
    ),
    "keepalive_s": Said(
        meaning="after one and a half times this without a word the broker takes the gateway for dead",
    ),
    "username": Said(
        more="Warned of: without `tls`, to another machine",
        default="none",
    ),
    "password_file": Said(
        meaning=(
            "file with the password on one line and nothing else, relative to this file; or "
            "`credential:NAME`; read anew "
            "for each connection. Needs `username`"
        ),
        default="none",
    ),
    "tls": Said(
        meaning=(
            '`{}` trusts the authorities of the system; `{ ca = "ca.pem" }` those in a file; with '
            "`cert` and `key`, both in PEM, the gateway shows a certificate of its own. The key must "
            "not be encrypted. Paths are relative to this file, or `credential:NAME`"
        ),
        default="none: no TLS",
    ),
    "discovery": Said(
        meaning='prefix of Home Assistant\'s discovery, `"homeassistant"` unless it was changed there',
        kind='topic or `""`',
        default='`""`: off',
    ),
    "commands": Said(
        meaning=(
            "`true`: who may write to the broker's `BASE/NAME/command/…` may reload, enable, disable "
            "and set gains. Nothing moves an axis by itself"
        ),
    ),
}

STATUS_UNIT: Final[Texts] = {
    "id": Said(
        more=(
            "Nor of another device on any line: what is asked there never reaches one. Read-only "
            "([registers](status-registers.md)). 248 and above are reserved on serial lines and free in "
            "practice; some panels reach 247 at most"
        ),
    ),
}

CAPTURE: Final[Texts] = {
    "size_mb": Said(
        more=(
            "An exchange takes about 130 bytes: 4 MB are five minutes of a hundred exchanges in a second, "
            "or half a minute of a thousand. Changed at the next start"
        ),
    ),
    "on": Said(
        more=(
            'As in `["drive-silent", "axis-blocked"]`; `pitch-gateway explain` knows all. The supervisor '
            "writes `capture-TIME-EVENT.jsonl` into the folder of the state, 2 s after the event, once a "
            "minute at most"
        ),
        kind="list of events",
    ),
}

GROUP: Final[Texts] = {
    "axes": Said(
        more="At least two",
    ),
}
