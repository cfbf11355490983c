"""Compiles a configuration into the state folder, in the form from which the relay starts."""

import hashlib
import json
from collections.abc import Iterator
from typing import Any

from gateway.config.load import Loaded
from gateway.config.problems import key_text
from gateway.config.toml import KeyPath
from gateway.ipc.service_user import why_not_for_root
from gateway.state.folder import StateError, problem_of
from gateway.state.plan import CompiledPlan, GatewayPlan, TablesFolder, write_plan


def compile_into_state(
    loaded: Loaded,
    plan: GatewayPlan | None = None,
    tables_folder: TablesFolder | None = None,
    over: CompiledPlan | None = None,
) -> dict[str, bytes]:
    """Write a plan, its tables and its sources; return the compiled tables by axis.

    ``plan`` is the resulting plan (``last_good.settle``); without it, that of the configuration.
    ``tables_folder`` is the folder that its tables were in, if that is not the one they were read from.
    ``over`` is the plan to replace, if only that one may be replaced.

    Raises:
        StateError: the state folder cannot be written, or not by root; or a profile was removed, or another
            configuration was compiled meanwhile; with the remedy.
    """
    sources = sources_of(loaded)
    if problem := why_not_for_root(loaded.state_folder):
        raise StateError(f"gateway.state: {problem}")
    try:
        return write_plan(
            loaded.state_folder,
            plan or loaded.plan,
            sources,
            loaded.document.text,
            tables_folder or loaded.read_from,
            over=over,
        )
    except OSError as error:
        raise StateError(f"gateway.state: {problem_of(error, loaded.state_folder)}") from None


def sources_of(loaded: Loaded) -> dict[str, str]:
    """Return the files that a plan is made from, by absolute path, with the SHA-256 of each.

    Tables of axes are not included; those of ``cross`` are.

    Raises:
        StateError: a profile was removed meanwhile.
    """
    return {**loaded.document.files, **named_sources(loaded)}


def named_sources(loaded: Loaded) -> dict[str, str]:
    """Return those of :func:`sources_of` that the configuration names: profiles, and tables of ``cross``.

    Raises:
        StateError: a profile was removed meanwhile.
    """
    sources = {}
    try:
        for drive in loaded.drives.values():
            if not drive.is_shipped:
                profile = (loaded.path.parent / drive.name).resolve()
                sources[str(profile)] = hashlib.sha256(profile.read_bytes()).hexdigest()
        for cross in (each for crosses in loaded.crosses.values() for each in crosses):
            sources[str(cross.path.resolve())] = cross.plan.table_digest
    except OSError as error:
        raise StateError(f"{error.filename}: {error.strerror or error}; it existed a moment ago") from None
    return sources


def keys_of(tables: Any) -> dict[str, str]:
    """Return the values of a document as JSON, by key, so that two documents can be compared.

    >>> keys_of({"axis": {"x": {"gain": 0.5, "travel": [0, 10]}}})
    {'axis.x.gain': '0.5', 'axis.x.travel[1]': '0', 'axis.x.travel[2]': '10'}
    """
    return {key_text(path): json.dumps(value, default=str) for path, value in leaves(tables)}


def leaves(here: Any, path: KeyPath = ()) -> Iterator[tuple[KeyPath, Any]]:
    """Yield each value of a document with its key, of lists each element."""
    pairs = here.items() if isinstance(here, dict) else enumerate(here) if isinstance(here, list) else ()
    if not isinstance(here, dict | list) or not here:
        yield path, here
    for key, value in pairs:
        yield from leaves(value, (*path, key))
