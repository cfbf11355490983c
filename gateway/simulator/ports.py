"""Serial ports made out of nothing: pseudo terminals under the paths that a configuration names."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from gateway.simulator.errors import SimulatorError
from gateway.simulator.pty import Pty


class PortLinks:
    """Makes ports where there are none, and takes them away again, with the folders that they needed."""

    def __init__(self) -> None:
        self._ptys: list[Pty] = []
        self._folders: list[Path] = []

    def make(self, path: Path) -> Pty:
        """Make a port at ``path``.

        Raises:
            SimulatorError: something is there already, or the place may not be written.
        """
        if path.is_symlink() and not path.exists():
            _attempt(path, path.unlink)  # Left over from a simulation that was killed: it leads nowhere.
        if path.exists():
            raise SimulatorError(
                f"{path} exists: the simulator makes a port only where there is none. Stop what made it, or "
                "name another path in the configuration"
            )
        self._make_folders(path)
        pty = Pty()
        self._ptys.append(pty)
        _attempt(path, lambda: pty.link(path))
        return pty

    def close(self) -> None:
        """Take every port and folder away."""
        for pty in self._ptys:
            pty.close()
        self._ptys.clear()
        for folder in reversed(self._folders):
            with suppress(OSError):  # Somebody else put something into it.
                folder.rmdir()
        self._folders.clear()

    def _make_folders(self, path: Path) -> None:
        for folder in reversed(path.absolute().parents):
            if not folder.exists():
                _attempt(path, folder.mkdir)
                self._folders.append(folder)


def _attempt(path: Path, deed: Callable[[], object]) -> None:
    try:
        deed()
    except OSError as error:
        raise SimulatorError(
            f"cannot make a port at {path}: {error.strerror or error}; name a path that may be written, "
            f"such as /tmp/{path.name}"
        ) from error
