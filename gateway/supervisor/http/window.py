"""What the HTTP service sees of the supervisor, and what it may ask of it."""

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from gateway.compensation.settings import AxisSettings
from gateway.state.plan import GatewayPlan
from gateway.supervisor.acknowledged import Acknowledgement
from gateway.supervisor.feeds import Feeds
from gateway.supervisor.outcome import Outcome
from gateway.supervisor.past import Noted
from gateway.supervisor.saying import Say


async def _nothing(_axis: str, _span_s: float) -> None:
    return None


@dataclass(frozen=True, slots=True)
class Window:
    """Everything that is served comes through here."""

    feeds: Feeds
    state: Path
    """The state folder: the compiled tables are there, and the socket ``supervisor.sock``."""
    settings_of: Callable[[str], AxisSettings | None]
    """The settings of an axis in the configuration that was taken; None where there is none yet."""
    reload: Callable[[], Awaitable[Outcome]]
    say: Say
    history: Callable[[str, float], Awaitable[Sequence[Noted] | None]] = _nothing
    """Where an axis was in so many seconds until now; None: nothing is known of it."""
    plan: Callable[[], GatewayPlan | None] = lambda: None
    """The plan of the configuration that was taken; None where there is none yet."""
    acknowledge: Callable[[str, str, str, str], Acknowledgement | None] = lambda *_what: None
    """Note that somebody has seen an alarm: its kind, where, since when it is there, and who; None: there is
    none like that."""


def settings_in(plan: GatewayPlan | None, axis: str) -> AxisSettings | None:
    """Return the settings of an axis in the plan of a configuration, for :attr:`Window.settings_of`."""
    axes = () if plan is None else (one for line in plan.lines for one in line.axes)
    return next((one.settings for one in axes if one.name == axis), None)
