#!/usr/bin/env bash
# Installs Debian packages, as root, and says nothing where that goes well. While another program has a package lock, it
# says so once and waits, ten minutes at most: of the locks apt-get itself waits for none.
set -euo pipefail
export LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive
patience_s=600

patiently() {
    local said is_told=
    until said=$(apt-get -qq "$@" 2>&1); do
        if [[ $said != *"Could not get lock"* && $said != *"was locked by another process"* ]] \
            || [ "$SECONDS" -ge "$patience_s" ]; then
            printf 'apt-get %s failed:\n%s\n' "$1" "$said" >&2
            exit 1
        fi
        [ -n "$is_told" ] || echo "waiting, at most $patience_s s: $(grep -m 1 lock <<<"$said")" >&2
        is_told=yes
        sleep 1
    done
}

patiently update
patiently install -y --no-install-recommends "$@"
