"""``pitch-gateway listen PORT``."""

import signal
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from gateway.cli.arguments import AsJson
from gateway.cli.output import Format, show

if TYPE_CHECKING:
    from gateway.commissioning.listen.listening import Heard
    from gateway.transport.endpoints import TcpEndpoint

SERIAL_S: Final = 60.0
PARITY_LETTERS: Final = {"none": "N", "even": "E", "odd": "O"}


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
    baudrate: Annotated[
        int | None, typer.Option("--baudrate", min=1, help="Use this baud rate; do not try others.")
    ] = None,
    parity: Annotated[
        str | None, typer.Option("--parity", help="Use this parity: none, even or odd; do not try others.")
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(
            "--for",
            min=0.1,
            help="Seconds to listen; default: 60 on a serial port, until Ctrl-C for a proxy.",
            show_default=False,
        ),
    ] = None,
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
    if parity is not None and parity not in PARITY_LETTERS:
        raise typer.BadParameter("allowed: none, even, odd", param_hint="--parity")
    if out is not None and out.exists():
        typer.echo(f"{out} exists already and is not overwritten; name a new file", err=True)
        raise typer.Exit(1)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if to is None:
        heard = _listen_serial(port, baudrate, parity, seconds)
    else:
        if baudrate is not None or parity is not None:
            raise typer.BadParameter(
                "TCP has neither baud rate nor parity", param_hint="--baudrate, --parity"
            )
        heard = _listen_proxy(port, to, seconds)
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
        out.write_text(text, encoding="utf-8")
        _print(f"written: {out}; replace each FILL IN, then run: pitch-gateway check {out}")
    elif not as_json:
        typer.echo("\n" + text)


def _listen_serial(device: str, baudrate: int | None, parity: str | None, seconds: float | None) -> "Heard":
    import termios

    from gateway.commissioning.listen.listening import listen_serial
    from gateway.commissioning.listen.serial_line import BAUDRATES
    from gateway.transport.errors import TransportError

    if baudrate is not None and not hasattr(termios, f"B{baudrate}"):
        allowed = ", ".join(str(rate) for rate in sorted(BAUDRATES))
        raise typer.BadParameter(f"not a usual rate: {allowed}", param_hint="--baudrate")
    letter = None if parity is None else PARITY_LETTERS[parity]
    try:
        return listen_serial(device, seconds or SERIAL_S, baudrate=baudrate, parity=letter, report=_print)
    except TransportError as error:
        _print(error.detail)
        raise typer.Exit(1) from None


def _listen_proxy(port: str, to: str, seconds: float | None) -> "Heard":
    from gateway.commissioning.first_configuration import RTU_OVER_TCP
    from gateway.commissioning.listen.listening import listen_proxy
    from gateway.transport.errors import TransportError

    is_rtu = to.startswith(RTU_OVER_TCP)
    near = _endpoint(port, "PORT", is_rtu=is_rtu)
    far = _endpoint(to.removeprefix(RTU_OVER_TCP), "--to", is_rtu=is_rtu)
    try:
        return listen_proxy(near, far, seconds, report=_print)
    except TransportError as error:
        _print(error.detail)
        raise typer.Exit(1) from None


def _endpoint(text: str, where: str, *, is_rtu: bool) -> "TcpEndpoint":
    from gateway.transport.endpoints import TcpEndpoint

    host, _, number = text.rpartition(":")
    if not host or not number.isdigit() or int(number) > 0xFFFF:
        raise typer.BadParameter(f'found "{text}"; allowed: HOST:PORT', param_hint=where)
    return TcpEndpoint(host.strip("[]"), int(number), is_rtu)
