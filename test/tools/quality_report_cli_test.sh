#!/bin/bash
# What scripts/quality_report.sh keeps of a run. Usage: quality_report_cli_test.sh FOLDER_OF_THE_PROGRAMS SOURCE_FOLDER
set -u
PATH=$(realpath "${1:?folder of the programs}"):$PATH
script=$(realpath "${2:?source folder}")/scripts/quality_report.sh
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work" || exit 1
export DEVICE=cpu EXAMPLES=2 RECONSTRUCT_OPTIONS="--images 0-2 --set geometric_passes=1"
failures=0
fail() {
  echo "FAILED: $*"
  failures=$((failures + 1))
}

"$script" run >/dev/null 2>&1
[ $? -eq 2 ] || fail "no arguments"
"$script" run missing results >/dev/null 2>&1
[ $? -eq 2 ] || fail "no such folder"

acmp_make_scene scenes/room --width 48 --height 36 --keyframes 4 --spacing 0.5 >/dev/null
mkdir -p scenes/no_truth/images
"$script" run scenes results online acmh >log 2>&1 || fail "run: $(cat log)"
grep -q "no_truth: neither depth/ nor gt_sparse/" log || fail "no_truth: $(cat log)"
for preset in online acmh; do
  files=$(cd "results/room/$preset" && find . -type f | sort | tr '\n' ' ')
  expected="./cloud.json ./depth.json ./maps/000000_confidence.png ./maps/000000_depth.png"
  expected+=" ./maps/000002_confidence.png ./maps/000002_depth.png ./summary.json "
  [ "$files" = "$expected" ] || fail "$preset: $files"
done
# The kept maps are those that were measured, but for rounding to millimetres: figures (< 2 cm) of image 0 agree.
share_of_image_0() {
  python3 -c 'import json, sys; print(json.load(open(sys.argv[1]))["images"][0]["figures"][0])' "$1"
}
rm results/room/acmh/maps/*_confidence.png
acmp_evaluate depth scenes/room results/room/acmh/maps --json kept.json >/dev/null || fail "kept maps"
echo "$(share_of_image_0 kept.json) $(share_of_image_0 results/room/acmh/depth.json)" |
  awk '{exit !($1 > 0 && $1 - $2 < 1 && $2 - $1 < 1)}' || fail "kept: $(cat kept.json results/room/acmh/depth.json)"
"$script" run scenes results online >log 2>&1
grep -q "measured before" log || fail "again: $(cat log)"
"$script" run scenes results no_such_preset >log 2>&1 && fail "no_such_preset"
grep -q "no_such_preset: failed" log || fail "no_such_preset: $(cat log)"
exit $((failures > 0))
