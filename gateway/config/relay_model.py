"""``[relay]``: scheduling of the process that carries the traffic."""

from typing import Annotated

from pydantic import AfterValidator, Field

from gateway.drives.strict import ListOf, Planned, StrictModel, documented, planned
from gateway.state.plan import RelayOptions

HIGHEST_PRIORITY = 99
"""Of SCHED_FIFO (sched(7))."""
HIGHEST_CPU = 8191
"""Of the largest number of CPUs that Linux can be built for."""
_DEFAULT = RelayOptions()


def check_cpus(cpus: tuple[int, ...]) -> tuple[int, ...]:
    """Check that no CPU is named twice. Raises ValueError otherwise."""
    if len(set(cpus)) != len(cpus):
        raise ValueError("allowed: each CPU once")
    return cpus


Cpus = Annotated[
    ListOf[Annotated[int, Field(ge=0, le=HIGHEST_CPU)]],
    AfterValidator(check_cpus),
]


class RelaySection(StrictModel):
    """Scheduling of the relay. It runs without what the system refuses, and reports it."""

    fifo: Planned[Annotated[int, Field(ge=0, le=HIGHEST_PRIORITY)]] = Field(
        default=_DEFAULT.fifo,
        description="real-time priority (SCHED_FIFO), 0 for none",
        json_schema_extra=documented(
            text=("real-time priority (SCHED_FIFO), ahead of all programs without one. 0: unchanged")
        ),
    )
    cpus: Planned[Cpus] = Field(
        default=_DEFAULT.cpus,
        description="CPUs that the relay runs on; none named: any",
        json_schema_extra=documented(
            text=(
                "CPUs to run on, each once; `[]`: any. If one is missing at the start, the whole list is "
                "ignored"
            )
        ),
    )
    lock_memory: Planned[bool] = Field(
        default=_DEFAULT.lock_memory,
        description="keep the memory of the relay from being paged out",
        json_schema_extra=documented(text=("keep the relay's memory from being swapped out")),
    )

    @property
    def options(self) -> RelayOptions:
        """The section in plain data."""
        return RelayOptions(**planned(RelayOptions, self))
