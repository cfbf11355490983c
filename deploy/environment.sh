#!/usr/bin/env bash
# Makes the virtual environment that every way of installing uses (install.sh, the Debian package, the container).
set -euo pipefail

usage() {
    cat <<'TEXT'
usage: environment.sh [options] FOLDER

Makes a virtual environment with pitch-gateway in FOLDER, which must not exist: bin/python3 and
bin/pitch-gateway, and below share/ the systemd units, udev rules, man pages and completions of this release.
The checkout that contains this script is installed, with the packages of deploy/requirements.txt; each
is checked by its hash. Its hot path is compiled where there is a C compiler and Python.h.

  --at PATH         where FOLDER will be in the end; default: where it is made
  --python PYTHON   Python 3.11 or newer with venv; default: python3
  --wheel FILE      install this wheel and not the checkout; compiled or not, as it is
  --compiled        compile the hot path, or fail
  --pure            compile nothing
  --find-links DIR  take packages from this folder, and none from an index; may be given again
  --bare            without man pages and completions
  --kind            only say which kind it would be: compiled, pure or wheel
  -h, --help        this text
TEXT
}

die() {
    echo "environment.sh: $*" >&2
    exit 1
}

needs_value() {
    [ "$1" -ge 2 ] || die "$2 needs a value; see --help"
}

readonly PIP_NEEDED=22.3 # the one that came with Python 3.11; much older ones do not know the names of today's wheels
source_folder=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
python=python3 at='' wheel='' folder='' kind='' is_bare='' is_question='' work='' is_whole=''
links=()

while [ $# -gt 0 ]; do
    case $1 in
        --at) needs_value $# "$1"; at=$2; shift ;;
        --python) needs_value $# "$1"; python=$2; shift ;;
        --wheel) needs_value $# "$1"; wheel=$2; shift ;;
        --find-links) needs_value $# "$1"; links+=(--no-index --find-links "$2"); shift ;;
        --compiled | --pure)
            [ -z "$kind" ] || [ "$kind" = "${1#--}" ] || die "--compiled or --pure, not both"
            kind=${1#--}
            ;;
        --bare) is_bare=1 ;;
        --kind) is_question=1 ;;
        -h | --help) usage; exit 0 ;;
        -*) die "no such option: $1; see --help" ;;
        *) [ -z "$folder" ] || die "one folder only: $1 is one too many"; folder=$1 ;;
    esac
    shift
done
[ -n "$folder$is_question" ] || die "which folder? see --help"
[ -z "$folder" ] || [ ! -e "$folder" ] || die "$folder exists; remove it or name another folder"
[ -z "$wheel" ] || [ -f "$wheel" ] || die "there is no wheel $wheel"
[ -z "$wheel" ] || [ -z "$kind" ] || die "--$kind is for the checkout, and a wheel is what it is: leave --wheel out"

# Says which kind is installed: the checkout compiled where it can be, or as it was asked for.
find_kind() {
    local lacking
    [ -z "$wheel" ] || kind=wheel
    case $kind in wheel | pure) return ;; esac
    lacking=$("$interpreter" "$source_folder/tools/compiled.py" --missing) || die "tools/compiled.py does not run"
    [ -z "$kind" ] || [ -z "$lacking" ] || die "--compiled: $lacking"
    kind=compiled
    if [ -n "$lacking" ]; then
        kind=pure
        echo "not compiled: $lacking; as Python it does the same, and adds more to an exchange over TCP" >&2
    fi
}

# Runs a program that says nothing where it succeeds; where it fails, one sentence says why.
must() {
    local said
    said=$("$@" 2>&1) || die "$(reason "$said")"
}

reason() {
    local what
    case $1 in
        *'No space left on device'*)
            echo "the disk is full, in $(dirname "$folder") or in ${TMPDIR:-/tmp}: make room (df and df -i show where)"
            ;;
        *'DO NOT MATCH THE HASHES'*)
            echo "a package is not the one that deploy/requirements.txt or deploy/build-requirements.txt pins by its" \
                "hash; it may have been tampered with:$(grep -A 1 -E '^ +[^ ]+ from ' <<< "$1" | tr -s ' \n' ' ')"
            ;;
        *'could not be compiled'*)
            sed -n '/could not be compiled/,$p' <<< "$1"
            ;;
        *'No matching distribution'*)
            what=$(sed -n 's/^ERROR: No matching distribution found for \([^ ]*\).*/\1/p' <<< "$1")
            if [ "${#links[@]}" = 0 ]; then
                echo "$what cannot be fetched. Is there a network? Without one: --find-links DIR, with all packages" \
                    "in DIR (docs/install.md)"
            else
                echo "$what for this Python and machine is not in the folder of --find-links; docs/install.md says" \
                    "how to fill it"
            fi
            ;;
        *)
            grep -m 1 -E '^(ERROR|error|Error)' <<< "$1" || tail -n 3 <<< "$1"
            ;;
    esac
}

install_into() {
    local environment=$1
    shift
    must "$environment/bin/python3" -m pip install --quiet --no-compile --disable-pip-version-check \
        --no-warn-script-location "${links[@]}" "$@"
}

must_have_space() {
    local free
    free=$(df -Pk "$1" | awk 'NR == 2 { print int($4 / 1000) }')
    [ "$free" -ge "$2" ] || die "$1 has $free MB free, and $2 MB are needed while the environment is made: make" \
        "room${3:-}"
}

must_have_new_pip() {
    local version
    version=$("$folder/bin/python3" -m pip --version | cut -d' ' -f2)
    [ "$(printf '%s\n' $PIP_NEEDED "$version" | sort -V | head -n 1)" = $PIP_NEEDED ] \
        || die "$interpreter brings pip $version, and $PIP_NEEDED or newer is needed: update Python, or name another" \
            "one with --python"
}

# In an environment of its own: what builds the wheel is not what runs.
build_wheel() {
    [ "$kind" = pure ] || echo "compiling, which takes a minute or more ..." >&2
    must "$interpreter" -m venv "$work/build"
    install_into "$work/build" --require-hashes -r "$source_folder/deploy/build-requirements.txt"
    (
        cd "$source_folder"
        export PYTHONDONTWRITEBYTECODE=1 PITCH_GATEWAY_COMPILED=1
        [ "$kind" = compiled ] || PITCH_GATEWAY_COMPILED=0
        must "$work/build/bin/python3" -m hatchling build --target wheel --directory "$work/wheel"
    ) || exit 1
    wheel=$(echo "$work"/wheel/*.whl)
}

install_packages() {
    install_into "$folder" --require-hashes -r "$source_folder/deploy/requirements.txt"
    [ -n "$wheel" ] || build_wheel
    install_into "$folder" --no-index --no-deps "$(realpath "$wheel")"
    must "$folder/bin/python3" -m pip --disable-pip-version-check check
    forget_where_the_wheel_lay
}

# pip notes the path of a wheel that it installs by its path: that of a temporary folder here.
forget_where_the_wheel_lay() {
    local info
    for info in "$folder"/lib/python3.*/site-packages/pitch_gateway-*.dist-info; do
        rm -f "$info/direct_url.json"
        sed -i '/\/direct_url\.json,/d' "$info/RECORD"
    done
}

# The packages bring commands of their own (uvicorn, typer, ...), each with the path of the folder in it. Nobody
# needs them, nor pip: what is in the environment is changed by a new one.
keep_one_command() {
    "$folder/bin/python3" -m pip --disable-pip-version-check uninstall --quiet --yes setuptools pip
    find "$folder/bin" -mindepth 1 ! -name 'python*' -delete
    # One name is enough for the interpreter; it leads to the one that was named, not to whatever python3 is then.
    ln -sfn "$interpreter" "$folder/bin/python3"
    find "$folder/bin" -name 'python*' ! -name python3 -delete
    cat > "$folder/bin/pitch-gateway" <<TEXT
#!$at/bin/python3
import sys

from gateway.cli.main import main

sys.exit(main())
TEXT
    chmod 755 "$folder/bin/pitch-gateway"
}

# Compiled here, for the user of the service may not write; with hashes, for packers change the times of files.
compile_all() {
    "$folder/bin/python3" -m compileall -q -s "$folder" -p "$at" --invalidation-mode checked-hash "$folder/lib"
}

share() {
    local to="$folder/share/pitch-gateway" from
    mkdir -p "$to"
    for from in systemd systemd/sysusers.d systemd/tmpfiles.d deploy/udev; do
        [ -d "$source_folder/$from" ] || continue
        mkdir "$to/$(basename "$from")"
        find "$source_folder/$from" -maxdepth 1 -type f -exec cp -t "$to/$(basename "$from")" {} +
    done
    if [ -z "$is_bare" ]; then
        "$folder/bin/python3" "$source_folder/tools/man_pages.py" "$to/man"
        "$folder/bin/python3" "$source_folder/tools/completions.py" "$to/completions"
    fi
    chmod -R u=rwX,go=rX "$to"
}

leave_nothing_half_made() {
    [ -z "$work" ] || rm -rf "$work"
    [ -n "$is_whole" ] || rm -rf "$folder"
}

umask 022
# Old ones understand these words, too.
interpreter=$("$python" -c 'import os, sys; print(os.path.realpath(sys.executable)); sys.exit(sys.version_info < (3, 11))') \
    || die "needs Python 3.11 or newer; $python is $("$python" --version 2>&1 || echo 'none that runs') (Debian 12 has" \
        "it: apt install python3 python3-venv; or name another one with --python)"
find_kind
if [ -n "$is_question" ]; then
    echo "$kind"
    exit
fi
mkdir -p "$(dirname "$folder")"
folder=$(cd "$(dirname "$folder")" && pwd)/$(basename "$folder")
at=${at:-$folder}
must_have_space "$(dirname "$folder")" 400
must_have_space "${TMPDIR:-/tmp}" 200 ', or set TMPDIR to another folder'
trap leave_nothing_half_made EXIT
work=$(mktemp -d)
"$interpreter" -c 'import venv, ensurepip' 2>/dev/null \
    || die "$interpreter cannot make a virtual environment (Debian: apt install python3-venv)"
must "$interpreter" -m venv "$folder"
must_have_new_pip
sed -i '/^command = /d' "$folder/pyvenv.cfg"
rm -f "$folder/.gitignore" # Python 3.13 writes one
install_packages
keep_one_command
share
find "$folder" -name __pycache__ -prune -exec rm -rf {} +
compile_all
is_whole=1
