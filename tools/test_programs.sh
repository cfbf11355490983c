#!/usr/bin/env bash
# Programs that the tests run for real: systemd's own tools, an MQTT broker, a browser, what makes certificates,
# promtool, what reads scripts, man pages and captures, shells to complete in, a C compiler and the headers of Python;
# for root also what makes a bare Debian, which only root can enter.
# As root on Debian they are installed where they are missing; anywhere else it is said what is missing.
set -euo pipefail

PATH="$PATH:/usr/sbin:/sbin"
missing=()
pairs=(cc:build-essential systemd-analyze:systemd mosquitto:mosquitto chromium:chromium openssl:openssl
    promtool:prometheus shellcheck:shellcheck mandoc:mandoc zsh:zsh fish:fish tshark:tshark)
[ "$(id -u)" != 0 ] || pairs+=(mmdebstrap:mmdebstrap lintian:lintian)
for pair in "${pairs[@]}"; do
    command -v "${pair%%:*}" >/dev/null || missing+=("${pair##*:}")
done
# Of the Python that runs the tests: one that somebody built has its headers with it.
header='import os, sysconfig; print(os.path.exists(sysconfig.get_path("include") + "/Python.h"))'
[ "$("${VENV:-.venv}/bin/python" -c "$header" 2>/dev/null)" != False ] || missing+=(python3-dev)
[ "${#missing[@]}" = 0 ] && exit 0

if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "installing for the tests: ${missing[*]} ..." >&2
    # None of them is to run as a service: each test starts its own.
    if [ -d /run/systemd/system ] && command -v systemctl >/dev/null \
        && systemctl mask --runtime mosquitto.service prometheus.service >/dev/null 2>&1; then
        trap 'systemctl unmask --runtime mosquitto.service prometheus.service >/dev/null 2>&1' EXIT
    fi
    "${0%/*}/debian_packages.sh" "${missing[@]}"
else
    echo "missing for the tests: ${missing[*]} (as root: apt-get install ${missing[*]})" >&2
    exit 1
fi
