#!/usr/bin/env bash
# Builds the Debian package for the Debian that runs it, into dist/ (make deb); COMPILED=0: without compiling.
# `make release` runs it in a bare Debian of each release that there is a package for.
#
# debhelper makes the package, and deploy/environment.sh what is in it. dh-virtualenv, which would do both, has had no
# release since Python 3.11 came out.
set -euo pipefail
cd "$(dirname "$0")/.."
umask 022

PATH="$PATH:/usr/sbin:/sbin"
needed=(build-essential debhelper fakeroot python3-venv)
[ "${COMPILED:=1}" = 0 ] || needed+=(python3-dev)
export COMPILED
missing=()
for package in "${needed[@]}"; do
    [ "$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null || true)" = installed ] || missing+=("$package")
done
if [ "${#missing[@]}" != 0 ]; then
    if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
        echo "missing to build the package: ${missing[*]} (as root: apt-get install ${missing[*]})" >&2
        exit 1
    fi
    echo "installing to build the package: ${missing[*]} ..." >&2
    apt-get update -qq
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
fi

# 1.0.0+deb12u1, as Debian names its own updates: a package is for one Debian, for it brings wheels for its Python, and
# that of the next Debian is newer. `~` would do the same, but hosts of files change it in names.
system=$(. /etc/os-release && echo "$ID${VERSION_ID:-}")
if [[ ! $system =~ [0-9]$ ]]; then
    echo "/etc/os-release does not say which release of $system this is: build on a stable one, or let make release" \
        "build for each" >&2
    exit 1
fi
release=$(sed -n 's/^__version__ = "\(.*\)"$/\1/p' gateway/__init__.py)
version=$release+${system/#debian/deb}u1
tree=build/deb/pitch-gateway-$release
rm -rf build/deb
mkdir -p "$tree" dist
for part in gateway deploy docs systemd tools pyproject.toml README.md LICENSE; do
    [ ! -e "$part" ] || cp -r "$part" "$tree/"
done
find "$tree" -name __pycache__ -prune -exec rm -rf {} +
mv "$tree/deploy/debian" "$tree/debian"

# The same sources make the same package: its date is that of the newest source.
newest=$(find "$tree" -type f -printf '%T@\n' | sort -n | tail -1)
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || echo "${newest%.*}")}
export SOURCE_DATE_EPOCH
{
    echo "pitch-gateway ($version) unstable; urgency=medium"
    echo
    echo "  * See the CHANGELOG of the project."
    echo
    echo " -- $(sed -n 's/^Maintainer: //p' "$tree/debian/control")  $(LC_ALL=C date -u -R -d "@$SOURCE_DATE_EPOCH")"
} > "$tree/debian/changelog"

(cd "$tree" && dpkg-buildpackage --build=binary --no-sign --unsigned-changes) > build/deb/log 2>&1 || {
    tail -40 build/deb/log >&2
    exit 1
}
cp build/deb/pitch-gateway_*.deb dist/
(cd build/deb && ls pitch-gateway_*.deb) | sed 's,^,dist/,'
