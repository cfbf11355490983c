"""A good configuration into the state folder, in the form that the relay starts from."""

import hashlib

from gateway.config.load import Loaded
from gateway.ipc.compiled_plan import write_plan
from gateway.ipc.folder_problems import problem_of
from gateway.ipc.state_folder import StateError


def compile_into_state(loaded: Loaded) -> dict[str, bytes]:
    """Write the plan and the tables of a configuration; returns the compiled tables by axis.

    Raises:
        StateError: the state folder cannot be written, or a profile was removed meanwhile; with the remedy.
    """
    sources = {str(loaded.path.resolve()): loaded.sha256}
    try:
        for drive in loaded.drives.values():
            if not drive.is_shipped:
                profile = (loaded.path.parent / drive.name).resolve()
                sources[str(profile)] = hashlib.sha256(profile.read_bytes()).hexdigest()
    except OSError as error:
        raise StateError(f"{error.filename}: {error.strerror or error}; it was there a moment ago") from None
    try:
        return write_plan(loaded.state_folder, loaded.plan, sources)
    except OSError as error:
        raise StateError(f"gateway.state: {problem_of(error, loaded.state_folder)}") from None
