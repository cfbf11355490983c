"""Compiles the hot path to machine code (mypyc): ``python tools/compiled.py FOLDER`` (docs/decisions/0028).

Copies the package ``gateway`` into FOLDER and compiles it there: a compiled module stands beside its source
and is imported instead of it. The checkout itself is never touched, so that what is edited is what runs.
``--only-c`` stops at the generated C: enough to see that the sources can be compiled. ``--needs`` prints the
packages that the compiling needs, as pyproject.toml declares them; ``--missing`` what this machine lacks for
it, nothing where it has all: a C compiler and the headers of Python (Debian: gcc, python3-dev).
"""

import argparse
import ast
import os
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tomllib
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parent.parent
COMPILERS = ("mypy", "setuptools")
"""What compiles; their versions are those of the development tools."""
COME_WITH_THEM = frozenset({"mypy_extensions"})
"""Packages that are there wherever the compilers are."""
PATTERNS = (
    "backoff.py",
    "clock.py",
    "compensation/*.py",
    "exchange/*.py",
    "exchange/axis/*.py",
    "exchange/cut_through/*.py",
    "recording/trace_buffer.py",
    "limits.py",
    "modbus/*.py",
    "relay/axis_record.py",
    "relay/alarm.py",
    "relay/controller_port.py",
    "relay/drive_link.py",
    "relay/pacing.py",
    "relay/pulse.py",
    "recording/tap.py",
    "transport/channel.py",
    "transport/direct.py",
    "transport/selector.py",
    "transport/serial_channel.py",
    "transport/timer.py",
)
"""What runs while a frame passes."""
IN_C = ("gateway/_system.c",)
"""What is written in C, because Python cannot say it without making objects."""
AS_ONE = ("-flto=auto", "-fvisibility=hidden")
"""With which the C compiler optimises all modules as one, where it takes them."""
PLAIN = (
    "compensation/settings.py",
    "exchange/commands.py",
    "exchange/plan.py",
    "exchange/rights.py",
    "modbus/registers.py",
)
"""Left as they are: plans and commands, which msgspec takes apart and puts together."""


def modules(package: Path) -> list[str]:
    """Return the files to compile, relative to the folder of the package."""
    found = {path for pattern in PATTERNS for path in package.glob(pattern)}
    plain = {package / name for name in PLAIN}
    missing = [str(path) for path in plain - found]
    if missing:
        raise SystemExit(f"no such module any more: {', '.join(missing)}; see PLAIN in {__file__}")
    return sorted(str(path.relative_to(package.parent)) for path in found - plain)


def needs() -> list[str]:
    """Return the requirements of pyproject.toml that the compiling takes.

    mypy reads the types of whatever the compiled modules import, and what these import: without one of these
    packages it finds errors where there are none.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    declared = {}
    for requirement in (*project["optional-dependencies"]["dev"], *project["dependencies"]):
        name = re.match(r"[\w.-]+", requirement)
        assert name is not None, requirement
        declared[re.sub(r"[-_.]+", "_", name[0]).lower()] = requirement
    wanted = {*COMPILERS, *imported_packages(modules(ROOT / "gateway"))}
    unknown = sorted(wanted - set(declared))
    if unknown:
        raise SystemExit(
            f"pyproject.toml: no dependency is called {', '.join(unknown)}, which {__file__} needs"
        )
    return [declared[name] for name in sorted(wanted)]


def imported_packages(files: list[str]) -> set[str]:
    """Return the packages of others that modules import, and the modules of ours that these import."""
    found: set[str] = set()
    seen: set[str] = set()
    left = list(files)
    while left:
        file = left.pop()
        if file in seen:
            continue
        seen.add(file)
        for name in imports(ROOT / file):
            first = name.partition(".")[0]
            if first == "gateway":
                left.extend(files_of(name))
            elif first not in sys.stdlib_module_names and first not in COME_WITH_THEM:
                found.add(first)
    return found


def imports(file: Path) -> Iterator[str]:
    """Yield each name that a file imports, in full; what it takes from a module may be one itself."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def files_of(name: str) -> Iterator[str]:
    """Yield the files, relative to the checkout, that an import of this name reads."""
    parts = name.split(".")
    for length in range(1, len(parts) + 1):
        path = Path(*parts[:length])
        for file in (path / "__init__.py", path.with_suffix(".py")):
            if (ROOT / file).is_file():
                yield str(file)


def missing() -> str:
    """Return what this machine lacks to compile for this Python, "" where it lacks nothing."""
    command = compiler()
    if shutil.which(command[0]) is None:
        return f"there is no C compiler ({command[0]}; Debian: apt install gcc python3-dev)"
    folders = [sysconfig.get_path("include"), sysconfig.get_path("platinclude")]
    if not any(Path(folder, "Python.h").is_file() for folder in folders):
        return f"there is no {folders[0]}/Python.h (Debian: apt install python3-dev)"
    tried = [*command, *(f"-I{folder}" for folder in folders), "-fsyntax-only", "-x", "c", "-"]
    done = subprocess.run(tried, input="#include <Python.h>\n", capture_output=True, text=True, check=False)
    return f"the C compiler cannot read Python.h: {first_error(done.stderr)}" if done.returncode else ""


def as_one() -> tuple[str, ...]:
    """Return the flags with which all modules are optimised as one; none where the C compiler has no such.

    Functions of other modules are put in place then. As one file it would need three times the memory.
    """
    with TemporaryDirectory() as folder:
        made = str(Path(folder) / "made.so")
        tried = [*compiler(), *AS_ONE, "-shared", "-fPIC", "-O2", "-x", "c", "-", "-o", made]
        source = "int of_one(void) { return 1; }\n"
        done = subprocess.run(tried, input=source, capture_output=True, text=True, check=False)
    return () if done.returncode else AS_ONE


def compiler() -> list[str]:
    """Return the command of the C compiler."""
    return shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")


def first_error(output: str) -> str:
    """Return the line of what mypy or a C compiler said that is the first to call itself an error."""
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    errors = (line for line in lines if re.search(r"\b([Ff]atal error|[Ee]rror): |No space left", line))
    return next(errors, lines[-1] if lines else "it said nothing")


def compile_in(folder: Path, *, is_only_c: bool) -> None:
    """Compile a copy of the package in a folder, which must be empty."""
    import mypyc
    from mypyc.build import mypycify
    from setuptools import Extension, setup

    shutil.copytree(
        ROOT / "gateway", folder / "gateway", ignore=shutil.ignore_patterns("__pycache__", "*.so")
    )
    # What is compiled says where its parts lay, which is another temporary folder each time.
    source = Path(mypyc.__file__).parent.parent
    renamed = shlex.quote(f"-ffile-prefix-map={source}=.")
    # Optimised as one, the code is made when it is linked, for which Python's own settings may ask for -g:
    # that would name the folder too.
    flags = [*(() if is_only_c else as_one()), os.environ.get("CFLAGS", ""), renamed, "-g0"]
    os.environ["CFLAGS"] = " ".join(flags)
    os.chdir(folder)
    # The caller's own settings for mypy have nothing to say here.
    options = ["--config-file=", "--ignore-missing-imports", "--explicit-package-bases"]
    extensions = mypycify(
        [*options, *modules(Path("gateway"))], opt_level="2", debug_level="0", multi_file=True
    )
    extensions += [Extension(file.removesuffix(".c").replace("/", "."), [file]) for file in IN_C]
    if not is_only_c:
        arguments = ["--quiet", "build_ext", "--inplace", "--parallel", str(os.cpu_count() or 1)]
        setup(name="gateway-compiled", ext_modules=extensions, packages=[], script_args=arguments)
    for made in ("build", ".mypy_cache"):
        shutil.rmtree(made)


def main() -> None:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument(
        "folder", type=Path, nargs="?", help="where the compiled package goes; must not hold one"
    )
    parser.add_argument("--only-c", action="store_true", help="stop at the generated C")
    parser.add_argument("--needs", action="store_true", help="print the packages that the compiling needs")
    parser.add_argument("--missing", action="store_true", help="print what this machine lacks for it")
    options = parser.parse_args()
    if options.needs or options.missing:
        print("\n".join(needs()) if options.needs else missing())
        return
    if options.folder is None:
        parser.error("which folder?")
    folder: Path = options.folder.resolve()
    if (folder / "gateway").exists():
        sys.exit(f"{folder / 'gateway'} exists; remove it or name another folder")
    if not options.only_c and (lacking := missing()):
        sys.exit(lacking)
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder) as work:
        compile_in(Path(work), is_only_c=options.only_c)
        for made in Path(work).iterdir():
            made.rename(folder / made.name)


if __name__ == "__main__":
    main()
