#!/usr/bin/env bash
# Makes a fresh checkout ready: a virtual environment with the package and its development tools, in .venv or where
# VENV says, of the Python that PYTHON names or of the first one that is new enough; with the packages that are named
# instead, where some are. Idempotent: it does nothing while pyproject.toml is older than the last run, and nothing that
# is half made stays.
set -euo pipefail
cd "$(dirname "$0")/.."

# One at a time: two that install into one folder spoil it.
exec 9< pyproject.toml
flock 9

venv=${VENV:-.venv}
packages=("$@") space_mb=150
[ $# != 0 ] || { packages=(--editable '.[dev,docs]'); space_mb=700; }
stamp=$venv/.ready           # what it was made for, once it is whole
unfinished=$venv/.unfinished # there until then, in one that is made anew

die() {
    echo "setup: $*" >&2
    exit 1
}

# The Pythons that pyproject.toml claims, newest first, and the oldest of them.
claimed() { grep -o 'Programming Language :: Python :: 3\.[0-9]*' pyproject.toml | sed 's/.* //' | sort -rV; }
oldest=$(claimed | tail -1)

is_new_enough() { "$1" -c "import sys; sys.exit(sys.version_info < (${oldest/./, }))" 2>/dev/null; }

find_python() {
    local candidate
    if [ -n "${PYTHON:-}" ]; then
        local version
        version=$("$PYTHON" -c 'import platform; print(platform.python_version())' 2>/dev/null) \
            || die "PYTHON=$PYTHON does not run; name a Python $oldest or newer"
        is_new_enough "$PYTHON" || die "PYTHON=$PYTHON is Python $version; name a Python $oldest or newer"
        echo "$PYTHON"
        return
    fi
    for candidate in python3 $(claimed | sed 's/^/python/'); do
        if is_new_enough "$candidate"; then
            echo "$candidate"
            return
        fi
    done
    die "pitch-gateway needs Python $oldest or newer and none was found; install one, or name it: PYTHON=/path/to/python3"
}

# A folder that was moved, or another Python, needs an environment of its own: its commands name both.
made_for() { echo "$PWD $("$1" -c 'import sys; print(*sys.version.split())')"; }
is_of_another() { [ -s "$stamp" ] && [ "$(cat "$stamp")" != "$(made_for "${PYTHON:-$venv/bin/python}" 2>/dev/null)" ]; }

free_mb() { df -Pm "$1" | awk 'NR == 2 { print $4 }'; }

# ensurepip keeps to itself why it failed.
is_full() { [[ $1 == *"No space left on device"* || $1 == *"Disk quota exceeded"* ]] || [ "$(free_mb .)" -lt 10 ]; }

# What venv and pip say is long where the reason is short.
die_because() {
    if is_full "$1"; then
        die "the disk is full: $venv needs about $space_mb MB, and $(free_mb .) are free there; pip unpacks in" \
            "${TMPDIR:-/tmp}, where $(free_mb "${TMPDIR:-/tmp}") are free (TMPDIR names another folder)"
    fi
    case $1 in
        *NewConnectionError* | *ConnectTimeout* | *ReadTimeout* | *ProxyError* | *"Connection refused"* \
            | *"name resolution"* | *"(from versions: none)"*)
            die "no index that has the packages could be reached: connect this machine, or let PIP_INDEX_URL name one" \
                "that it reaches, or PIP_NO_INDEX=1 with PIP_FIND_LINKS a folder that has them" ;;
        *"editable mode currently requires"*)
            die "the pip in $venv is too old: $venv/bin/python -m pip install --upgrade pip, or remove $venv" ;;
        *)
            printf '%s\n' "$1" | tail -20 >&2
            die "$venv could not be made; what is said above is the reason" ;;
    esac
}

make_environment() {
    local python said package
    [ ! -e "$venv" ] || die "$venv is there and is no environment that this made: name another folder, or remove it"
    python=$(find_python)
    if ! "$python" -c 'import ensurepip' 2>/dev/null; then
        package="python$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')-venv"
        if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
            die "missing Debian package: $package (as root: apt-get install $package)"
        fi
        said=$( (apt-get update -qq && apt-get install -y -qq "$package") 2>&1) \
            || die "missing Debian package: $package; apt-get could not install it: $(tail -1 <<<"$said")"
    fi
    echo "setting up $venv with $("$python" --version) ..." >&2
    trap 'rm -rf "$venv"' EXIT
    trap 'exit 130' INT TERM HUP
    said=$( (mkdir -p "$venv" && touch "$unfinished" && "$python" -m venv "$venv") 2>&1) || die_because "$said"
}

if [ -n "${PYTHON:-}" ]; then find_python >/dev/null; fi
if [ "$stamp" -nt pyproject.toml ] && [ -s "$stamp" ] && [ -x "$venv/bin/python" ] && ! is_of_another; then
    exit 0
fi
[ -w . ] || die "$(id -un) may not write into $PWD: make a clone of your own"
if [ -e "$unfinished" ] || is_of_another; then rm -rf "$venv"; fi
[ -x "$venv/bin/python" ] || make_environment
said=$("$venv/bin/python" -m pip install --quiet --disable-pip-version-check "${packages[@]}" 2>&1) \
    || die_because "$said"
made_for "$venv/bin/python" > "$stamp"
rm -f "$unfinished"
trap - EXIT
