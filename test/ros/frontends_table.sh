#!/bin/bash
# Prints the table of presets from the rows that their tests wrote. Fails when one is missing.
# Usage: frontends_table.sh RESULTS_FOLDER NAME...
set -euo pipefail
results=$1
shift
echo "| played as | keyframes | pixels of depth that differ from the plain topics' | worst relative difference |"
echo "|---|---|---|---|"
missing=()
for name in "$@"; do
  if [ -f "$results/$name.md" ]; then cat "$results/$name.md"; else missing+=("$name"); fi
done
if [ ${#missing[@]} -gt 0 ]; then
  echo "no result of: ${missing[*]}; run: ctest -R frontends" >&2
  exit 1
fi
