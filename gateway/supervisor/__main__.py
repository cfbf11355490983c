"""The supervisor as a program: ``python -m gateway.supervisor CONFIG``, what ``supervise`` becomes."""

import argparse
import gc
import os
import signal
import sys
from pathlib import Path

from gateway.ipc.children import follow_parent
from gateway.ipc.notes import LogFormat, note_writer
from gateway.ipc.place import SocketError
from gateway.ipc.service_manager import manager_of
from gateway.ipc.state_folder import StateError, state_folder


def main() -> int:
    """Run until a signal ends it; returns the exit code."""
    options = _options()
    # What is loaded stays: to search all of it for garbage again and again is a tenth of the start.
    gc.disable()
    from gateway.supervisor.process import run_supervisor

    gc.enable()
    follow_parent(options.parent, signal.SIGKILL)
    config: Path = options.config
    manager = None if options.parent else manager_of(os.environ)
    try:
        run_supervisor(
            config,
            state_folder(config),
            note_writer(options.log_format),
            tells_events=options.events,
            manager=manager,
        )
    except (StateError, SocketError) as error:
        sys.stderr.write(f"{config}: {error}\n")
        return 1
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="pitch-gateway supervise")
    parser.add_argument("config", type=Path)
    parser.add_argument("--log-format", type=LogFormat, default=LogFormat.AUTO)
    parser.add_argument("--events", action="store_true")
    parser.add_argument("--parent", type=int, default=0, help="process to end with")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
