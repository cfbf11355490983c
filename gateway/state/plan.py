"""The plan: the whole checked configuration in plain objects, and the file from which the relay starts.

``plan.msgpack`` holds the plan and a digest. Each table is in its own file (``state.tables``). A plan of
another release, a damaged one, or one whose configuration has changed since is never run; ``state.last_good``
finds what may still be valid in it.

The version in the file applies to the whole folder: the plan, the tables and the records of the axes. A
change in the layout of one of them must raise it. Files of an older release are converted, those of a newer
one are never changed (docs/upgrade.md).
"""

import contextlib
import hashlib
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import msgspec

import gateway
from gateway.catalogue import starts
from gateway.compensation.backlash import with_backlash
from gateway.exchange.limits import without_live_values
from gateway.exchange.plan import (
    NO_OTHER_UNITS,
    AxisPlan,
    ControllerPlan,
    LineTiming,
    OtherUnits,
    Role,
)
from gateway.exchange.rights import UNLIMITED, Rights
from gateway.files import FileRefusedError
from gateway.state.folder import PLAN_NAME, StateError, configuration_files, read_state, write_if_new
from gateway.state.lock import alone_in
from gateway.state.tables import checked, compiled, digest_of, read_table, remove_others, write_table
from gateway.transport.certificates import TlsFiles
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from gateway.transport.limits import DEFAULT_LIMITS, ConnectionLimits

FORMAT: Final = "pitch-gateway plan"
VERSION: Final = 7
UNSEALED: Final = 4
"""The last version without a digest of the whole file at its end."""
SEAL_BYTES: Final = 32


@dataclass(frozen=True, slots=True)
class RoleRights:
    """The rights of a certificate's role."""

    role: Role
    rights: Rights = UNLIMITED


@dataclass(frozen=True, slots=True)
class TlsPlan:
    """Modbus/TCP Security on a listener: its files, and the rights of each role; others are not admitted."""

    files: TlsFiles
    roles: Mapping[str, RoleRights]


@dataclass(frozen=True, slots=True)
class ControllerLink:
    """A controller and where it connects. ``allow``: networks; empty: any address that reaches the listener.

    With ``tls`` the rights of each connection come from its certificate; ``plan`` has the highest of them.
    """

    plan: ControllerPlan
    endpoint: TcpEndpoint | SerialEndpoint
    allow: tuple[str, ...] = ()
    limits: ConnectionLimits = DEFAULT_LIMITS
    tls: TlsPlan | None = None

    def plan_of(self, certified: str) -> ControllerPlan | None:
        """Return the plan for connections whose certificate has a role; None if the role is unknown.

        "" is a connection without TLS.
        """
        if not certified:
            return self.plan if self.tls is None else None
        given = None if self.tls is None else self.tls.roles.get(certified)
        if given is None:
            return None
        return replace(self.plan, role=given.role, rights=given.rights, certified=certified)


@dataclass(frozen=True, slots=True)
class LinePlan:
    """One bus of drives with the controllers that may use it."""

    name: str
    drives: TcpEndpoint | SerialEndpoint
    controllers: tuple[ControllerLink, ...]
    axes: tuple[AxisPlan, ...]
    timing: LineTiming
    groups: tuple[tuple[str, ...], ...] = ()
    """Names of axes that are corrected together or not at all."""
    other_units: OtherUnits = NO_OTHER_UNITS
    """For a Modbus/TCP line: what is known of unit ids without an axis."""
    answers_as: int | None = None
    """The unit id in the replies of its single Modbus/TCP drive, if it differs from the requested one."""
    cut_through: bool = False
    """Frames may be forwarded while they still arrive, if both sides are serial ports."""
    tape_bytes: int = 0
    """Size of its trace buffer (``recording.trace_buffer``); 0: none."""


@dataclass(frozen=True, slots=True)
class RelayOptions:
    """How the process of the relay is scheduled."""

    fifo: int = 0
    """Priority of SCHED_FIFO, 1 to 99; 0: as the process was started."""
    cpus: tuple[int, ...] = ()
    """CPUs to run on; none: any."""
    lock_memory: bool = False


@dataclass(frozen=True, slots=True)
class GatewayPlan:
    """Everything the relay needs."""

    name: str
    lines: tuple[LinePlan, ...]
    relay: RelayOptions = RelayOptions()
    status_unit: int = 0
    """The gateway's own unit id (``relay.status_unit``); 0: none."""


class TablesFolder(msgspec.Struct, frozen=True, array_like=True):
    """A folder at a path, and its identity."""

    path: str
    device: int
    inode: int

    @classmethod
    def at(cls, path: Path) -> "TablesFolder | None":
        """Return the folder at a path now; None if there is none."""
        try:
            status = path.stat()
        except OSError:
            return None
        return cls(os.path.abspath(path), status.st_dev, status.st_ino)  # noqa: PTH100 - ".." goes too


class Writer(msgspec.Struct, frozen=True):
    """The part of the file that every version has: what wrote it, and from which text."""

    format: str = ""
    version: int = 0
    gateway_version: str = ""
    configuration: str = ""
    """The text of the configuration file; with ``include`` that of all its files as one."""


class CompiledPlan(Writer, frozen=True, kw_only=True):
    """The content of the file: a compiled plan. In the file it is without its tables."""

    plan: GatewayPlan
    shape: str
    """Digest of what cannot change in a running gateway: all but tables, gains and limits."""
    tables: dict[str, str]
    """The digest of the compiled table of each axis that has one."""
    sources: dict[str, str]
    """Its source files, by absolute path, with the SHA-256 of each."""
    tables_folder: TablesFolder | None = None
    """The folder of its tables; None if it did not exist."""


class DamagedError(Exception):
    """The file is not what was written; the text says how that is known."""


def in_force(plan: GatewayPlan) -> GatewayPlan:
    """Return a plan with its tables as they come into force, with the configured lost motion."""
    return _with_axes(plan, _with_backlash)


def as_started(plan: GatewayPlan) -> GatewayPlan:
    """Return a plan with the tables that a relay starts from, with their digests."""
    return _with_axes(
        in_force(plan),
        lambda axis: axis if axis.table is None else replace(axis, table=checked(compiled(axis.table))),
    )


def shape_of(plan: GatewayPlan) -> str:
    """Return the digest of what cannot change in a gateway that runs this plan."""
    return hashlib.sha256(_encode(_with_axes(plan, without_live_values))).hexdigest()


def _encode(content: object) -> bytes:
    """Return the same bytes for the same content: a set has no order."""
    return msgspec.msgpack.encode(msgspec.to_builtins(content, order="deterministic"))


def _with_backlash(axis: AxisPlan) -> AxisPlan:
    if axis.table is None or axis.settings.backlash is None:
        return axis
    return replace(axis, table=with_backlash(axis.table, axis.settings.backlash))


def _with_axes(plan: GatewayPlan, change: Callable[[AxisPlan], AxisPlan]) -> GatewayPlan:
    lines = (replace(line, axes=tuple(map(change, line.axes))) for line in plan.lines)
    return replace(plan, lines=tuple(lines))


def write_plan(
    state: Path,
    plan: GatewayPlan,
    sources: Mapping[str, str],
    configuration: str,
    tables_folder: TablesFolder | None = None,
    *,
    over: CompiledPlan | None = None,
) -> dict[str, bytes]:
    """Write a plan and its tables; return the compiled tables by axis.

    ``sources``, ``configuration`` and ``tables_folder`` are as in :class:`CompiledPlan`. ``over``: the plan
    that this one must replace. Table files that belong to no axis any more are removed, except the newest
    few.

    Raises:
        OSError: the folder or a file cannot be written; the old plan can still be run.
        StateError: a newer release wrote into the folder, or it now has a plan of another configuration than
            ``over``; nothing is changed.
    """
    refuse_newer(state, writer_of(state))
    tables = _compiled_tables(plan)
    file = CompiledPlan(
        format=FORMAT,
        version=VERSION,
        gateway_version=gateway.__version__,
        configuration=configuration,
        plan=_with_axes(plan, lambda axis: replace(axis, table=None)),
        shape=shape_of(plan),
        tables={name: digest_of(data) for name, data in tables.items()},
        sources=dict(sources),
        tables_folder=tables_folder,
    )
    with alone_in(state):
        last = writer_of(state)
        if over is not None and (last is None or last.configuration != over.configuration):
            raise StateError(starts.COMPILED_MEANWHILE.begin(plan=state / PLAN_NAME))
        for data in tables.values():
            write_table(state, data)
        write_if_new(state / PLAN_NAME, sealed(_encode(file)))
        remove_others(state, file.tables.values())
    return tables


def write_tables(state: Path, plan: GatewayPlan) -> dict[str, bytes]:
    """Write the tables of a plan beside those of the present one; return them compiled, by axis.

    Raises:
        OSError: the folder or a file cannot be written.
    """
    tables = _compiled_tables(plan)
    with alone_in(state):
        for data in tables.values():
            write_table(state, data)
    return tables


def _compiled_tables(plan: GatewayPlan) -> dict[str, bytes]:
    """Return the compiled table of each axis that has one, as it comes into force."""
    axes = (axis for line in in_force(plan).lines for axis in line.axes)
    return {axis.name: compiled(axis.table) for axis in axes if axis.table is not None}


def read_plan(state: Path, config: Path, *, is_compared: bool = True) -> CompiledPlan:
    """Return the plan that was compiled from a configuration.

    ``is_compared``: the configuration and its profiles must be unchanged since then.

    Raises:
        StateError: there is none, it is damaged or of another release, or the configuration or one of its
            profiles has changed since; with the remedy.
    """
    remedy = f"run: pitch-gateway check --compile {config}"
    path = state / PLAN_NAME
    writer, body = read_file(state, remedy)
    refuse_newer(state, writer)
    if (writer.version, writer.gateway_version) != (VERSION, gateway.__version__):
        versions = f" (state versions {writer.version} and {VERSION})" if writer.version != VERSION else ""
        raise StateError(
            f"{starts.ANOTHER_RELEASE.begin(plan=path, release=writer.gateway_version)}, and this is release "
            f"{gateway.__version__}{versions}; {remedy}"
        )
    try:
        file = msgspec.msgpack.decode(body, type=CompiledPlan)
    except msgspec.MsgspecError as error:
        raise StateError(f"{starts.NOT_UNDERSTOOD.begin(plan=path)}: {error}; {remedy}") from None
    if is_compared:
        _check_sources(file.sources, config, path, remedy)
    return with_tables(state, file, remedy)


def read_file(state: Path, remedy: str) -> tuple[Writer, bytes]:
    """Return the content of ``plan.msgpack``, and what wrote it.

    Raises:
        StateError: there is none, or it is damaged; with ``remedy``.
    """
    path = state / PLAN_NAME
    try:
        path.stat()
        body = unsealed(read_state(path))
    except FileNotFoundError:
        raise StateError(f"{starts.NOT_COMPILED.begin()}: there is no {path}; {remedy}") from None
    except OSError as error:
        raise StateError(f"{path}: {error.strerror or error}; {remedy}") from None
    except FileRefusedError as error:
        raise StateError(f"{path}: {error.found}; {remedy}") from None
    except DamagedError as error:
        raise StateError(f"{starts.DAMAGED.begin(plan=path)}: {error}; {remedy}") from None
    return msgspec.msgpack.decode(body, type=Writer), body


def with_tables(state: Path, file: CompiledPlan, remedy: str = "") -> CompiledPlan:
    """Return a file's content with the tables of its plan.

    Raises:
        StateError: the file of a table cannot be read, or holds another one.
    """
    tables = {name: read_table(state, digest, remedy) for name, digest in file.tables.items()}
    plan = _with_axes(file.plan, lambda axis: replace(axis, table=tables.get(axis.name)))
    return msgspec.structs.replace(file, plan=plan)


def _check_sources(sources: Mapping[str, str], config: Path, path: Path, remedy: str) -> None:
    if str(config.resolve()) not in sources:
        made_from = ", ".join(sources) or "nothing"
        found = starts.ANOTHER_CONFIGURATION.begin(plan=path, made_from=made_from)
        raise StateError(f"{found}, not from {config.resolve()}; {remedy}")
    for name, expected in sources.items():
        try:
            found = hashlib.sha256(read_state(Path(name))).hexdigest()
        except FileRefusedError as error:
            raise StateError(f"{name}: {error.found}; {remedy}") from None
        if found != expected:
            raise StateError(f"{starts.CHANGED.begin(file=name)}; {remedy}")
    for each in configuration_files(config):
        if str(each.resolve()) not in sources:
            raise StateError(f"{starts.INCLUDED.begin(file=each)}; {remedy}")


def sealed(content: bytes) -> bytes:
    """Return content with its SHA-256 at the end."""
    return content + hashlib.sha256(content).digest()


def unsealed(content: bytes) -> bytes:
    """Return the content of a plan's file, after checking that it is what was written.

    Raises:
        DamagedError: it is not, or it is no plan.
    """
    body, seal = content[:-SEAL_BYTES], content[-SEAL_BYTES:]
    is_sealed = hashlib.sha256(body).digest() == seal
    try:
        writer = msgspec.msgpack.decode(body if is_sealed else content, type=Writer)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise DamagedError(str(error)) from None
    if writer.format != FORMAT:
        raise DamagedError("it is no compiled configuration")
    if is_sealed:
        return body
    if writer.version > UNSEALED:
        raise DamagedError("its digest is another")
    return content


def writer_of(state: Path) -> Writer | None:
    """Return what wrote a state folder; None if it is empty or cannot be read."""
    with contextlib.suppress(StateError):
        return read_file(state, "")[0]
    return None


def refuse_newer(state: Path, writer: Writer | None) -> None:
    """Accept a state folder of this version or an older one.

    A newer version of a release that is not newer is a damaged file, or a build between two releases. Such a
    plan is not run either, but it is compiled again.

    Raises:
        StateError: a newer one; with both remedies.
    """
    if writer is None or writer.version <= VERSION or not _is_newer(writer.gateway_version):
        return
    found = starts.NEWER_RELEASE.begin(state=state)
    raise StateError(
        f"{found}, {writer.gateway_version} (state version {writer.version}; "
        f"this is release {gateway.__version__}, which knows versions up to {VERSION}): install that release "
        f"again, or stop the gateway and move {state} away: the axes then start without what they remember"
    )


def newer_release(state: Path) -> str:
    """Return the release that wrote a state folder if it is newer than this one, else "".

    A newer release may write the same state version.
    """
    writer = writer_of(state)
    if writer is None:
        return ""
    return writer.gateway_version if _is_newer(writer.gateway_version) else ""


def _is_newer(release: str) -> bool:
    return _numbers(release) > _numbers(gateway.__version__)


def _numbers(release: str) -> tuple[int, ...]:
    """Return the numbers by which releases are compared; an unknown release is the oldest.

    >>> _numbers("0.10.2") > _numbers("0.9.0"), _numbers("unknown")
    (True, ())
    """
    parts = release.split(".")
    return tuple(map(int, parts)) if all(part.isdecimal() for part in parts) else ()
