"""Fuzzes one target in this process: ``python -m tests.fuzz.one TARGET``, and what libFuzzer is told."""

import shlex
import sys


def main() -> None:
    """Run until libFuzzer has had enough; it ends the process."""
    import atheris  # only where something is fuzzed: it does not exist for every Python

    name = sys.argv.pop(1)
    # Merging, libFuzzer starts itself again by this name, through a shell.
    sys.argv[0] = f"{shlex.quote(sys.executable)} -m tests.fuzz.one {name}"
    atheris.enabled_hooks.add("str")
    with atheris.instrument_imports(include=["gateway"]):
        from tests.fuzz.targets import TARGETS
    atheris.Setup(sys.argv, TARGETS[name].run)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
