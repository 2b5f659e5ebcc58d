#!/bin/bash
# Exit codes and messages of acmp_evaluate and acmp_make_scene. Usage: evaluate_cli_test.sh FOLDER_OF_THE_PROGRAMS
set -u
# shellcheck source=test/tools/expect.sh
source "$(dirname "$0")/expect.sh"

small=(--width 48 --height 36 --keyframes 3 --spacing 0.1)
expect 0 "Makes a test scene" "$bin/acmp_make_scene" --help
expect 0 "3 images of 48 x 36" "$bin/acmp_make_scene" a "${small[@]}"
expect 0 "3 images of 48 x 36" "$bin/acmp_make_scene" b "${small[@]}"
diff -r a b >/dev/null || fail "two runs differ"
expect 2 "not an empty folder" "$bin/acmp_make_scene" a "${small[@]}"
expect 0 "3 images" "$bin/acmp_make_scene" a "${small[@]}" --overwrite
expect 0 "3 images of 48 x 36" "$bin/acmp_make_scene" hard "${small[@]}" --scene hard
cmp -s a/depth/000001.png hard/depth/000001.png && fail "--scene hard is the room"
expect 2 'scene = "kitchen": must be one of room, hard' "$bin/acmp_make_scene" c --scene kitchen
expect 2 "keyframes = 1" "$bin/acmp_make_scene" c --keyframes 1
expect 2 "required" "$bin/acmp_make_scene"
expect 2 "cannot create folder" "$bin/acmp_make_scene" a/cameras.txt/below "${small[@]}"

expect 0 "Usage: acmp_evaluate" "$bin/acmp_evaluate" --help
expect 0 "counts as wrong" "$bin/acmp_evaluate" depth --help
expect 0 "ETH3D" "$bin/acmp_evaluate" cloud --help
expect 2 "required" "$bin/acmp_evaluate"
expect 2 "no such folder" "$bin/acmp_evaluate" depth a missing
expect 2 "cameras.txt" "$bin/acmp_evaluate" depth a/depth a/depth
expect 2 "image list" "$bin/acmp_evaluate" depth a a/depth --subset x
expect 0 "low_texture (mean)" "$bin/acmp_evaluate" depth a b/depth --mask low_texture --json out.json
grep -q '"pool"' out.json || fail "out.json"
expect 2 "there is no folder" "$bin/acmp_evaluate" depth a b/depth --json missing/out.json
mkdir truncated && head -c 300 a/depth/000000.png >truncated/000000.png
expect 2 "000000.png" "$bin/acmp_evaluate" depth a truncated

expect 0 "100.00" "$bin/acmp_evaluate" cloud a/surface.ply b/surface.ply --thresholds 0.02,0.05 --voxel 0.1
expect 2 "--thresholds = -1" "$bin/acmp_evaluate" cloud a/surface.ply b/surface.ply --thresholds -1
expect 0 "true points from 3 depth maps" "$bin/acmp_evaluate" cloud b/surface.ply a --max-depth 9 --json cloud.json
grep -q '"true_maps": 3' cloud.json || fail "cloud.json"
expect 2 "--max-depth = 9: needs a folder" "$bin/acmp_evaluate" cloud b/surface.ply a/surface.ply --max-depth 9
expect 2 "missing.ply" "$bin/acmp_evaluate" cloud missing.ply b/surface.ply

printf 'ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 1\n1 0 1\n' >two.ply
# What it prints is its result: where that does not get out, it has failed.
for tool in "$bin/acmp_evaluate cloud two.ply two.ply" "$bin/acmp_evaluate depth a a/depth"; do
  $tool >/dev/null 2>&1 || fail "$tool"
  for output in '>/dev/full' '>&-'; do
    message=$(eval "$tool 2>&1 $output") && fail "$tool $output: exit code 0"
    message=$(eval "($tool $output) 2>&1")
    grep -q "cannot write to the standard output" <<<"$message" ||
      fail "$tool $output says $message"
  done
done
exit $((failures > 0))
