"""What every test needs."""

import signal

import pytest
from hypothesis import HealthCheck, settings

from tests import needs

# How long an example takes says how busy the machine is; what is fast enough is the business of `bench/`.
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")

# A shell that starts us in the background, as some CI runners do, has us ignore SIGINT, and so would every
# program that a test starts: Ctrl-C would then go unheard.  With Python's own handler here, they hear it.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(needs)


FIRST = ("tests/package/", "tests/measure/", "tests/service/")
"""Minutes for each file: begun last, one worker would have them while the others have nothing to do."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what takes longest."""
    items.sort(
        key=lambda item: next((n for n, f in enumerate(FIRST) if item.nodeid.startswith(f)), len(FIRST))
    )
