#!/usr/bin/env bash
# Builds the Debian package into dist/ (make deb). With COMPILED=1 the hot path in it is machine code.
#
# debhelper makes the package, and deploy/environment.sh what is in it. dh-virtualenv, which would do both, has had no
# release since Python 3.11 came out.
set -euo pipefail
cd "$(dirname "$0")/.."

PATH="$PATH:/usr/sbin:/sbin"
missing=()
for package in debhelper dpkg-dev fakeroot python3-venv; do
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

version=$(sed -n 's/^__version__ = "\(.*\)"$/\1/p' gateway/__init__.py)
tree=build/deb/pitch-gateway-$version
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
rm -f dist/pitch-gateway_*.deb
cp build/deb/pitch-gateway_*.deb dist/
ls dist/pitch-gateway_*.deb
