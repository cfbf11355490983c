"""The arguments of the gateway's own programs: CONFIG, then options, each with its value.

They come from the ``pitch-gateway`` command (``cli.processes``), which has checked them. argparse, with all
that it loads, would cost the relay half a megabyte as long as it runs.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gateway.ipc.log import LogFormat


@dataclass(frozen=True, slots=True)
class ProgramOptions:
    """``parent`` is the process to end with, 0: none. Each program has further options.

    ``state`` is the folder into which ``run`` has just compiled CONFIG. The program runs that plan even if
    the file changes meanwhile: the user may be editing it. None: the folder that CONFIG names, after a
    comparison.
    """

    config: Path
    log_format: LogFormat = LogFormat.AUTO
    parent: int = 0
    status_every_s: float = 0.0
    tells_events: bool = False
    state: Path | None = None


def options_of(words: Sequence[str]) -> ProgramOptions:
    """Return the options after the name of a program; end the process if they are wrong.

    >>> options_of(["gateway.toml", "--log-format", "json", "--parent", "7"]).parent
    7
    """
    try:
        config, *rest = words
        given = dict(zip(rest[::2], rest[1::2], strict=True))
        options = ProgramOptions(
            Path(config),
            LogFormat(given.pop("--log-format", LogFormat.AUTO.value)),
            int(given.pop("--parent", "0")),
            float(given.pop("--status-every", "0")),
            given.pop("--events", "no") == "yes",
            Path(given.pop("--state")) if "--state" in given else None,
        )
    except ValueError as error:
        sys.exit(f"not how a program of pitch-gateway is started: {error}")
    if given:
        sys.exit(f"not an option of a program of pitch-gateway: {', '.join(given)}")
    return options
