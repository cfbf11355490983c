"""Which release wrote a state folder, and whether this one may use it (docs/upgrade.md).

The version in ``plan.msgpack`` stands for everything in the folder: the plan, the compiled tables and the
records of the axes. Whoever changes the layout of one of them raises it. What an older release wrote is taken
over, what a newer one wrote is never touched.

A disk that fails or a power cut may change any byte of any file here, so each says by itself whether it is
what was written: the plan by the digest behind it, a table by its name, a record by its CRC.
"""

import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

import gateway
from gateway.files import FileRefusedError
from gateway.state.folder import PLAN_NAME, StateError, read_state

FORMAT: Final = "pitch-gateway plan"
VERSION: Final = 6
UNSEALED: Final = 4
"""The last version without a seal."""
SEAL_BYTES: Final = 32


def _as_it_is(plan: Any) -> Any:
    """What a plan has not is what its reader takes for granted: no rights mean no limits, no terms none."""
    return plan


UPGRADES: Final[Mapping[int, Callable[[Any], Any]]] = dict.fromkeys(range(2, VERSION), _as_it_is)
"""By version: the plain data of a plan to what the next version would have written."""


class Writer(msgspec.Struct):
    """As much of ``plan.msgpack`` as every version has: what wrote it."""

    format: str = ""
    version: int = 0
    gateway_version: str = ""


class DamagedError(Exception):
    """A file of the state that is not what was written; the text says how that is known."""


def sealed(content: bytes) -> bytes:
    """Return the content of a file with its SHA-256 behind it."""
    return content + hashlib.sha256(content).digest()


def unsealed(content: bytes) -> bytes:
    """Return what a plan's file holds, once it is known to be what was written.

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
    """Return what wrote a state folder; None where there is nothing, or nothing that can be understood."""
    try:
        return msgspec.msgpack.decode(unsealed(read_state(state / PLAN_NAME)), type=Writer)
    except (FileRefusedError, DamagedError):
        return None


def refuse_newer(state: Path, writer: Writer | None) -> None:
    """Do nothing where this release knows the version of a state folder, or an older one.

    A newer version of a release that is not newer is a damaged file, or a build between two releases: such a
    plan is not run either, and compiled anew.

    Raises:
        StateError: a newer one; with both ways out.
    """
    if writer is None or writer.version <= VERSION or not _is_newer(writer.gateway_version):
        return
    raise StateError(
        f"{state} was written by a newer release, {writer.gateway_version} (state version {writer.version}; "
        f"this is release {gateway.__version__}, which knows versions up to {VERSION}): install that release "
        f"again, or stop the gateway and move {state} away: the axes then start without what they remember"
    )


def upgraded(version: int, plan: Any) -> Any:
    """Return the plain data of a plan of an older version as this one would have written it.

    Raises:
        StateError: nothing leads from that version to this one.
    """
    if version > VERSION:
        raise StateError(f"state version {version} is newer than {VERSION}")
    for each in range(version, VERSION):
        if each not in UPGRADES:
            raise StateError(f"state version {version} is too old to be taken over")
        plan = UPGRADES[each](plan)
    return plan


def newer_release(state: Path) -> str:
    """Return the release that wrote a state folder where it is newer than this one, "" where it is not.

    A release may be newer and write the same state version.
    """
    writer = writer_of(state)
    if writer is None:
        return ""
    return writer.gateway_version if _is_newer(writer.gateway_version) else ""


def _is_newer(release: str) -> bool:
    return _numbers(release) > _numbers(gateway.__version__)


def _numbers(release: str) -> tuple[int, ...]:
    """Return what releases are compared by; whatever is no release is the oldest.

    >>> _numbers("0.10.2") > _numbers("0.9.0"), _numbers("unknown")
    (True, ())
    """
    parts = release.split(".")
    return tuple(map(int, parts)) if all(part.isdecimal() for part in parts) else ()
