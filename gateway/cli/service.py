"""``pitch-gateway service CONFIG``."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from gateway.cli.arguments import AsJson, Config
from gateway.cli.configuration import load_or_exit
from gateway.cli.output import Format, show

DROP_IN: Final = "configuration.conf"
READABLE: Final = 0o644


def service(
    config: Config,
    *,
    systemd: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help=(
                "Write the drop-ins below DIR, such as /etc/systemd/system; without it they are only shown."
            ),
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Adapt the systemd units to a configuration: allow what it needs, and nothing else.

    Each unit gets one drop-in: its network addresses (IPAddressAllow), kinds of serial ports (DeviceAllow),
    the capability for ports below 1024, the real-time settings of the relay, and the secrets that are named
    credential:NAME (LoadCredential). A comment gives the reason for each permission left open. Run it again
    after a change of the configuration; a drop-in that is up to date is not written.

    Exit code 0 if all is written or shown; 1 if CONFIG is bad or a file cannot be written.

    Examples:
        pitch-gateway service gateway.toml

        pitch-gateway service gateway.toml --systemd /etc/systemd/system && systemctl daemon-reload
    """
    from gateway.config.service_units import SECRETS, drop_ins, why_no_state
    from gateway.secret_files import CREDENTIALS_FOLDER

    # A command gets no credentials from a service manager: they are where it will read them from.
    os.environ.setdefault(CREDENTIALS_FOLDER, SECRETS)
    loaded = load_or_exit(config, checks_times=False)
    texts = drop_ins(loaded)
    warning = why_no_state(loaded)
    if warning is not None:
        typer.echo(f"warning: {warning}", err=True)
    found = Fitted(texts) if systemd is None else fit(systemd, texts)
    show(found, Format.INDENTED if as_json else Format.TEXT)


@dataclass(frozen=True, slots=True)
class Fitted:
    """The drop-ins of a configuration, by unit."""

    texts: Mapping[str, str]
    written: Mapping[Path, bool] = field(default_factory=dict)
    """The files, each with whether it has changed; empty if they are only shown."""

    def as_data(self) -> dict[str, Any]:
        """Return them as plain data."""
        files = [{"file": str(path), "changed": is_new} for path, is_new in self.written.items()]
        return {"drop_ins": self.texts, "files": files}

    def lines(self) -> Iterator[str]:
        """Yield the written files and how to activate them, or else the texts."""
        if not self.written:
            yield from (f"# {unit}.d/{DROP_IN}\n{text}" for unit, text in self.texts.items())
        for path, is_new in self.written.items():
            yield f"{path}: {'written' if is_new else 'fits already'}"
        if any(self.written.values()):
            yield "to apply it: systemctl daemon-reload && systemctl restart pitch-gateway.target"


def fit(folder: Path, texts: Mapping[str, str]) -> Fitted:
    """Write the drop-in of each unit below a folder. If that is impossible, end the command with 1."""
    from gateway.state.folder import write_whole

    written: dict[Path, bool] = {}
    for unit, text in texts.items():
        path = folder / f"{unit}.d" / DROP_IN
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            written[path] = not path.exists() or path.read_text(encoding="utf-8") != text
            if written[path]:
                write_whole(path, text.encode())
                path.chmod(READABLE)
        except OSError as error:
            why = error.strerror or error
            typer.echo(
                f"{path} cannot be written ({why}); run this as root, or name another --systemd", err=True
            )
            raise typer.Exit(1) from None
    return Fitted(texts, written)
