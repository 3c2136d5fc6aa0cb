#!/bin/sh
# Makes sure that commands are there: `need.sh mosquitto=mosquitto chromium=chromium`, each command=debian-package.
# As root on Debian the missing packages are installed; elsewhere they are named, and nothing else happens.
set -eu
PATH="$PATH:/usr/sbin"
missing=""
for pair in "$@"; do
    command="${pair%%=*}"
    package="${pair#*=}"
    case "$command" in
    venv) python3 -c 'import ensurepip, venv' 2>/dev/null || missing="$missing $package" ;;
    *) command -v "$command" >/dev/null 2>&1 || missing="$missing $package" ;;
    esac
done
if [ -n "$missing" ]; then
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
        echo "installing:$missing"
        export DEBIAN_FRONTEND=noninteractive
        apt-get update -qq
        # shellcheck disable=SC2086  # one word a package
        apt-get install -y -qq --no-install-recommends $missing >/dev/null
    else
        echo "missing:$missing" >&2
        echo "hint: sudo apt-get install$missing" >&2
        exit 1
    fi
fi
python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
    echo "python 3.11 or newer is needed, $(python3 --version) is here" >&2
    exit 1
}
case " $* " in *" node="*)
    node -e 'process.exit(Number(process.versions.node.split(".")[0]) < 20 ? 1 : 0)' || {
        echo "node 20 or newer is needed, $(node --version) is here" >&2
        exit 1
    }
    ;;
esac
