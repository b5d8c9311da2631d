# Sourced by scripts/demo and scripts/test, with $extras set: a virtual environment in the project, pinned versions.
# Needs Python 3.11 or newer; PYTHON names another one than python3, RUNNINGFIX_VENV another folder than .venv.

set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
python=${PYTHON:-python3}
if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
    echo "runningfix needs Python 3.11 or newer; '$python' is $("$python" --version 2>&1 || echo missing). Try: PYTHON=python3.12 $0" >&2
    exit 2
fi
venv=${RUNNINGFIX_VENV:-$root/.venv}
stamp=$venv/.runningfix-$extras
[ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
if [ ! -f "$stamp" ] || [ "$root/pyproject.toml" -nt "$stamp" ] || [ "$root/scripts/constraints.txt" -nt "$stamp" ]; then
    echo "setting up $venv (once)" >&2
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check \
        --constraint "$root/scripts/constraints.txt" --editable "$root[$extras]"
    touch "$stamp"
fi
