#!/bin/sh
# Runs benchmarks/first_steps.py, a minute's part of the tests, under every other Python of the lock files that is on this machine:
# on PATH, or in a folder of pyenv's or uv's. Each has an environment of its own, from the base lock; which ran is said in the last line.
#
#   pythons.sh VENV        VENV-3.12 and so on are made, and removed
set -eu

here=$("$1/bin/python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
ran="$here (all tests)"
none=""
failed=""

# Prints an interpreter of a version that can be run and make environments, or nothing.
interpreter() {
    for each in "python$1" "${HOME:-}/.pyenv/versions/$1".*/bin/python "${HOME:-}/.local/share/uv/python/cpython-$1".*/bin/python3; do
        if "$each" -c 'import sys, venv, ensurepip; sys.exit("%d.%d" % sys.version_info[:2] != sys.argv[1])' "$1" 2>/dev/null; then
            echo "$each"
            return
        fi
    done
}

for version in 3.11 3.12 3.13 3.14; do
    [ "$version" != "$here" ] || continue
    found=$(interpreter "$version")
    if [ -z "$found" ]; then
        none="$none $version"
        continue
    fi
    venv=$1-$version
    if PYTHON=$found requirements/setup.sh make "$venv" && requirements/setup.sh install "$venv" requirements/base.txt &&
        "$venv/bin/python" benchmarks/first_steps.py; then
        ran="$ran, $version"
    else
        failed="$failed $version"
    fi
    rm -rf "$venv"
done
echo "Pythons: $ran${none:+; not on this machine:$none}${failed:+; FAILED:$failed}"
[ -z "$failed" ]
