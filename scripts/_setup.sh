# Sourced by scripts/demo and scripts/test: a virtual environment in the project, with pinned versions.
# Needs Python 3.11 or newer; PYTHON names another one than python3.

set -eu
cd "$(dirname "$0")/.."
python=${PYTHON:-python3}
if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
    echo "runningfix needs Python 3.11 or newer; '$python' is $("$python" --version 2>&1 || echo missing). Try: PYTHON=python3.12 $0" >&2
    exit 2
fi
venv=${RUNNINGFIX_VENV:-.venv}
stamp=$venv/.runningfix-$1
if [ ! -x "$venv/bin/python" ]; then
    "$python" -m venv "$venv"
fi
if [ ! -f "$stamp" ] || [ pyproject.toml -nt "$stamp" ] || [ scripts/constraints.txt -nt "$stamp" ]; then
    echo "setting up $venv (once)" >&2
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --constraint scripts/constraints.txt --editable ".[$1]"
    touch "$stamp"
fi
