#!/usr/bin/env bash
# Makes the virtual environment that every way of installing uses (install.sh, the Debian package, the container).
set -euo pipefail

usage() {
    cat <<'TEXT'
usage: environment.sh [options] FOLDER

Makes a virtual environment with pitch-gateway and uvloop in FOLDER, which must not exist: bin/python3 and
bin/pitch-gateway, and below share/ the systemd units, udev rules, man pages and completions of this release.
The checkout that this script stands in is what is installed.

  --at PATH         where FOLDER will stand in the end; default: where it is made
  --python PYTHON   Python 3.11 or newer with venv; default: python3
  --wheel FILE      install this wheel and not the checkout
  --compiled        compile the hot path; needs a C compiler and the headers of Python
  --find-links DIR  take packages from this folder, and none from an index; may be given again
  --bare            without man pages and completions
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

source_folder=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
python=python3 at='' wheel='' folder='' is_compiled='' is_bare=''
links=()

while [ $# -gt 0 ]; do
    case $1 in
        --at) needs_value $# "$1"; at=$2; shift ;;
        --python) needs_value $# "$1"; python=$2; shift ;;
        --wheel) needs_value $# "$1"; wheel=$2; shift ;;
        --find-links) needs_value $# "$1"; links+=(--no-index --find-links "$2"); shift ;;
        --compiled) is_compiled=1 ;;
        --bare) is_bare=1 ;;
        -h | --help) usage; exit 0 ;;
        -*) die "no such option: $1; see --help" ;;
        *) [ -z "$folder" ] || die "one folder only: $1 is one too many"; folder=$1 ;;
    esac
    shift
done
[ -n "$folder" ] || die "which folder? see --help"
[ ! -e "$folder" ] || die "$folder exists; remove it or name another folder"
[ -z "$wheel" ] || [ -f "$wheel" ] || die "there is no wheel $wheel"
[ -z "$wheel" ] || [ -z "$is_compiled" ] || die "--compiled builds from the checkout: leave --wheel out"

# What is installed, with the name of the extra: a relay without uvloop is slower over TCP.
install_packages() {
    local what="${wheel:-$source_folder}"
    PITCH_GATEWAY_COMPILED=${is_compiled:-0} "$folder/bin/python3" -m pip install --quiet --no-compile \
        --disable-pip-version-check --no-warn-script-location "${links[@]}" "$(realpath "$what")[uvloop]"
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

umask 022
interpreter=$("$python" -c 'import os, sys; print(os.path.realpath(sys.executable))') \
    || die "$python does not run"
mkdir -p "$(dirname "$folder")"
folder=$(cd "$(dirname "$folder")" && pwd)/$(basename "$folder")
at=${at:-$folder}
"$interpreter" -m venv "$folder" || die "$interpreter cannot make a virtual environment (Debian: python3-venv)"
sed -i '/^command = /d' "$folder/pyvenv.cfg"
install_packages
keep_one_command
share
find "$folder" -name __pycache__ -prune -exec rm -rf {} +
compile_all
