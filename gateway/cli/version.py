"""The text of ``pitch-gateway --version``."""

from gateway import __version__
from gateway.compiled import is_compiled


def version_line() -> str:
    """Return the release, and whether its hot path is compiled, as one line."""
    return f"pitch-gateway {__version__}{' (compiled)' if is_compiled() else ''}\n"
