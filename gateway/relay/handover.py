"""Tables that come over the socket: what is checked before one is mapped, and what is said of it."""

import asyncio
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import Protocol

from gateway.exchange.control import Control, ControlError, SetTables, TableChange
from gateway.ipc.messages import Done, SetTable, TableFor
from gateway.ipc.sealed_memory import NotSealedError, map_sealed
from gateway.state.tables import HEADER_BYTES, MAX_POINTS, POINT_BYTES, WrongTableError, check_points, mapped

LARGEST_BYTES = HEADER_BYTES + MAX_POINTS * POINT_BYTES


class TableTaker(Protocol):
    """What takes tables: the relay."""

    @property
    def axes(self) -> Sequence[str]:
        """Names of all axes."""
        ...

    def control(self, message: Control) -> dict[str, str]:
        """Put tables into force, all or none. Raises ControlError with the reason."""
        ...

    def note_refused(self, detail: str) -> None:
        """Put it on record that a table was refused."""
        ...


async def hand_over(
    relay: TableTaker,
    during: Callable[[], AbstractContextManager[object]],
    request: SetTable,
    descriptors: Sequence[int],
) -> Done:
    """Map the tables of a message and put them into force, all of them or none.

    Frames pass while the points are compared with their digest. The descriptors stay the caller's;
    ``during`` is entered for what the loop does itself.
    """
    try:
        with during():
            pairs = zip(request.tables, descriptors, strict=True)
            mapped_pairs = [_mapped(relay, table, descriptor) for table, descriptor in pairs]
        for change, data in mapped_pairs:
            await _check(change.axis, data)
        with during():
            comes = relay.control(SetTables(tuple(change for change, _ in mapped_pairs)))
    except ControlError as error:
        relay.note_refused(str(error))
        return Done(problems=(str(error),))
    return Done(changed=tuple(comes), comes=comes)


def _mapped(relay: TableTaker, wanted: TableFor, descriptor: int) -> tuple[TableChange, memoryview]:
    """Return a table by its header, and its bytes: the points have still to be looked at."""
    if wanted.axis not in relay.axes:
        raise ControlError(
            f"axis {wanted.axis}: there is none of that name; there are {', '.join(relay.axes)}"
        )
    try:
        data = map_sealed(descriptor, LARGEST_BYTES)
        table = mapped(data)
    except (NotSealedError, WrongTableError) as error:
        raise _refused(wanted.axis, error) from None
    return TableChange(wanted.axis, table, wanted.file, wanted.format, wanted.sha256), data


async def _check(axis: str, data: memoryview) -> None:
    try:
        await asyncio.to_thread(check_points, data)
    except WrongTableError as error:
        raise _refused(axis, error) from None


def _refused(axis: str, error: Exception) -> ControlError:
    return ControlError(f"the table for axis {axis}: {error}")
