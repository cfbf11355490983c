"""``pitch-gateway listen PORT``."""

import signal
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gateway.cli.arguments import AsJson
from gateway.cli.options import takes_options
from gateway.cli.output import Format, show
from gateway.commissioning.listen.options import ListenOptions
from gateway.files import FileRefusedError, write_file

if TYPE_CHECKING:
    from gateway.commissioning.listen.listening import Heard
    from gateway.transport.endpoints import TcpEndpoint


@takes_options
def listen(
    port: Annotated[
        str,
        typer.Argument(
            metavar="PORT",
            help=(
                "Serial port, such as /dev/ttyUSB0; with --to: where the proxy listens, such as 0.0.0.0:502."
            ),
            show_default=False,
        ),
    ],
    *,
    to: Annotated[
        str | None,
        typer.Option(
            "--to", metavar="HOST:PORT", help="Drive behind the proxy; rtu://HOST:PORT for RTU over TCP."
        ),
    ] = None,
    options: ListenOptions,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Write the proposed configuration into this new file.", readable=False),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Listen on a working line and propose a configuration. It sends nothing itself.

    Serial line: connect an adapter to the bus beside controller and drives. The port is opened only for
    reading. The command tries baud rates and parities until it receives whole frames. With --to a TCP proxy
    runs between controller and drive and forwards every byte unchanged; Ctrl-C ends it and closes the
    connection.

    It reports how often each unit id, function code and register is used, which known drives use them in this
    way, and which registers hold positions: those that follow the commanded targets. While it listens, home
    the machine and move it to several positions.

    Progress goes to stderr. Exit code 1 if no frame was understood.

    Examples:
        pitch-gateway listen /dev/ttyUSB0

        pitch-gateway listen /dev/ttyUSB0 --baudrate 9600 --for 600 --out gateway.toml

        pitch-gateway listen 0.0.0.0:502 --to 192.168.0.20:502

        pitch-gateway listen /dev/ttyUSB0 --json | jq .units
    """
    from gateway.commissioning.listen.listening import listen_serial
    from gateway.transport.errors import TransportError

    if out is not None and out.exists():
        typer.echo(f"{out} exists already and is not overwritten; name a new file", err=True)
        raise typer.Exit(1)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        heard = listen_serial(port, options, report=_print) if to is None else _proxy(port, to, options)
    except TransportError as error:
        _print(error.detail)
        raise typer.Exit(1) from None
    _print_result(heard, out, as_json=as_json)


def _print(text: str) -> None:
    typer.echo(text, err=True)


def _print_result(heard: "Heard", out: Path | None, *, as_json: bool) -> None:
    text = heard.configuration
    show(heard, Format.JSON if as_json else Format.TEXT)
    if not heard.is_understood:
        _print("no frame was understood: move the machine, listen longer (--for), or exchange A and B")
        raise typer.Exit(1)
    if not text:
        _print(
            "no configuration is proposed: no target was written to any unit id; move the machine "
            "to several positions"
        )
    elif out is not None:
        try:
            write_file(out, text.encode(), force=False)
        except (FileRefusedError, OSError) as error:
            why = (error.strerror if isinstance(error, OSError) else None) or error
            _print(f"{out}: cannot be written ({why}); the configuration follows on standard output")
            if not as_json:
                typer.echo("\n" + text)
            raise typer.Exit(1) from None
        _print(f"written: {out}; replace each FILL IN, then run: pitch-gateway check {out}")
    elif not as_json:
        typer.echo("\n" + text)


def _proxy(port: str, to: str, options: ListenOptions) -> "Heard":
    from gateway.commissioning.first_configuration import RTU_OVER_TCP
    from gateway.commissioning.listen.listening import listen_proxy

    is_rtu = to.startswith(RTU_OVER_TCP)
    near = _endpoint(port, "PORT", is_rtu=is_rtu)
    far = _endpoint(to.removeprefix(RTU_OVER_TCP), "--to", is_rtu=is_rtu)
    return listen_proxy(near, far, options, report=_print)


def _endpoint(text: str, where: str, *, is_rtu: bool) -> "TcpEndpoint":
    from gateway.transport.endpoints import TcpEndpoint

    host, _, number = text.rpartition(":")
    if not host or not number.isdigit() or int(number) > 0xFFFF:
        raise typer.BadParameter(f'found "{text}"; allowed: HOST:PORT', param_hint=where)
    return TcpEndpoint(host.strip("[]"), int(number), is_rtu)
