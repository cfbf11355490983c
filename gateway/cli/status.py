"""``pitch-gateway status CONFIG``, and ``pitch-gateway status URL…`` for many gateways."""

import socket
from pathlib import Path
from typing import Annotated, Final

import typer

from gateway.cli.configuration import state_folder_or_exit
from gateway.cli.output import Format, show

URL_STARTS: Final = ("http://", "https://")
FLEET_COLUMNS: Final = 160
"""Of the table of many gateways, if standard output is no terminal."""


def status(
    config: Annotated[
        list[str],
        typer.Argument(
            metavar="CONFIG|URL",
            help="Configuration of a gateway on this computer; or addresses of pages.",
            show_default=False,
        ),
    ],
    *,
    as_json: Annotated[bool, typer.Option("--json", help="Print the whole status as JSON.")] = False,
    watch: Annotated[
        bool, typer.Option("--watch", help="Update until Ctrl-C; with --json: a line for each change.")
    ] = False,
    token_file: Annotated[
        Path | None,
        typer.Option("--token-file", metavar="FILE", help="With URLs: the token that is sent to each."),
    ] = None,
    ca: Annotated[
        Path | None,
        typer.Option(
            "--ca", metavar="FILE", help="With URLs: the authority that signed their certificates, PEM."
        ),
    ] = None,
    certificate: Annotated[
        Path | None,
        typer.Option("--certificate", metavar="FILE", help="With URLs: your certificate for them, PEM."),
    ] = None,
    key: Annotated[
        Path | None, typer.Option("--key", metavar="FILE", help="The key of --certificate, PEM.")
    ] = None,
) -> None:
    """Show the state of the running gateway of CONFIG, or of many gateways. It changes nothing.

    It shows alarms with their remedies, the gateway, lines with their controllers, and axes with positions in
    their units. It also shows how long the gateway took for frames (microseconds), beside the budget. --json
    has everything; docs/operations.md and docs/latency.md explain the keys.

    With URLs of status pages it asks all gateways at once, and prints a row for each, the worst first. One
    that gives no whole status within 5 s is unreachable.

    Exit code 1 if no gateway runs, or one of many is unreachable; otherwise of many 3 if one has an error, 4
    if one has a warning. 0 after Ctrl-C.

    Examples:
        pitch-gateway status gateway.toml

        pitch-gateway status gateway.toml --watch

        pitch-gateway status gateway.toml --json | jq .axes.x.latency

        pitch-gateway status https://mill-1:8480 https://mill-2:8480 --token-file fleet.token
    """
    if config[0].lower().startswith(URL_STARTS):
        if watch:
            raise typer.BadParameter(
                "one gateway can be watched; for many: watch -n 10 pitch-gateway status …"
            )
        _show_many(config, token_file, ca, certificate, key, as_json=as_json)
        return
    if len(config) > 1:
        raise typer.BadParameter("name one CONFIG, or addresses of pages such as http://192.168.0.7:8480")
    if named := [each for each in (token_file, ca, certificate, key) if each is not None]:
        raise typer.BadParameter(f"{named[0]}: this option is for URLs; a CONFIG needs none of them")
    if ":" in config[0] and not Path(config[0]).exists():
        raise typer.BadParameter(f"{config[0]}: no such file; for a gateway's page write http://{config[0]}")
    _show_one(Path(config[0]), watch=watch, as_json=as_json)


def _show_one(config: Path, *, watch: bool, as_json: bool) -> None:
    if not hasattr(socket, "AF_UNIX"):
        typer.echo(
            f"{config}: only the gateway's own computer can ask by CONFIG; give the address of its page, "
            "such as http://192.168.0.7:8480",
            err=True,
        )
        raise typer.Exit(1)
    from gateway.cli import looking
    from gateway.ipc.client import NoRelayError

    state = state_folder_or_exit(config)
    try:
        if watch:
            looking.watch(config, looking.looks(config, state), as_json=as_json)
            return
        seen = looking.read_status(config, state)
    except NoRelayError as error:
        typer.echo(f"{config}: {error}", err=True)
        raise typer.Exit(1) from None
    show(seen, Format.INDENTED if as_json else Format.TEXT, looking.words_of(config, seen))
    if seen.gateway.relay != "up":
        raise typer.Exit(1)


def _show_many(
    urls: list[str],
    token_file: Path | None,
    ca: Path | None,
    certificate: Path | None,
    key: Path | None,
    *,
    as_json: bool,
) -> None:
    from gateway.cli.fleet_output import fleet_parts
    from gateway.commissioning.fleet import EXIT_OF, FleetError, access_by, look_at

    try:
        fleet = look_at(urls, access_by(token_file, ca, certificate, key))
    except FleetError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(1) from None
    form = Format.INDENTED if as_json else Format.TEXT
    show(fleet, form, fleet_parts(fleet), plain_width=FLEET_COLUMNS)
    if code := EXIT_OF[next(iter(fleet.states))]:
        raise typer.Exit(code)
