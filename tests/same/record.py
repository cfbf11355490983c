"""Plays what the same-bytes test compares, in the revision that Python finds.

``record.py ADAPTER FOLDER PLAY ...``; without a play it prints the names of those that the revision has. Each
play is one file in FOLDER. It is written whole or not at all, so that a run that was cut short goes on.
"""

import importlib.util
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType


def main() -> int:
    """Play each in a child of its own: what one has changed inside does not reach the next."""
    adapter, folder, *plays = sys.argv[1:]
    module = _loaded(Path(adapter))
    Path(folder).mkdir(parents=True, exist_ok=True)
    if not plays:
        sys.stdout.write("\n".join(_names(module)) + "\n")
        return 0
    for play in plays:
        child = os.fork()
        if not child:
            try:
                _write(module, play, Path(folder))
            finally:
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(0)
        os.waitpid(child, 0)
    return 0


def file_of(folder: Path, play: str) -> Path:
    """Return where the transcript of a play is."""
    return folder / (play.replace("/", "_").replace(":", "_") + ".txt")


def _names(module: ModuleType) -> Iterator[str]:
    yield from (f"session:{name}" for name in module.session_names())
    yield from (f"fuzz:{name}" for name in module.corpus())
    yield from (f"world:{name}" for name in module.worlds())
    yield from (f"plan:{name}" for name in module.plans())


def _loaded(adapter: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(adapter.stem, adapter)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _write(module: ModuleType, play: str, folder: Path) -> None:
    kind, _, name = play.partition(":")
    target = file_of(folder, play)
    written = target.with_suffix(".new")
    with written.open("w", encoding="utf-8") as out:
        try:
            for line in _lines(module, kind, name):
                out.write(line + "\n")
        except Exception as error:  # noqa: BLE001 - how it ends is a part of the play
            out.write(f"ended with {type(error).__name__}: {error}\n")
    written.replace(target)


def _lines(module: ModuleType, kind: str, name: str) -> Iterator[str]:
    if kind == "ledger":
        seed, _, requests = name.partition("x")
        yield from module.ledger(int(seed), int(requests))
    elif kind == "commands":
        sys.path.append(str(Path(__file__).parents[2]))  # a baseline may have no tests.support of its own
        yield from _loaded(Path(__file__).with_name("commands.py")).script()
    elif kind == "plan":
        yield from module.plan(name)
    elif kind == "world":
        yield from module.world(name)
    else:
        yield from (module.session if kind == "session" else module.fuzzed)(name)


if __name__ == "__main__":
    sys.exit(main())
