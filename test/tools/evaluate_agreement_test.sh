#!/bin/bash
# Compares acmp_evaluate's table with that of the script that published figures were computed with, byte by byte. The
# script is not part of this package: without ACMP_EVAL_DEPTH_PY, its path, the test is skipped (exit code 77).
# ACMP_PYTHON names a python with numpy and OpenCV. Usage: evaluate_agreement_test.sh FOLDER_OF_THE_PROGRAMS
set -eu
bin=$(realpath "${1:?folder of the programs}")
if [ -z "${ACMP_EVAL_DEPTH_PY:-}" ]; then
  echo "skipped: ACMP_EVAL_DEPTH_PY does not name the script"
  exit 77
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Another seed sways the camera elsewhere: depth maps with errors of all sizes.
"$bin/acmp_make_scene" "$work/scene" --keyframes 4 --spacing 0.5
"$bin/acmp_make_scene" "$work/same_size" --keyframes 4 --seed 2 --spacing 0.5
"$bin/acmp_make_scene" "$work/smaller" --keyframes 4 --seed 3 --width 101 --height 77 --spacing 0.5
rm "$work/same_size/depth/000002.png"
for maps in same_size smaller; do
  for options in "" "--subset 0,2-3" "--scale 1.01 --lowtex 6" "--max-depth 3 --quiet"; do
    # shellcheck disable=SC2086  # options are separate words
    "${ACMP_PYTHON:-python3}" "$ACMP_EVAL_DEPTH_PY" "$work/scene" "$work/$maps/depth" $options >"$work/expected"
    # shellcheck disable=SC2086
    "$bin/acmp_evaluate" depth "$work/scene" "$work/$maps/depth" $options >"$work/found"
    diff "$work/expected" "$work/found"
  done
done
