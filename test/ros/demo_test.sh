#!/bin/bash
# What scripts/demo.sh does after the build, with a small bag: demo.launch plays it, save_demo_output.py saves the maps.
# Usage: demo_test.sh SOURCE_FOLDER BUILD_FOLDER ACMP_MAKE_BAG
set -euo pipefail
# shellcheck source=test/ros/own_master.sh
source "$1/test/ros/own_master.sh"
"$3" --synthetic "$folder/room.bag" --width 64 --height 48
topics="/camera/image_raw /camera/camera_info /slam/pose /slam/sparse_points"
roslaunch --port "$port" acmp_mapping demo.launch bag:="$folder/room.bag" save_folder:="$folder" rviz:=false device:=cpu \
  play_args:="--wait-for-subscribers --quiet --topics $topics" >"$folder/roslaunch.log" 2>&1 </dev/null &
launch=$!
"$1/scripts/save_demo_output.py" "$folder/room.bag" "$folder" --timeout 500 >"$folder/saved" &
saver=$!
code=0
wait -n "$launch" "$saver" || code=$?
if kill -0 "$saver" 2>/dev/null || [ "$code" -ne 0 ]; then  # without roslaunch the saver would wait in vain
  kill "$saver" 2>/dev/null || true
  cat "$folder/saved" "$folder/roslaunch.log"
  exit 1
fi
cat "$folder/saved"
grep -q "^14 images played; received: .*14 depth" "$folder/saved"
grep -q "latency of refined depth maps \[ms\] median" "$folder/saved"
test -s "$folder/map.ply"
test "$(find "$folder/depth" -name '*.pfm' | wc -l)" -eq 14
grep -q "^map: .* points of 14 keyframes in " "$folder/saved"
"$1/scripts/draw_mesh.py" "$folder/mesh.ply" "$folder/mesh.png" --size 64 | grep "^mesh: [1-9][0-9]* triangles"
test -s "$folder/mesh.png"
