#!/bin/sh
# Makes sure that commands are there: `need.sh mosquitto=mosquitto gcc=gcc`, each command=debian-package.
# As root on Debian the missing packages are installed; elsewhere all that is missing is named at once, and nothing else
# happens.
set -eu
PATH="$PATH:/usr/sbin"
NODE_WANTED="20.19"
missing=""
trouble=""
wants_node=""

is_there() { command -v "$1" >/dev/null 2>&1; }
can_install() { [ "$(id -u)" = 0 ] && is_there apt-get; }
# Whether version $1 is at least $2; only the first two numbers count.
is_at_least() {
    echo "$1" | awk -F. -v wanted="$2" '{ split(wanted, w, "."); exit !($1 > w[1] + 0 || $1 == w[1] && $2 + 0 >= w[2] + 0) }'
}
say() {
    trouble="$trouble$1
"
}
say_node() {
    wants_node="yes"
    say "node $NODE_WANTED or newer is needed, $1
hint: https://github.com/nodesource/distributions, or nvm install 22"
}
# Debian's own node may be too old: nothing is installed that would be refused afterwards.
need_node() {
    if is_there node; then
        here="$(node --version)"
        is_at_least "${here#v}" "$NODE_WANTED" || say_node "${here#v} is here"
    elif is_there apt-cache; then
        can_install && apt-get update -qq
        offered="$(apt-cache policy nodejs | sed -n 's/^ *Candidate: *\([0-9]*:\)\{0,1\}\([0-9.]*\).*/\2/p')"
        if [ -n "$offered" ] && is_at_least "$offered" "$NODE_WANTED"; then
            missing="$missing $1"
        else
            say_node "none is here and this system's package is ${offered:-not there}"
        fi
    else
        say_node "none is here"
    fi
}

for pair in "$@"; do
    package="${pair#*=}"
    case "${pair%%=*}" in
    venv)
        if ! is_there python3; then
            missing="$missing python3 $package"
        elif ! python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
            say "python 3.11 or newer is needed, $(python3 --version) is here"
        elif ! python3 -c 'import ensurepip, venv' 2>/dev/null; then
            missing="$missing $package"
        fi
        ;;
    libc)
        # Without gcc nobody can tell; Debian's gcc comes without it.
        is_there gcc && echo '#include <stdio.h>' | gcc -E - >/dev/null 2>&1 || missing="$missing $package"
        ;;
    headers)
        python3 -c 'import os, sysconfig as s; os.stat(s.get_path("include") + "/Python.h")' 2>/dev/null ||
            missing="$missing $package"
        ;;
    node) need_node "$package" ;;
    npm)
        # It comes with every node but Debian's: not to be asked for beside a node that has to come from elsewhere.
        is_there npm || [ -n "$wants_node" ] || missing="$missing $package"
        ;;
    browser)
        # Any chromium will do for the tests; the shell without windows takes half of the processor time.
        is_there chromium-headless-shell || { is_there chromium && ! can_install; } || missing="$missing $package"
        ;;
    fuzzer)
        # Debian's clang comes without what its sanitizers and its fuzzer link.
        is_there clang && [ -e "$(clang --print-file-name="libclang_rt.fuzzer-$(uname -m).a")" ] || missing="$missing $package"
        ;;
    *) is_there "${pair%%=*}" || missing="$missing $package" ;;
    esac
done
if [ -n "$missing" ] && ! can_install; then
    say "missing:$missing
hint: sudo apt-get install$missing"
fi
if [ -n "$trouble" ]; then
    printf '%s' "$trouble" >&2
    exit 1
fi
if [ -n "$missing" ]; then
    echo "installing:$missing"
    export DEBIAN_FRONTEND=noninteractive
    apt-get update -qq
    # shellcheck disable=SC2086  # one word a package
    apt-get install -y -qq --no-install-recommends $missing >/dev/null
fi
