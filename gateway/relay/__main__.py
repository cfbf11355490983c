"""The relay as a program: ``python -m gateway.relay CONFIG``, started by ``pitch-gateway relay``.

It runs the compiled plan. Nothing here may import what only reading a configuration needs.
"""

import gc
import os
import signal
import sys
from collections.abc import Callable
from functools import partial

from gateway.ipc.children import follow_parent, notify_parent
from gateway.ipc.log import LogEntry, LogFormat, json_writer, take_standard_error
from gateway.ipc.program_options import options_of
from gateway.ipc.service_manager import handed_over, manager_of
from gateway.relay.errors import StartError
from gateway.state.folder import StateError, state_folder
from gateway.state.plan import read_plan


def main() -> int:
    """Run until a signal ends it; return the exit code."""
    options = options_of(sys.argv[1:])
    take_standard_error(options.log_format)
    # Loaded modules are never garbage. Searching them again and again would take a tenth of the start.
    gc.disable()
    from gateway.relay.run import Service, run_relay

    gc.enable()
    follow_parent(options.parent, signal.SIGTERM)
    config = options.config
    service = None
    if not options.parent:  # a child of `run` has no service manager
        service = Service(manager_of(os.environ), tuple(handed_over(os.environ)))
    try:
        state = options.state or state_folder(config)
        compiled = read_plan(state, config, is_compared=options.state is None)
        run_relay(
            compiled.plan,
            _writer(options.log_format, compiled.plan.name),
            options.status_every_s,
            state=state,
            on_ready=partial(notify_parent, options.parent),
            service=service,
            shape=compiled.shape,
        )
    except StateError as error:
        problems: tuple[str, ...] = (str(error),)
    except StartError as error:
        problems = error.problems
    else:
        return 0
    for problem in problems:
        sys.stderr.write(f"{config}: {problem}\n")
    return 1


def _writer(log_format: LogFormat, gateway: str) -> Callable[[LogEntry], None]:
    if log_format.is_json:
        return json_writer(gateway)
    from gateway.ipc.structured_log import StructuredLog

    return StructuredLog(log_format).write


if __name__ == "__main__":
    code = main()
    gc.freeze()  # the process ends: Python would search all that is loaded for garbage once more
    sys.exit(code)
