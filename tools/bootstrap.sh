#!/usr/bin/env bash
# Makes a fresh checkout ready: a virtual environment with the package and its development tools, in .venv or where
# VENV says, of the Python that PYTHON names or of the first one that is new enough. Arguments for pip are installed
# instead, where there are some: `--editable .` is the package with what it runs on, and no tools.
# It does nothing while pyproject.toml is older than the last run that installed as much, and nothing that is half made
# stays. What it does is said on stderr: on a terminal in one line that changes, else in a line for each step.
set -euo pipefail
cd "$(dirname "$0")/.."

# One at a time: two that install into one folder spoil it.
exec 9< pyproject.toml
flock 9

venv=${VENV:-.venv}
packages=("$@") space_mb=150 size=
case "$*" in
    "") packages=(--editable '.[dev,docs]') space_mb=550 size="about 160 MB to fetch, " ;;
    "--editable .") space_mb=210 size="about 55 MB to fetch, " ;;
esac
stamp=$venv/.ready           # what it was made for, and with which packages, once it is whole
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
is_of_another() { [ -s "$stamp" ] && [ "$(head -1 "$stamp")" != "$(made_for "${PYTHON:-$venv/bin/python}" 2>/dev/null)" ]; }

# What is there begins with what is wanted: `--editable .[dev,docs]` has all of `--editable .`.
has_packages() { [[ "$(sed -n 2p "$stamp")" == "${packages[*]}"* ]]; }

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
        echo "installing the Debian package $package ..." >&2
        tools/debian_packages.sh "$package" || die "missing Debian package: $package; apt-get could not install it"
    fi
    echo "setting up $venv with $("$python" --version): ${size}about $space_mb MB on the disk ..." >&2
    trap 'rm -rf "$venv"' EXIT
    trap 'exit 130' INT TERM HUP
    said=$( (mkdir -p "$venv" && touch "$unfinished" && "$python" -m venv "$venv") 2>&1) || die_because "$said"
}

# Shows what pip does and passes its words on. Each second the line on a terminal changes: a big package takes a while.
follow() {
    local text="" piece step="looking up what is needed" said="" status=0
    while [ "$status" != 1 ]; do
        status=0
        IFS= read -r -t 1 piece || status=$?  # 1: the end; above 128: nothing more within the second
        text+=$piece
        if [ "$status" -le 1 ]; then
            echo "$text"
            step=$(step_of "$text" "$step")
            text=""
        fi
        if [ -t 2 ]; then
            printf '\r\033[K  %s, %d s' "$step" "$SECONDS" >&2
        elif [ "$step" != "$said" ] && [[ $step == *" MB)" || $step == installing* ]]; then
            echo "  $step" >&2
        fi
        said=$step
    done
    [ ! -t 2 ] || printf '\r\033[K' >&2
}

# What a line of pip's says of how far it is: `Downloading numpy-2.4.6-cp311-….whl (16.9 MB)` and the like.
step_of() {
    local file
    case $1 in
        *"Downloading "*.whl* | *"Using cached "*.whl* | "Processing "*.whl*)
            file=${1##*/} file=${file##*Downloading } file=${file##*Using cached }
            echo "fetching $(cut -d- -f1,2 <<<"$file")$(grep -o ' ([0-9.]* MB)' <<<"$1" || true)" ;;
        "Installing collected packages: "*) echo "installing $(($(tr -cd , <<<"$1" | wc -c) + 1)) packages" ;;
        *) echo "$2" ;;
    esac
}

if [ -n "${PYTHON:-}" ]; then find_python >/dev/null; fi
if [ "$stamp" -nt pyproject.toml ] && [ -s "$stamp" ] && [ -x "$venv/bin/python" ] && ! is_of_another && has_packages; then
    exit 0
fi
[ -w . ] || die "$(id -un) may not write into $PWD: make a clone of your own"
if [ -e "$unfinished" ] || is_of_another; then rm -rf "$venv"; fi
if [ -x "$venv/bin/python" ]; then
    echo "adding to $venv: ${size}about $space_mb MB on the disk with what is there ..." >&2
else
    make_environment
fi
# Not compiled: Python does that with what is used, as it is used. All of it would take twice as long, and 60 MB more.
said=$("$venv/bin/python" -m pip install --no-compile --progress-bar off --disable-pip-version-check "${packages[@]}" 2>&1 \
    | follow) || die_because "$said"
printf '%s\n' "$(made_for "$venv/bin/python")" "${packages[*]}" > "$stamp"
rm -f "$unfinished"
trap - EXIT
echo "$venv is ready after $SECONDS s: $(du -sm "$venv" | cut -f1) MB" >&2
