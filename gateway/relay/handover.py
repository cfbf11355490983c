"""Tables that come over the socket: what is checked before one is mapped, and what is said of it."""

from collections.abc import Sequence
from typing import Protocol

from gateway.exchange.control import ControlError, TableChange
from gateway.ipc.compiled_table import HEADER_BYTES, MAX_POINTS, POINT_BYTES, WrongTableError, mapped
from gateway.ipc.messages import Done, SetTable, TableFor
from gateway.ipc.sealed_memory import NotSealedError, map_sealed

LARGEST_BYTES = HEADER_BYTES + MAX_POINTS * POINT_BYTES


class TableTaker(Protocol):
    """What takes tables: the relay."""

    @property
    def axes(self) -> Sequence[str]:
        """Names of all axes."""
        ...

    def set_tables(self, changes: Sequence[TableChange]) -> dict[str, str]:
        """Put tables into force, all or none. Raises ControlError with the reason."""
        ...

    def note_refused(self, detail: str) -> None:
        """Put it on record that a table was refused."""
        ...


def hand_over(relay: TableTaker, request: SetTable, descriptors: Sequence[int]) -> Done:
    """Map the tables of a message and put them into force, all of them or none.

    The descriptors stay the caller's.
    """
    try:
        changes = [
            _change(relay, table, descriptor)
            for table, descriptor in zip(request.tables, descriptors, strict=True)
        ]
        comes = relay.set_tables(changes)
    except ControlError as error:
        relay.note_refused(str(error))
        return Done(problems=(str(error),))
    return Done(changed=tuple(comes), comes=comes)


def _change(relay: TableTaker, wanted: TableFor, descriptor: int) -> TableChange:
    if wanted.axis not in relay.axes:
        raise ControlError(
            f"axis {wanted.axis}: there is none of that name; there are {', '.join(relay.axes)}"
        )
    try:
        table = mapped(map_sealed(descriptor, LARGEST_BYTES))
    except (NotSealedError, WrongTableError) as error:
        raise ControlError(f"the table for axis {wanted.axis}: {error}") from None
    return TableChange(wanted.axis, table, wanted.file, wanted.format, wanted.sha256)
