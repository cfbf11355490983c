"""The checked configuration in the state folder, as the relay starts from it: no pydantic, no text formats.

``plan.msgpack`` holds the plan with the digests of the files that it was made from and of its tables; each
table is a file of its own (see ``compiled_table``). A plan of another release (see ``state_version``), a
damaged one, or one whose configuration has changed since is never run.
"""

import contextlib
import fcntl
import hashlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import msgspec

import gateway
from gateway.compensation.backlash import with_backlash
from gateway.compensation.table import CorrectionTable
from gateway.exchange.plan import AxisPlan, without_live_values
from gateway.files import FileRefusedError
from gateway.state.folder import (
    PLAN_NAME,
    TABLE_SUFFIX,
    TABLES_NAME,
    StateError,
    make_folder,
    read_state,
    table_path,
    write_whole,
)
from gateway.state.plain_data import PlainReader, WrongDataError, to_plain
from gateway.state.plan import GatewayPlan
from gateway.state.state_version import (
    FORMAT,
    UNSEALED,
    VERSION,
    DamagedError,
    Writer,
    refuse_newer,
    sealed,
    unsealed,
    upgraded,
    writer_of,
)
from gateway.state.tables import WrongTableError, checked, compiled, digest_of

OTHERS_KEPT: Final = 4
"""Tables of no axis that stay in the state folder all the same."""


class TablesFolder(msgspec.Struct, frozen=True, array_like=True):
    """A folder at a path, and which one it is."""

    path: str
    device: int
    inode: int

    @classmethod
    def at(cls, path: Path) -> "TablesFolder | None":
        """Return the folder that is at a path now; None where there is none."""
        try:
            status = path.stat()
        except OSError:
            return None
        return cls(str(path), status.st_dev, status.st_ino)


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the file holds."""

    format: str
    version: int
    gateway_version: str
    sources: dict[str, str]
    configuration: str
    plan: bytes
    sha256: str = ""
    """Of the plan and the configuration, where no seal of the whole file tells (see ``state_version``)."""
    tables_folder: TablesFolder | None = None


@dataclass(frozen=True, slots=True)
class CompiledPlan:
    """A plan as it was compiled."""

    plan: GatewayPlan
    shape: str
    """Digest of what a gateway that runs cannot be given: all but tables, gains and limits."""
    sources: Mapping[str, str]
    """The files that it was made from, by absolute path, with the SHA-256 of each."""
    configuration: str
    """The text of the configuration file."""
    tables_folder: TablesFolder | None
    """The folder in which its tables were; None where it was not there."""


def in_force(plan: GatewayPlan) -> GatewayPlan:
    """Return a plan whose tables are as they come into force, with the lost motion that is configured."""
    return _with_axes(plan, _with_backlash)


def shape_of(plan: GatewayPlan) -> str:
    """Return the digest of what a gateway that runs this plan cannot be given."""
    bare = _with_axes(plan, without_live_values)
    return hashlib.sha256(_encode(to_plain(bare, _no_special))).hexdigest()


def write_plan(
    state: Path,
    plan: GatewayPlan,
    sources: Mapping[str, str],
    configuration: str,
    tables_folder: TablesFolder | None = None,
    *,
    over: CompiledPlan | None = None,
) -> dict[str, bytes]:
    """Write a plan and its tables; returns the compiled tables by axis.

    ``sources``, ``configuration`` and ``tables_folder`` are as in :class:`CompiledPlan`. ``over`` is what is
    replaced, where that may be nothing else. Files of tables that belong to no axis any more are removed, but
    for the newest few.

    Raises:
        OSError: the folder or a file cannot be written; what was there can still be run.
        StateError: a newer release wrote into the folder, or somebody compiled another configuration than
            ``over`` holds; nothing is changed.
    """
    refuse_newer(state, writer_of(state))
    plan = in_force(plan)
    tables, digest_by_id = _compiled_tables(plan)
    content = _encode(to_plain(plan, lambda value: digest_by_id.get(id(value))))
    file = _File(
        FORMAT,
        VERSION,
        gateway.__version__,
        dict(sources),
        configuration,
        content,
        tables_folder=tables_folder,
    )
    with _alone_in(state):
        if over is not None and _text_of_last(state) != over.configuration:
            raise StateError(f"{state / PLAN_NAME}: another configuration was compiled meanwhile")
        for data in tables.values():
            _write_if_new(table_path(state, digest_of(data)), data)
        _write_if_new(state / PLAN_NAME, sealed(msgspec.msgpack.encode(file)))
        _remove_others(state, {digest_of(data) for data in tables.values()})
    return tables


def write_tables(state: Path, plan: GatewayPlan) -> dict[str, bytes]:
    """Write the tables of a plan beside those of the one that is there; returns them compiled, by axis.

    Raises:
        OSError: the folder or a file cannot be written.
    """
    tables, _ = _compiled_tables(in_force(plan))
    with _alone_in(state):
        for data in tables.values():
            _write_if_new(table_path(state, digest_of(data)), data)
    return tables


def _compiled_tables(plan: GatewayPlan) -> tuple[dict[str, bytes], dict[int, str]]:
    """Return the compiled table of each axis, and the digest of each by the ``id`` of what it was made of."""
    axes = [axis for line in plan.lines for axis in line.axes if axis.table is not None]
    tables = {axis.name: compiled(axis.table) for axis in axes if axis.table is not None}
    return tables, {id(axis.table): digest_of(tables[axis.name]) for axis in axes}


def _text_of_last(state: Path) -> str | None:
    with contextlib.suppress(StateError):
        return _read_file(state / PLAN_NAME, "").configuration
    return None


def read_plan(state: Path, config: Path, *, is_compared: bool = True) -> CompiledPlan:
    """Return the plan that was compiled from a configuration.

    ``is_compared``: the configuration and its profiles have to be what it was compiled from, still.

    Raises:
        StateError: there is none, it is damaged or of another release, or the configuration or a profile that
            it names has changed since; with what to do.
    """
    remedy = f"run: pitch-gateway check --compile {config}"
    path = state / PLAN_NAME
    file = _read_file(path, remedy)
    if (file.version, file.gateway_version) != (VERSION, gateway.__version__):
        versions = f" (state versions {file.version} and {VERSION})" if file.version != VERSION else ""
        raise StateError(
            f"{path} was made by release {file.gateway_version}, and this is release "
            f"{gateway.__version__}{versions}; {remedy}"
        )
    if is_compared:
        _check_sources(file.sources, config, path, remedy)
    return _compiled_plan(state, file, remedy)


def last_plan(state: Path) -> CompiledPlan | None:
    """Return the plan that was compiled last, whatever has changed since; None where none can be read.

    For what may still be good of it: a file of a table that is bad now was good then. One of an older release
    is taken over.
    """
    with contextlib.suppress(StateError):
        return _compiled_plan(state, _read_file(state / PLAN_NAME, ""), "")
    return None


def _compiled_plan(state: Path, file: _File, remedy: str) -> CompiledPlan:
    path = state / PLAN_NAME
    if file.version <= UNSEALED and _digest(file.plan, file.configuration) != file.sha256:
        raise StateError(f"{path} is damaged: its digest is another; {remedy}")
    reader = PlainReader(GatewayPlan, lambda digest: _read_table(state, str(digest), remedy))
    try:
        plan = reader.read(upgraded(file.version, msgspec.msgpack.decode(file.plan)))
    except (msgspec.MsgspecError, WrongDataError) as error:
        raise StateError(f"{path} is not understood: {error}; {remedy}") from None
    if not isinstance(plan, GatewayPlan):
        raise StateError(f"{path} holds no plan; {remedy}")
    return CompiledPlan(plan, shape_of(plan), file.sources, file.configuration, file.tables_folder)


@contextlib.contextmanager
def _alone_in(state: Path) -> Iterator[None]:
    """Wait until nobody else writes here: two at once would remove each other's tables."""
    make_folder(state)
    make_folder(state / TABLES_NAME)
    descriptor = os.open(state / TABLES_NAME, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _write_if_new(path: Path, content: bytes) -> None:
    if not path.is_file() or path.read_bytes() != content:
        write_whole(path, content)


def _with_backlash(axis: AxisPlan) -> AxisPlan:
    if axis.table is None or axis.settings.backlash is None:
        return axis
    return replace(axis, table=with_backlash(axis.table, axis.settings.backlash))


def _with_axes(plan: GatewayPlan, change: Any) -> GatewayPlan:
    lines = (replace(line, axes=tuple(map(change, line.axes))) for line in plan.lines)
    return replace(plan, lines=tuple(lines))


def _no_special(_value: object) -> object | None:
    return None


def _digest(plan: bytes, configuration: str) -> str:
    return hashlib.sha256(plan + configuration.encode()).hexdigest()


def _encode(data: object) -> bytes:
    return msgspec.msgpack.encode(data)


def _read_file(path: Path, remedy: str) -> _File:
    try:
        path.stat()
        content = read_state(path)
    except FileNotFoundError:
        raise StateError(f"it has not been compiled yet: there is no {path}; {remedy}") from None
    except OSError as error:
        raise StateError(f"{path}: {error.strerror or error}; {remedy}") from None
    except FileRefusedError as error:
        raise StateError(f"{path}: {error.found}; {remedy}") from None
    try:
        body = unsealed(content)
        refuse_newer(path.parent, msgspec.msgpack.decode(body, type=Writer))
        return msgspec.msgpack.decode(body, type=_File)
    except (DamagedError, msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise StateError(f"{path} is damaged: {error}; {remedy}") from None


def _check_sources(sources: Mapping[str, str], config: Path, path: Path, remedy: str) -> None:
    if str(config.resolve()) not in sources:
        made_from = ", ".join(sources) or "nothing"
        raise StateError(f"{path} was compiled from {made_from}, not from {config.resolve()}; {remedy}")
    for name, wanted in sources.items():
        try:
            found = hashlib.sha256(read_state(Path(name))).hexdigest()
        except FileRefusedError as error:
            raise StateError(f"{name}: {error.found}; {remedy}") from None
        if found != wanted:
            raise StateError(f"{name} has changed since it was compiled; {remedy}")


def _read_table(state: Path, digest: str, remedy: str) -> CorrectionTable:
    """Read a table into memory: a mapped file that somebody cuts short would kill whoever reads on."""
    path = table_path(state, digest)
    try:
        table = checked(read_state(path))
    except FileRefusedError as error:
        raise StateError(f"{path}: {error.found}; {remedy}") from None
    except WrongTableError as error:
        raise StateError(f"{path}: {error}; {remedy}") from None
    if table.digest != digest:
        raise StateError(f"{path} holds another table than its name says; {remedy}")
    return table


def find_table(state: Path, fingerprint: bytes) -> CorrectionTable | None:
    """Return a compiled table by what ``compensation.fingerprint`` calls it; None where it is not there.

    One that is in force no more may still be wanted: by an axis that was killed in the middle of going over
    to the next.
    """
    for path in (state / TABLES_NAME).glob(f"*{TABLE_SUFFIX}"):
        digest = path.name.removesuffix(TABLE_SUFFIX)
        with contextlib.suppress(ValueError, StateError):
            if bytes.fromhex(digest)[: len(fingerprint)] == fingerprint:
                return _read_table(state, digest, "")
    return None


def _remove_others(state: Path, digests: set[str]) -> None:
    """Remove tables that belong to no axis any more, but for the newest few (see :func:`find_table`)."""
    others: list[tuple[float, Path]] = []
    for path in (state / TABLES_NAME).glob(f"*{TABLE_SUFFIX}"):
        if path.name.removesuffix(TABLE_SUFFIX) not in digests:
            with contextlib.suppress(OSError):
                others.append((path.stat().st_mtime, path))
    for _, path in sorted(others)[:-OTHERS_KEPT]:
        with contextlib.suppress(OSError):
            path.unlink()
