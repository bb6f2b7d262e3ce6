# Sourced by the starters beside it: make .venv, install the project into it, and be quick when that is done already.
#
# The project is installed as a package and not in editable form, so that what runs and what is tested is what a wheel
# holds (the MJCF and the report's template too). A checksum over everything that goes into the wheel says when it has
# to be installed again.

root=$(CDPATH='' cd -- "$(dirname -- "$0")/.." && pwd)
venv=${QPAL_VENV:-$root/.venv}

say() { printf '%s\n' "$*" >&2; }

fail() { say "$*"; exit 2; }

fresh_enough='import sys; sys.exit(sys.version_info < (3, 11))'

# The first Python of at least 3.11 on the path, or a sentence.
find_python() {
    for name in python3 python3.14 python3.13 python3.12 python3.11 python; do
        if command -v "$name" >/dev/null 2>&1 && "$name" -c "$fresh_enough" >/dev/null 2>&1; then
            printf '%s\n' "$name"
            return
        fi
    done
    fail "No Python 3.11 or newer is on the path; install one from https://www.python.org, or install uv from https://docs.astral.sh/uv."
}

make_venv() {
    say "Making $venv"
    if command -v uv >/dev/null 2>&1; then
        uv venv --quiet --seed --clear --python '>=3.11' "$venv"
    else
        python=$(find_python) || exit 2
        "$python" -m venv --clear "$venv" ||
            fail "$python could not make a virtual environment; on Debian or Ubuntu: apt install python3-venv."
    fi
}

# install EXTRA, where EXTRA is empty or [test] or [docs]. Where the project itself is current, pip gets its name alone:
# the extra's packages come, and the project stays with the loops that were compiled for it.
install() {
    what="$root$1"
    [ "$(cat "$venv/qpal-installed" 2>/dev/null)" != "$wanted" ] || what="qpal$1"
    say "Installing qpal$1 into $venv (minutes when nothing is cached)"
    if command -v uv >/dev/null 2>&1; then
        uv pip install --quiet --python "$venv/bin/python" --reinstall-package qpal "qpal$1 @ file://$root"
    else
        "$venv/bin/python" -m pip install --quiet --disable-pip-version-check "$what"
    fi || fail "The installation failed; the lines above say why. Is the package index within reach?"
}

checksum() {
    (cd "$root" && find twin sysid model scripts/peers pyproject.toml -type f ! -name '*.py[co]' ! -name '*.nb[ic]' \
        -exec cksum {} + | LC_ALL=C sort | cksum)
}

# ensure EXTRA: afterwards $venv holds the project as it is now, with that extra.
ensure() {
    wanted="$root $(checksum)"
    stamp="$venv/qpal-installed$1"
    if [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$wanted" ] && "$venv/bin/python" -c "$fresh_enough" 2>/dev/null; then
        return
    fi
    if ! "$venv/bin/python" -c "$fresh_enough" 2>/dev/null ||
        { ! command -v uv >/dev/null 2>&1 && ! "$venv/bin/python" -m pip --version >/dev/null 2>&1; }; then
        make_venv
    fi
    install "$1"
    printf '%s\n' "$wanted" >"$stamp"
    printf '%s\n' "$wanted" >"$venv/qpal-installed"
}
