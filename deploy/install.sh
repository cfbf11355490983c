#!/usr/bin/env bash
# Installs pitch-gateway on this machine from a checkout; uninstalls it; goes back to the release before.
set -euo pipefail
umask 022 # whatever root's is: the user of the service has to get in

usage() {
    cat <<'TEXT'
usage: install.sh [options] install | uninstall | rollback | status

  install     puts this release into /opt/pitch-gateway, with units, udev rules, man pages and completions.
              Over an older one it is the upgrade; a second time it changes nothing. What runs goes on with
              the release that it was started from until you restart it. Configuration, tables and state are
              never touched.
  rollback    goes back to the release before; once more comes back.
  uninstall   stops the services and removes the program. Configuration, tables and state stay.
  status      what is installed, what runs, what is there. Changes nothing.

  --wheel FILE        install this wheel and not the checkout
  --from DIR          install the checkout in DIR and not the one that contains this script
  --compiled          fail where the hot path cannot be compiled. By default it is compiled where there is a C compiler
                      and Python.h (Debian: gcc, python3-dev), and installed as Python where not
  --pure              compile nothing
  --find-links DIR    take packages from this folder, and none from an index: for machines without a network
  --python PYTHON     Python 3.11 or newer; default: Debian's python3, if it is new enough
  --enable            start the services with the machine from now on (not now: that is systemctl start)
  --purge             with uninstall: remove configuration, tables, state and drop-ins of the units too; asks first
  --yes               do not ask
  --prefix-root DIR   install into the tree in DIR, as into a mounted disk
  --dry-run           say what would be done, and change nothing
  -h, --help          this text
TEXT
}

readonly NAME=pitch-gateway
here=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
command='' root='' wheel='' from=$here python='' kind='' is_enabled='' is_purge='' is_yes='' is_dry='' has_changed=''
links=()

say() { echo "$*"; }
die() {
    echo "install.sh: $*" >&2
    exit 1
}
needs_value() { [ "$1" -ge 2 ] || die "$2 needs a value; see --help"; }

while [ $# -gt 0 ]; do
    case $1 in
        --prefix-root) needs_value $# "$1"; root=$2; shift ;;
        --wheel) needs_value $# "$1"; wheel=$2; shift ;;
        --from) needs_value $# "$1"; from=$2; shift ;;
        --python) needs_value $# "$1"; python=$2; shift ;;
        --find-links) needs_value $# "$1"; links+=(--find-links "$2"); shift ;;
        --compiled | --pure)
            [ -z "$kind" ] || [ "$kind" = "${1#--}" ] || die "--compiled or --pure, not both"
            kind=${1#--}
            ;;
        --enable) is_enabled=1 ;;
        --purge) is_purge=1 ;;
        --yes) is_yes=1 ;;
        --dry-run) is_dry=1 ;;
        -h | --help) usage; exit 0 ;;
        -*) die "no such option: $1; see --help" ;;
        *) [ -z "$command" ] || die "one command only: $1 is one too many; see --help"; command=$1 ;;
    esac
    shift
done
if [ -n "$root" ]; then
    [ -d "$root" ] || die "--prefix-root: there is no folder $root"
    root=$(cd "$root" && pwd)
    [ "$root" != / ] || root=''
fi

# Where everything is. A release has a folder of its own, so that a process keeps the files that it was started
# from; /opt/pitch-gateway is a link to the one that is installed, and changes at one stroke.
readonly CURRENT=/opt/$NAME PREVIOUS=/opt/$NAME.previous RELEASES=/opt/$NAME.releases
readonly ETC=/etc/$NAME STATE=/var/lib/$NAME LIB=/usr/local/lib SHARE=/usr/local/share
# What `pitch-gateway service` wrote, and what an administrator put beside it.
readonly DROP_INS=(/etc/systemd/system/"$NAME"-{relay,supervisor}.service.d)
readonly COMMAND_LINK=/usr/local/bin/$NAME
readonly UNITS=("$NAME.target" "$NAME-supervisor.service" "$NAME-relay.service")

release_of() { readlink "$root$1" 2>/dev/null || true; } # of a link, relative to /opt
origin() { cat "$root/opt/$(release_of "$1")/share/$NAME/origin" 2>/dev/null || true; }
version_of() { sed -n 's/^version //p' "$root/opt/$(release_of "$1")/share/$NAME/origin" 2>/dev/null || true; }
is_systemd_running() { [ -z "$root" ] && [ -d /run/systemd/system ]; }
has() { command -v "$1" >/dev/null; }

must_be_root() {
    [ "$(id -u)" = 0 ] || [ -n "$is_dry" ] || [ -n "$root" ] || die "only root can $command it: sudo $0 $command"
}

# Two ways of installing at once would remove each other's files.
must_not_be_packaged() {
    local status
    status=$(dpkg-query ${root:+--admindir="$root/var/lib/dpkg"} -W -f '${db:Status-Status}' $NAME 2>/dev/null) \
        || status=none
    [ "$status" != installed ] || die "it is installed as a Debian package; apt remove $NAME first, or use apt"
    [ ! -e "$root$CURRENT" ] || [ -L "$root$CURRENT" ] \
        || die "$CURRENT is no link that install.sh made; move it away first"
}

# Newest first.
claimed_pythons() {
    grep -o 'Programming Language :: Python :: 3\.[0-9]*' "$here/pyproject.toml" | sed 's/.* //' | sort -rV
}

find_python() {
    local candidate candidates=(/usr/bin/python3) too_old=''
    for candidate in $(claimed_pythons); do candidates+=("/usr/bin/python$candidate"); done
    candidates+=(python3)
    [ -z "$python" ] || candidates=("$python")
    for candidate in "${candidates[@]}"; do
        if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            python=$(command -v "$candidate")
            may_all_run || die "$python is below a folder that other users may not enter ($(real_python)): the" \
                "user of the service could not start it. Take another one with --python, as Debian's python3"
            "$python" -c 'import venv, ensurepip' 2>/dev/null \
                || die "$python has no venv or pip (Debian: apt install python3-venv)"
            return
        fi
        [ -n "$too_old" ] || too_old=$("$candidate" -c \
            'import platform, sys; print(sys.executable, "is Python", platform.python_version())' 2>/dev/null) || true
    done
    [ -z "$too_old" ] || die "needs Python 3.11 or newer, and $too_old: name a newer one with --python, or install" \
        "on a newer system (Debian 12 has 3.11)"
    die "needs Python 3.11 or newer; ${python:-none} was found (Debian: apt install python3 python3-venv;" \
        "or name one with --python)"
}

real_python() { "$python" -c 'import os, sys; print(os.path.realpath(sys.executable))'; }
may_all_run() {
    "$python" - <<'TEXT'
import os, pathlib, sys
path = pathlib.Path(os.path.realpath(sys.executable))
sys.exit(not all(folder.stat().st_mode & 1 for folder in (path, *path.parents)))
TEXT
}

# What an environment is made of: the same again needs no new one.
wanted_origin() {
    local source version
    if [ -n "$wheel" ]; then
        version=$(basename "$wheel" | cut -d- -f2)
        source="wheel $(sha256sum < "$wheel" | cut -d' ' -f1)"
    else
        version=$(sed -n 's/^__version__ = "\(.*\)"$/\1/p' "$from/gateway/__init__.py")
        source="checkout $(digest_of_checkout)"
    fi
    say "version $version"
    say "source $source"
    say "packages $(sha256sum < "$from/deploy/requirements.txt" | cut -d' ' -f1)"
    say "kind $kind"
    say "python $(real_python) $("$python" -c 'import platform; print(platform.python_version())')"
}

digest_of_checkout() {
    (
        cd "$from"
        local part parts=()
        for part in gateway deploy systemd tools pyproject.toml; do
            [ ! -e $part ] || parts+=("$part")
        done
        find "${parts[@]}" -type f ! -path '*/__pycache__/*' ! -name '*.so' -print0 | LC_ALL=C sort -z \
            | xargs -0 sha256sum | sha256sum | cut -d' ' -f1
    )
}

# Makes the link stand for another release; at any moment it stands for one or the other.
point() {
    local link=$1 release=$2
    ln -sfn "$release" "$root$link.new"
    mv -T "$root$link.new" "$root$link"
}

# shellcheck source=deploy/install_system.sh
. "$here/deploy/install_system.sh"

# A release that something still runs from stays, and so do the one that is installed and the one before.
remove_old_releases() {
    local path
    for path in "$root$RELEASES"/*/; do
        path=${path%/}
        case "${path##*/}" in
            "$(basename "$(release_of $CURRENT)")" | "$(basename "$(release_of $PREVIOUS)")") continue ;;
        esac
        is_in_use "${path#"$root"}" || rm -rf "$path"
    done
}

do_install() {
    must_be_root
    must_not_be_packaged
    [ -x "$from/deploy/environment.sh" ] || die "--from: $from is no checkout of $NAME (no deploy/environment.sh)"
    [ -z "$wheel" ] || [ -f "$wheel" ] || die "--wheel: there is no file $wheel"
    find_python
    local wanted now before release
    kind=$(environment --kind) || exit 1
    wanted=$(wanted_origin)
    now=$(origin $CURRENT)
    before=$(release_of $CURRENT)
    if [ "$wanted" = "$now" ]; then
        say "release $(version_of $CURRENT) is installed already: nothing to do"
        release=$before
    else
        release=$NAME.releases/$(printf '%s\n' "$wanted" | sed -n 's/^version //p')-$(date -u +%Y%m%dT%H%M%S)
        [ -n "$is_dry" ] || make_release "$release" "$wanted"
    fi
    if [ -n "$is_dry" ]; then
        [ "$wanted" = "$now" ] || say "would make /opt/$release and let $CURRENT lead to it"
        [ -z "$before" ] || [ "$wanted" = "$now" ] || say "would let $PREVIOUS lead to /opt/$before"
        say "would put units, udev rules, man pages and completions below /usr/local where they differ"
        say "would not touch $ETC and $STATE"
        return
    fi
    put_system_files "$release" "$before"
    if [ "$release" != "$before" ]; then
        [ -z "$before" ] || point $PREVIOUS "$before"
        point $CURRENT "$release"
        say "installed: $NAME $(version_of $CURRENT) in $CURRENT"
        [ -z "$before" ] || say "$(version_of $PREVIOUS) before it is kept: install.sh rollback goes back to it"
    fi
    prepare_system
    remove_old_releases
    enable_units
    say_what_runs
    [ -e "$root$ETC/gateway.toml" ] || say "there is no $ETC/gateway.toml yet: sudo $NAME init $ETC/gateway.toml"
}

environment() {
    case $kind in compiled | pure) set -- "--$kind" "$@" ;; esac
    "$from/deploy/environment.sh" --python "$python" ${wheel:+--wheel "$wheel"} "$@"
}

# Nothing leads to it before it is whole; what went wrong leaves no trace.
make_release() {
    local release=$1 wanted=$2
    folder="$root/opt/$release"
    mkdir -p "$root/opt"
    mkdir -p "$root$RELEASES"
    # $folder is no local one for this.
    trap 'rm -rf "$folder"; rmdir --ignore-fail-on-non-empty "$root$RELEASES"; say "install.sh: nothing was changed" >&2' EXIT
    environment --at "/opt/$release" "${links[@]}" "$folder" || exit 1
    printf '%s\n' "$wanted" > "$folder/share/$NAME/origin"
    "$folder/bin/python3" "$folder/bin/$NAME" --version >/dev/null || die "the new release does not start"
    sync -f "$folder" # a machine is switched off as soon as this says that it is done
    trap - EXIT
}

do_rollback() {
    must_be_root
    must_not_be_packaged
    local release before
    release=$(release_of $PREVIOUS)
    before=$(release_of $CURRENT)
    [ -d "$root/opt/${release:-none}" ] || die "there is no release before this one to go back to"
    if [ -n "$is_dry" ]; then
        say "would let $CURRENT lead to /opt/$release, and $PREVIOUS to /opt/$before"
        return
    fi
    put_system_files "$release" "$before"
    point $CURRENT "$release"
    point $PREVIOUS "$before"
    prepare_system
    say "installed: $NAME $(version_of $CURRENT), as before; rollback again comes back to $(version_of $PREVIOUS)"
    say "what the other release compiled is compiled anew at the start; docs/upgrade.md says what is kept"
    say_what_runs
}

do_uninstall() {
    must_be_root
    must_not_be_packaged
    if [ -z "$(release_of $CURRENT)" ] && [ ! -d "$root$RELEASES" ]; then
        say "it is not installed"
    else
        if [ -n "$is_dry" ]; then
            say "would stop the services and remove $CURRENT, units, udev rules, man pages and completions"
            return
        fi
        disable_units
        local release to
        for release in "$root$RELEASES"/*/; do
            release=${release%/}
            while read -r _ to; do rm -f "$root$to"; done < <(system_files "$NAME.releases/${release##*/}")
        done
        rm -f "$root$CURRENT" "$root$PREVIOUS" "$root$COMMAND_LINK"
        rm -rf "$root$RELEASES"
        remove_empty_folders
        ! is_systemd_running || systemctl daemon-reload
        say "removed: the program, its units, udev rules, man pages and completions"
    fi
    if [ -n "$is_purge" ]; then
        purge
    else
        say_what_stays
    fi
}

say_what_stays() {
    local path
    for path in "$ETC" "$STATE" "${DROP_INS[@]}"; do
        [ ! -e "$root$path" ] || say "left: $path"
    done
    ! grep -q "^$NAME:" "$root/etc/passwd" || say "left: the user $NAME, to whom the files belong"
}

purge() {
    local answer=''
    if [ -z "$is_yes" ]; then
        say "This removes $ETC with the configuration, the measured tables and the secrets, $STATE,"
        say "and what was added to the units: ${DROP_INS[*]}."
        read -r -p "Type 'remove' to do it: " answer || true
        [ "$answer" = remove ] || die "nothing more was removed"
    fi
    [ -z "$is_dry" ] || { say "would remove $ETC, $STATE, ${DROP_INS[*]} and the user $NAME"; return; }
    rm -rf "$root$ETC" "$root$STATE" "${DROP_INS[@]/#/$root}"
    ! is_systemd_running || systemctl daemon-reload
    ! grep -q "^$NAME:" "$root/etc/passwd" || userdel ${root:+--root "$root"} $NAME
    say "removed: $ETC, $STATE, ${DROP_INS[*]}, the user $NAME"
}

do_status() {
    local unit
    if [ -z "$(release_of $CURRENT)" ]; then
        say "not installed by install.sh"
    else
        say "installed: $(version_of $CURRENT) (/opt/$(release_of $CURRENT))"
        [ -z "$(release_of $PREVIOUS)" ] || say "before it: $(version_of $PREVIOUS) (/opt/$(release_of $PREVIOUS))"
    fi
    if is_systemd_running; then
        for unit in "${UNITS[@]}"; do
            say "$unit: $(systemctl is-enabled "$unit" 2>&1), $(systemctl is-active "$unit" 2>&1)"
        done
    fi
    say_what_stays | sed 's/^left: /there is: /'
}

case $command in
    install | uninstall | rollback | status) ;;
    '') usage >&2; exit 2 ;;
    *) die "no such command: $command; see --help" ;;
esac
if [ -z "$is_dry" ] && [ "$command" != status ] && { [ -n "$root" ] || [ "$(id -u)" = 0 ]; }; then
    mkdir -p "$root/opt"
    exec 9< "$root/opt"
    flock -n 9 || die "another install.sh is at work"
fi
"do_$command"
