#!/bin/bash
# acmp_benchmark: a row for each preset, size and number of source views, of stages or of a stream. Usage: benchmark_cli_test.sh
# FOLDER_OF_THE_PROGRAMS
set -euo pipefail
cd "$(mktemp -d)"
trap 'rm -rf "$PWD"' EXIT
"$1/acmp_benchmark" --device cpu --preset acmp,online --sizes 64x48,32x24 --source-views 1 --repetitions 1 >stages
cat stages
[ "$(grep -cE "^(acmp|online) +(64x48|32x24) +1 +[0-9]" stages)" = 4 ]
"$1/acmp_benchmark" --device cpu --sizes 64x48 --source-views 1,2 --keyframes 4 >stream
cat stream
awk '/^balanced/ {rows++; if (!($4 > 0)) exit 1} END {exit rows != 2}' stream # keyframes per second
if "$1/acmp_benchmark" --device cpu --preset fast 2>wrong; then echo "there is no such preset"; exit 1; fi
grep -q "fast" wrong
