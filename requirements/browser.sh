#!/bin/sh
# Sees to it that Chromium is there, for `make browser-test`: Debian's package, installed where it is missing and this is root.
#
# CHROMIUM=path names another one. Every failure says how to fix it, and exits 1.
set -eu

chromium=${CHROMIUM:-/usr/bin/chromium}

fail() {
    printf '\ngamekeeper set-up: %s\n  fix: %s\n' "$1" "$2" >&2
    exit 1
}

[ ! -x "$chromium" ] || exit 0
[ -z "${CHROMIUM:-}" ] || fail "CHROMIUM=$CHROMIUM is no program" "give the path of a Chromium or Chrome"
command -v apt-get >/dev/null || fail "Chromium is not at $chromium, and this system has no apt-get" \
    "install Chromium, then: make browser-test CHROMIUM=/path/to/chromium"
[ "$(id -u)" = 0 ] || fail "Chromium is not at $chromium" "apt-get install chromium as root, or name one: make browser-test CHROMIUM=/path/to/chromium"

echo "gamekeeper set-up: installing Debian's Chromium (about 450 MB with what it needs)"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
install_it() { DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends chromium fonts-dejavu-core >"$log" 2>&1; }
# The list of packages may be missing or old: it is asked for only when the first try fails.
install_it || { apt-get update >"$log" 2>&1 && install_it; } || {
    tail -n 15 "$log" >&2
    fail "apt-get could not install Chromium" "see what it said above; without a network, install the package chromium by hand"
}
[ -x "$chromium" ] || fail "Debian's Chromium is installed, yet not at $chromium" "name it: make browser-test CHROMIUM=/path/to/chromium"
