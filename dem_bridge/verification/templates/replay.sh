#!/bin/sh
# Install the versions of requirements.txt in an environment, verify again and compare verdict by verdict.
set -eu
cd "$(dirname "$0")"
[ -x venv/bin/python ] || "${PYTHON:-python3}" -m venv venv
venv/bin/python -m pip install --quiet --disable-pip-version-check -r requirements.txt
exec venv/bin/python replay.py "$@"
