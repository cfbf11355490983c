"""The supervisor as a program: ``python -m gateway.supervisor CONFIG``. ``supervise`` executes it."""

import gc
import os
import signal
import sys

from gateway.ipc.address import SocketError
from gateway.ipc.children import follow_parent
from gateway.ipc.log import take_standard_error
from gateway.ipc.program_options import options_of
from gateway.ipc.service_manager import manager_of
from gateway.state.folder import StateError, state_folder


def main() -> int:
    """Run until a signal ends the process; return the exit code."""
    options = options_of(sys.argv[1:])
    take_standard_error(options.log_format)
    # The loaded modules stay in memory. Scanning them for garbage repeatedly takes a tenth of the start.
    gc.disable()
    from gateway.ipc.structured_log import StructuredLog
    from gateway.supervisor.process import run_supervisor

    gc.freeze()
    gc.enable()
    follow_parent(options.parent, signal.SIGKILL)
    config = options.config
    manager = None if options.parent else manager_of(os.environ)
    try:
        run_supervisor(
            config,
            options.state or state_folder(config),
            StructuredLog(options.log_format),
            tells_events=options.tells_events,
            manager=manager,
        )
    except (StateError, SocketError) as error:
        sys.stderr.write(f"{config}: {error}\n")
        return 1
    return 0


if __name__ == "__main__":
    code = main()
    gc.freeze()  # the process ends: Python would search all that is loaded for garbage once more
    sys.exit(code)
