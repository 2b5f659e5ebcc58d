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
# A folder demo_output that no demo has made stays, here where the scripts that demo.sh calls do nothing.
mkdir -p "$folder/package/scripts" "$folder/package/demo_output"
cp scripts/demo.sh "$folder/package/scripts"
echo 'step() { :; }; configure() { :; }; cmake() { :; }; build=build' >"$folder/package/scripts/build_steps.sh"
for script in install_dependencies.sh ros_environment.sh; do
  echo true >"$folder/package/scripts/$script"
  chmod +x "$folder/package/scripts/$script"
done
touch "$folder/package/demo_output/mine"
if "$folder/package/scripts/demo.sh" 2>"$folder/refused"; then
  echo "demo.sh is done without its programs"
  exit 1
fi
grep -q "$folder/package/demo_output: has no .made_by_demo" "$folder/refused"
test -e "$folder/package/demo_output/mine"
# One that a demo has made is made anew.
mv "$folder/package/demo_output/mine" "$folder/package/demo_output/.made_by_demo"
touch "$folder/package/demo_output/old"
"$folder/package/scripts/demo.sh" 2>/dev/null && exit 1
test ! -e "$folder/package/demo_output/old"
