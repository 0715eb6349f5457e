#!/bin/sh
# Makes a virtual environment and fills it with locked packages; called by the Makefile, with no tool but Python.
#
#   setup.sh make VENV             an empty virtual environment, of the newest suitable Python
#   setup.sh install VENV LOCK     the packages of a lock file (.txt), each checked against its hash, and Gamekeeper itself
#   setup.sh install VENV LIST     the packages of a list (.in): versions of what is asked for, all else as pip resolves it today
#
# PYTHON=path chooses the interpreter. Every failure says what is missing and how to fix it, and exits 1.
set -eu

LOCKED_FOR="3.14 3.13 3.12 3.11"    # newest first: the versions that the lock files were resolved for

fail() {
    printf '\ngamekeeper set-up: %s\n  fix: %s\n' "$1" "$2" >&2
    exit 1
}

# Prints "3.12" for an interpreter, or nothing if it can't be run.
version_of() {
    "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null || true
}

# Prints the interpreter to use: $PYTHON if given, else the newest that the lock files were resolved for.
choose_python() {
    if [ -n "${PYTHON:-}" ]; then
        candidates=$PYTHON
    else
        candidates="$(printf 'python%s ' $LOCKED_FOR) python3 python"
    fi
    seen=""
    without_venv=""
    for candidate in $candidates; do
        version=$(version_of "$candidate")
        if [ -z "$version" ]; then
            [ -z "${PYTHON:-}" ] || seen=" $candidate can't be run;"
            continue
        fi
        case " $LOCKED_FOR " in
            *" $version "*) ;;
            *) seen="$seen $candidate is $version;"; continue ;;
        esac
        if "$candidate" -c 'import venv, ensurepip' 2>/dev/null; then
            echo "$candidate"
            return
        fi
        without_venv="${without_venv:-$version}"
    done
    [ -z "$without_venv" ] || fail "Python $without_venv is here, its venv module is not whole" \
        "install it (Debian, Ubuntu: apt-get install python$without_venv-venv), or name another Python: make PYTHON=/path/to/python3"
    fail "no suitable Python found (wanted: one of $LOCKED_FOR; seen:${seen:- none})" \
        "install Python 3.11 or newer, or name one: make PYTHON=/path/to/python3"
}

make_venv() {
    python=$(choose_python)
    echo "gamekeeper set-up: virtual environment in $1, Python $(version_of "$python") ($python)"
    "$python" -m venv --clear "$1" || fail "$python could not make a virtual environment in $1" \
        "see what it said above; is the folder writable, is there space on the disk?"
}

# Says what a failed pip most likely ran into, from what it printed.
explain_pip() {
    if grep -qE 'NewConnectionError|NameResolution|name resolution|ConnectTimeout|ReadTimeout|unreachable|ProxyError|SSLError|from versions: none' "$1"; then
        fail "the locked packages could not be fetched: no way to the package index" \
            "check the network, proxy and certificates. Without a network: where there is one, fetch them with
        'pip download --require-hashes -r requirements/test.txt -d wheels' (same Python, same kind of machine), bring the folder here,
        then run 'PIP_NO_INDEX=1 PIP_FIND_LINKS=\$PWD/wheels make test'"
    elif grep -q 'No space left' "$1"; then
        fail "the disk is full" "free some space (README says how much is needed), then run the same command again"
    elif grep -q 'DO NOT MATCH THE HASHES' "$1"; then
        fail "a fetched package is not the one that was locked" \
            "run 'pip cache purge' and try again; if it stays so, the package index or a proxy hands out other files: don't install them"
    fi
    fail "pip could not install the locked packages" "see what it said above; all of it is in $1"
}

# Runs pip in the environment, quietly; its output is shown when it fails.
pip_install() {
    venv=$1
    log=$1/pip.log
    shift
    if ! PIP_USER=0 PIP_DISABLE_PIP_VERSION_CHECK=1 "$venv/bin/python" -m pip install --quiet --retries 2 \
        "$@" >"$log" 2>&1; then
        tail -n 25 "$log" >&2
        explain_pip "$log"
    fi
}

install() {
    began=$(date +%s)
    case "$2" in
        *.in)
            echo "gamekeeper set-up: installing what $2 asks for into $1; the first time takes some minutes"
            pip_install "$1" --requirement "$2"
            ;;
        *)
            echo "gamekeeper set-up: installing $(grep -c '^[a-zA-Z]' "$2") locked packages ($2) into $1; the first time takes a minute or two"
            pip_install "$1" --no-build-isolation --require-hashes --requirement "$2"
            pip_install "$1" --no-build-isolation --no-deps --editable .
            ;;
    esac
    echo "gamekeeper set-up: done in $(($(date +%s) - began)) s, $(du -sm "$1" | cut -f1) MB in $1"
}

case "${1:-}" in
    make) make_venv "$2" ;;
    install) install "$2" "$3" ;;
    *) fail "unknown step '${1:-}'" "use: setup.sh make VENV | setup.sh install VENV LOCK" ;;
esac
