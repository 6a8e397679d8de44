#!/usr/bin/env bash
# Print the versions that pip chooses today for what pyproject.toml asks for, tests and linters included.
# Usage: envs/pins.sh [python]
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${1:-python3}" -m venv "$folder"
torch=$(sed -n 's/.*"\(torch==[0-9.]*\)".*/\1/p' pyproject.toml)
"$folder/bin/python" -m pip install --quiet "$torch" >&2
"$folder/bin/python" -m pip install --quiet ".[test,lint]" >&2
echo "# The tested versions, for Python 3.11 and newer; 'make pins' wrote this file."
"$folder/bin/python" -m pip freeze --exclude cospeech | sed 's/+cpu$//'
