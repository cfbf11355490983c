#!/usr/bin/env bash
# Makes a fresh checkout ready: a virtual environment with the package and its development tools in .venv.
# Idempotent: it does nothing while pyproject.toml is older than the last run.
set -euo pipefail
cd "$(dirname "$0")/.."

stamp=.venv/.ready
[ -e "$stamp" ] && [ "$stamp" -nt pyproject.toml ] && exit 0

find_python() {
    local candidate
    for candidate in ${PYTHON:-python3 python3.13 python3.12 python3.11}; do
        if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            command -v "$candidate"
            return
        fi
    done
    echo "pitch-gateway needs Python 3.11 or newer; none was found (set PYTHON=/path/to/python3)" >&2
    return 1
}

python=$(find_python)
if ! "$python" -c 'import ensurepip' 2>/dev/null; then
    package="python$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')-venv"
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        apt-get update -qq && apt-get install -y -qq "$package" >/dev/null
    else
        echo "missing Debian package: $package (as root: apt-get install $package)" >&2
        exit 1
    fi
fi

echo "setting up .venv with $("$python" --version) ..." >&2
[ -x .venv/bin/python ] || "$python" -m venv .venv
.venv/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[dev,docs,uvloop]'
touch "$stamp"
