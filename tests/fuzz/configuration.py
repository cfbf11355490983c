"""gateway.toml, as the file that a person wrote."""

import atexit
import shutil
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Final

from gateway.config.load import load
from gateway.config.problems import ConfigErrors
from gateway.config.reference import TABLES
from gateway.drives import library
from tests.config.config_bench import GOOD

DEPLOY: Final = Path(__file__).parents[2] / "deploy"


@cache
def folder() -> Path:
    """Return a folder of this process's own with the tables of the examples; gone when it ends."""
    made = Path(mkdtemp(prefix="pitch-gateway-fuzz-"))
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    shutil.copytree(DEPLOY / "tables", made / "tables")
    return made


def files(data: bytes) -> None:
    """A file is a configuration from which a gateway can run, or is refused with all that is wrong with it.

    Every problem and every warning is one line that begins with the file and says what was found.
    """
    path = folder() / "gateway.toml"
    path.write_bytes(data)
    try:
        loaded = load(path)
    except ConfigErrors as errors:
        problems, warnings = errors.problems, errors.warnings
        assert problems, "refused without a reason"
    else:
        problems, warnings = (), loaded.warnings
        assert loaded.plan.lines, "nothing that could run"
    for problem in (*problems, *warnings):
        assert problem.found.strip(), problem
        assert "\n" not in str(problem), problem
        assert str(problem).startswith("/"), problem


def seeds() -> Iterator[bytes]:
    """Yield the examples, and a file for each known drive."""
    for name in ("gateway.example.toml", "gateway.profile.example.toml"):
        yield (DEPLOY / name).read_bytes()
    yield GOOD.encode()
    head = GOOD.partition("[axis.x.registers]")[0]
    for drive in library.names():
        yield head.replace("unit_id = 1\n", f'unit_id = 1\ndrive = "{drive}"\n').encode()


def words() -> Iterator[bytes]:
    """Yield the names of all keys."""
    for name in {key for table in TABLES.values() for _, key in table.fields()}:
        yield name.encode()
