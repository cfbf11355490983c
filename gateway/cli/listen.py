"""``pitch-gateway listen PORT``."""

import asyncio
import json
import signal
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

if TYPE_CHECKING:
    from gateway.commissioning.listen.proposal import Place
    from gateway.commissioning.listen.serial_line import Setting, Trial
    from gateway.commissioning.listen.traffic import Tally
    from gateway.transport.endpoints import TcpEndpoint

SERIAL_S: Final = 60.0
PROGRESS_S: Final = 5.0
PARITY_LETTERS: Final = {"none": "N", "even": "E", "odd": "O"}


def listen(
    port: Annotated[
        str,
        typer.Argument(
            metavar="PORT",
            help="A serial port, as in /dev/ttyUSB0; with --to where the proxy listens, as in 0.0.0.0:502.",
            show_default=False,
        ),
    ],
    *,
    to: Annotated[
        str | None,
        typer.Option(
            "--to", metavar="HOST:PORT", help="The drive behind the proxy; rtu://HOST:PORT for RTU over TCP."
        ),
    ] = None,
    baudrate: Annotated[
        int | None, typer.Option("--baudrate", min=1, help="Do not guess the baud rate.")
    ] = None,
    parity: Annotated[
        str | None, typer.Option("--parity", help="Do not guess the parity: none, even or odd.")
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(
            "--for",
            min=0.1,
            help="Seconds to listen. A serial port: 60. A proxy: until Ctrl-C.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Write the proposed configuration there; a new file.", readable=False),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Listen on a line that works, and propose a configuration. Nothing is ever sent.

    On a serial line an adapter hangs on the bus beside controller and drives, and its port is opened for
    reading only. Baud rates and parities are tried until whole frames come. With --to a TCP proxy stands
    between the controller and a drive, and passes every byte on untouched; Ctrl-C ends it, and with it the
    connection.

    Says which unit ids, function codes and registers are used how often, which of the drives that we know
    that sounds like, and which registers hold positions: those that go where others are told to. What is
    heard depends on what the machine does meanwhile: let it home and go to some places.

    How far it is, is said on stderr. Exit code 1 when nothing was understood.

    Examples:
        pitch-gateway listen /dev/ttyUSB0

        pitch-gateway listen /dev/ttyUSB0 --baudrate 9600 --for 600 --out gateway.toml

        pitch-gateway listen 0.0.0.0:502 --to 192.168.0.20:502

        pitch-gateway listen /dev/ttyUSB0 --json | jq .units
    """
    if parity is not None and parity not in PARITY_LETTERS:
        raise typer.BadParameter("allowed: none, even, odd", param_hint="--parity")
    if out is not None and out.exists():
        typer.echo(f"{out} is there already: nothing is overwritten", err=True)
        raise typer.Exit(1)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if to is None:
        tally, place, data = _hear_serial(
            port, baudrate, parity and PARITY_LETTERS[parity], seconds or SERIAL_S
        )
    else:
        if baudrate is not None or parity is not None:
            raise typer.BadParameter(
                "TCP has neither baud rate nor parity", param_hint="--baudrate, --parity"
            )
        tally, place, data = _hear_proxy(port, to, seconds)
    _tell(tally, place, data, out, as_json=as_json)


def _say(text: str) -> None:
    typer.echo(text, err=True)


def _tell(tally: "Tally", place: "Place", data: dict[str, Any], out: Path | None, *, as_json: bool) -> None:
    from gateway.commissioning.listen.proposal import as_data, as_text, proposed

    text = proposed(place, tally.units)
    if as_json:
        typer.echo(json.dumps({**data, **as_data(tally, place)}))
    else:
        for line in as_text(tally):
            typer.echo(line)
    if not tally.units:
        _say("nothing was understood: let the machine move, listen longer (--for), or exchange A and B")
        raise typer.Exit(1)
    if not text:
        _say("no configuration is proposed: no unit id was told a target; let the machine go to some places")
    elif out is not None:
        out.write_text(text, encoding="utf-8")
        _say(f"written: {out}; fill in what nobody can hear, then pitch-gateway check {out}")
    elif not as_json:
        typer.echo("\n" + text)


# --- a serial line -----------------------------------------------------------------------------------------


def _hear_serial(
    device: str, baudrate: int | None, parity: str | None, seconds: float
) -> "tuple[Tally, Place, dict[str, Any]]":
    import termios

    from gateway.clock import boot_ns
    from gateway.commissioning.listen.proposal import Place
    from gateway.commissioning.listen.serial_line import BAUDRATES, Ear, find_setting, settings_to_try
    from gateway.commissioning.listen.traffic import Tally
    from gateway.times import NS_PER_S
    from gateway.transport.errors import TransportError

    if baudrate is not None and not hasattr(termios, f"B{baudrate}"):
        allowed = ", ".join(str(rate) for rate in sorted(BAUDRATES))
        raise typer.BadParameter(f"no usual rate: {allowed}", param_hint="--baudrate")
    tally = Tally()
    trial: Trial | None = None
    until_ns = boot_ns() + int(seconds * NS_PER_S)
    try:
        with Ear(device) as ear, suppress(KeyboardInterrupt):
            if ear.is_pty:
                _say(f"{device}: a pseudo terminal has no parity: only baud rates are tried")
            settings = settings_to_try(baudrate, parity, has_parity=not ear.is_pty)
            trial, heard = find_setting(ear, settings, until_ns, _say)
            tally.hear(heard)
            if trial is not None and trial.is_right:
                _say(f"{trial.setting}: whole frames come")
                _go_on(ear, trial, tally, until_ns)
    except TransportError as error:
        _say(error.detail)
        raise typer.Exit(1) from None
    except (OSError, termios.error) as error:
        _say(f"{device}: {error}; what was heard until then follows")
    if trial is None:
        return tally, Place(), {"port": device, "serial": None}
    return tally, Place(setting=trial.setting), {"port": device, "serial": _serial_data(trial)}


def _go_on(ear: Any, trial: "Trial", tally: "Tally", until_ns: int) -> None:
    from gateway.clock import boot_ns
    from gateway.commissioning.listen.serial_line import SILENCE_MS
    from gateway.times import NS_PER_S

    said_ns = boot_ns()
    while (now_ns := boot_ns()) < until_ns:
        data = ear.read(SILENCE_MS)
        tally.hear(trial.feed(data) if data else trial.line.silent())
        if now_ns - said_ns >= PROGRESS_S * NS_PER_S:
            said_ns = now_ns
            left = f"{(until_ns - now_ns) / NS_PER_S:.0f} s to go (Ctrl-C ends)"
            _say(f"{_progress(tally)}, {trial.line.bad_bytes} bytes damaged; {left}")


def _progress(tally: "Tally") -> str:
    ids = ", ".join(str(unit_id) for unit_id in sorted(tally.units)) or "none yet"
    return f"{tally.requests} requests, unit ids {ids}"


def _serial_data(trial: "Trial") -> dict[str, Any]:
    setting: Setting = trial.setting
    return {
        "baudrate": setting.baudrate,
        "parity": next(word for word, letter in PARITY_LETTERS.items() if letter == setting.parity),
        "is_sure": trial.is_right,
        "frames": trial.line.frames,
        "damaged_bytes": trial.line.bad_bytes,
        "wrong_characters": trial.unmarking.errors,
    }


# --- a proxy -----------------------------------------------------------------------------------------------


def _hear_proxy(port: str, to: str, seconds: float | None) -> "tuple[Tally, Place, dict[str, Any]]":
    from gateway.commissioning.first_configuration import RTU_OVER_TCP
    from gateway.commissioning.listen.proposal import Place
    from gateway.commissioning.listen.traffic import Tally
    from gateway.transport.errors import TransportError

    is_rtu = to.startswith(RTU_OVER_TCP)
    near = _endpoint(port, "PORT", is_rtu=is_rtu)
    far = _endpoint(to.removeprefix(RTU_OVER_TCP), "--to", is_rtu=is_rtu)
    tally = Tally()
    try:
        asyncio.run(_serve(near, far, tally, seconds))
    except TransportError as error:
        _say(error.detail)
        raise typer.Exit(1) from None
    return tally, Place(near=near, far=far), {"port": str(near), "to": str(far)}


def _endpoint(text: str, where: str, *, is_rtu: bool) -> "TcpEndpoint":
    from gateway.transport.endpoints import TcpEndpoint

    host, _, number = text.rpartition(":")
    if not host or not number.isdigit() or int(number) > 0xFFFF:
        raise typer.BadParameter(f'found "{text}"; allowed: HOST:PORT', param_hint=where)
    return TcpEndpoint(host.strip("[]"), int(number), is_rtu)


async def _serve(near: "TcpEndpoint", far: "TcpEndpoint", tally: "Tally", seconds: float | None) -> None:
    from gateway.commissioning.listen.proxy import Proxy

    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, ended.set)
    if seconds is not None:
        loop.call_later(seconds, ended.set)
    proxy = Proxy(near, far, tally, _say)
    await proxy.open()
    _say(f"connect the controller to {near.host}:{proxy.port} in place of {far}; Ctrl-C ends it")
    last = ""
    try:
        while not ended.is_set():
            with suppress(TimeoutError):
                async with asyncio.timeout(PROGRESS_S):
                    await ended.wait()
            if (now := _progress(tally)) != last:
                last = now
                _say(now)
    finally:
        await proxy.close()
