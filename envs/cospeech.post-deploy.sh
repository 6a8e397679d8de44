#!/usr/bin/env bash
# Snakemake runs this in a new conda environment, from the folder where it was started: the project's root.
set -eu
python -m pip install --requirement envs/requirements.txt --editable .
