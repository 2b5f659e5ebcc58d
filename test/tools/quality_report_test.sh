#!/bin/bash
# Tables of what scripts/quality_report.py measures, each result once. Usage: quality_report_test.sh FOLDER_OF_THE_PROGRAMS SOURCE_FOLDER
set -euo pipefail
PATH=$(realpath "$1"):$PATH
script=$(realpath "$2")/scripts/quality_report.py
cd "$(mktemp -d)"
trap 'rm -rf "$PWD"' EXIT
options=(--device cpu --reconstruct-options "--images 0-2 --set geometric_passes=1")

acmp_make_scene scenes/room --width 48 --height 36 --keyframes 4 --spacing 0.5 >/dev/null
mkdir -p scenes/no_truth/images
"$script" scenes results online acmh "${options[@]}" >report 2>log
cat report
for table in "< 2 cm" "< 5 %" "cloud at 5 cm: f1" "whole run, ms per image"; do
  grep -A 3 -F "| $table | room | mean |" report | grep -Eq "^\| acmh \| [0-9]+\.[0-9] \|"
done
[ "$(grep -c "^-- room " log)" = 2 ]
"$script" scenes results online acmh "${options[@]}" 2>again | diff report -
[ ! -s again ]  # nothing was measured
if "$script" scenes results no_such_preset "${options[@]}" >report 2>log; then exit 1; fi
grep -q "room no_such_preset: .*acmp_reconstruct" log
if "$script" results results 2>log; then exit 1; fi
grep -q "no folder in it has depth/ or gt_sparse/" log
