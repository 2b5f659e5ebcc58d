#!/bin/bash
# What scripts/demo.sh does after the build, with a small bag.
# Usage: demo_test.sh SOURCE_FOLDER BUILD_FOLDER ACMP_MAKE_BAG
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$1"
# shellcheck source=scripts/ros_environment.sh
source scripts/ros_environment.sh "$2"
"$3" --synthetic "$folder/room.bag" --width 64 --height 48
scripts/save_demo_output.py "$folder/room.bag" "$folder" --timeout 500 rviz:=false device:=cpu | tee "$folder/saved"
grep -q "^14 images played; received: .*14 depth" "$folder/saved"
grep -q "latency of refined depth maps \[ms\] median" "$folder/saved"
test -s "$folder/map.ply"
test "$(find "$folder/depth" -name '*.pfm' | wc -l)" -eq 14
grep -q "^map: .* points of 14 keyframes in " "$folder/saved"
scripts/draw_mesh.py "$folder/mesh.ply" "$folder/mesh.png" --size 64 | grep "^mesh: [1-9][0-9]* triangles"
test -s "$folder/mesh.png"
# A launch that cannot go on is told at once, with its log.
if scripts/save_demo_output.py "$folder/room.bag" "$folder" --timeout 500 rviz:=false device:=none 2>"$folder/wrong"; then
  echo "device:=none is taken"
  exit 1
fi
grep -q "roslaunch has ended" "$folder/wrong"
grep -q "device = " "$folder/wrong"
