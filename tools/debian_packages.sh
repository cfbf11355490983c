#!/usr/bin/env bash
# Installs Debian packages, as root, and says nothing where that goes well. While another program has a package lock, it
# says so once and waits, ten minutes at most or as many seconds as PATIENCE_S says: of the locks apt-get itself waits for
# none.
set -euo pipefail
export LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive
patience_s=${PATIENCE_S:-600}

is_locked() { [[ $1 == *"Could not get lock"* || $1 == *"was locked by another process"* ]]; }

patiently() {
    local said since=
    until said=$(apt-get -qq "$@" 2>&1); do
        if ! is_locked "$said"; then
            printf 'apt-get %s failed:\n%s\n' "$1" "$said" >&2
            exit 1
        elif [ -z "$since" ]; then
            echo "waiting, at most $patience_s s: $(grep -m 1 lock <<<"$said")" >&2
            since=$SECONDS
        elif [ $((SECONDS - since)) -ge "$patience_s" ]; then
            echo "apt-get $1 failed, after $patience_s s: $(grep -m 1 lock <<<"$said")" >&2
            echo "let that program finish, then start this again; PATIENCE_S=3600 waits for an hour" >&2
            exit 1
        fi
        sleep 1
    done
}

patiently update
patiently install -y --no-install-recommends "$@"
