#!/bin/bash
# The main job, on Debian 11 to 13 with nothing installed: installs packages, builds, renders the synthetic room into a bag,
# plays it through the nodelet by roslaunch, and leaves the map and its mesh (PLY), a picture of the mesh, depth maps and
# pictures of them in demo_output/. Prints how the depth compares with the ground truth. Shows rviz if there is a display.
# Environment: ACMP_BUILD_DIR (build; test.sh goes on in it), ACMP_CUDA (AUTO, ON or OFF), DEVICE (auto, cuda or cpu).
set -euo pipefail
cd "$(dirname "$0")/.."
# shellcheck source=scripts/build_steps.sh
source scripts/build_steps.sh
out=$PWD/demo_output
show=false
[ -n "${DISPLAY:-}" ] && show=true
export PYENV_VERSION=system

record=.made_by_demo # is in what a demo has made: nothing else is removed
if [ -L "$out" ] || { [ -e "$out" ] && [ ! -f "$out/$record" ] && [ -n "$(ls -A "$out")" ]; }; then
  echo "$out: has no $record, so no demo has made it: move it away" >&2
  exit 1
fi

step "packages"
if $show; then scripts/install_dependencies.sh --display; else scripts/install_dependencies.sh; fi

step "build"
configure
programs=(acmp_mapping_nodelets dense_mapper_node map_server_node acmp_mapping_generate_messages_py acmp_make_bag acmp_check_bag
          acmp_evaluate acmp_reconstruct)
if ! cmake --build "$build" --parallel "$(nproc)" --target "${programs[@]}"; then
  echo "the build failed; once more with warnings that are no errors, as this compiler may have others than tested ones" >&2
  configure -DACMP_WARNINGS_AS_ERRORS=OFF
  cmake --build "$build" --parallel "$(nproc)" --target "${programs[@]}"
fi
# shellcheck source=scripts/ros_environment.sh
source scripts/ros_environment.sh "$build"
bin=$build/devel/lib/acmp_mapping

step "recording the synthetic room"
rm -rf "$out"
mkdir -p "$out"
touch "$out/$record"
# Preset online at this size takes as long as balanced at 240x180; maps and mesh show more.
"$bin/acmp_make_bag" --synthetic "$out/room.bag" --width 320 --height 240 --ground-truth "$out/ground_truth"
"$bin/acmp_check_bag" "$out/room.bag"

step "mapping"
scripts/save_demo_output.py "$out/room.bag" "$out" --timeout 1200 rviz:=$show z_up:=true preset:=online device:="${DEVICE:-}"

step "against the ground truth"
echo "-- low-latency maps (before the geometric passes)"
"$bin/acmp_evaluate" depth "$out/ground_truth" "$out/depth_fast" --mask low_texture --lowtex 0 --quiet
echo "-- refined maps"
"$bin/acmp_evaluate" depth "$out/ground_truth" "$out/depth" --mask low_texture --lowtex 0 --quiet
echo "-- fused map"
"$bin/acmp_evaluate" cloud "$out/map.ply" "$out/ground_truth/surface.ply"
if [ -f "$out/mesh.ply" ]; then
  step "a picture of the mesh"
  scripts/draw_mesh.py "$out/mesh.ply" "$out/mesh.png"
fi
step
echo "pictures in $out/pictures, depth in $out/depth, the map in $out/map.ply"
