"""Compiles the hot path to machine code (mypyc): ``python tools/compiled.py FOLDER`` (docs/decisions/0014).

Copies the package ``gateway`` into FOLDER and compiles it there: a compiled module stands beside its source
and is imported instead of it. The checkout itself is never touched, so that what is edited is what runs.
``--only-c`` stops at the generated C: enough to see that the sources can be compiled.

Needs mypy, setuptools, a C compiler and the headers of Python (Debian: gcc, python3-dev).
"""

import argparse
import os
import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PATTERNS = (
    "compensation/*.py",
    "exchange/*.py",
    "modbus/*.py",
    "relay/controller_port.py",
    "relay/drive_link.py",
    "relay/pacing.py",
    "relay/recorded.py",
    "relay/timed.py",
)
"""What runs while a frame passes."""
PLAIN = (
    "compensation/settings.py",
    "exchange/plan.py",
    "exchange/ports.py",
    "exchange/rights.py",
    "modbus/registers.py",
)
"""Left as they are: plans, which msgspec takes apart and puts together, and interfaces that Python classes of
the relay and of tests inherit."""


def modules(package: Path) -> list[str]:
    """Return the files to compile, relative to the folder of the package."""
    found = {path for pattern in PATTERNS for path in package.glob(pattern)}
    plain = {package / name for name in PLAIN}
    missing = [str(path) for path in plain - found]
    if missing:
        raise SystemExit(f"no such module any more: {', '.join(missing)}; see PLAIN in {__file__}")
    return sorted(str(path.relative_to(package.parent)) for path in found - plain)


def compile_in(folder: Path, *, is_only_c: bool) -> None:
    """Compile the copy of the package in a folder."""
    from mypyc.build import mypycify
    from setuptools import setup

    os.chdir(folder)
    # The caller's own settings for mypy have nothing to say here.
    options = ["--config-file=", "--ignore-missing-imports", "--explicit-package-bases"]
    extensions = mypycify(
        [*options, *modules(Path("gateway"))], opt_level="2", debug_level="0", multi_file=True
    )
    if not is_only_c:
        arguments = ["--quiet", "build_ext", "--inplace", "--parallel", str(os.cpu_count() or 1)]
        setup(name="gateway-compiled", ext_modules=extensions, packages=[], script_args=arguments)
    shutil.rmtree("build")


def main() -> None:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("folder", type=Path, help="where the compiled package goes; must not hold one")
    parser.add_argument("--only-c", action="store_true", help="stop at the generated C")
    options = parser.parse_args()
    target: Path = options.folder.resolve() / "gateway"
    if target.exists():
        sys.exit(f"{target} exists; remove it or name another folder")
    shutil.copytree(ROOT / "gateway", target, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    compile_in(options.folder.resolve(), is_only_c=options.only_c)


if __name__ == "__main__":
    main()
