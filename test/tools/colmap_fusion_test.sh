#!/bin/bash
# Lets COLMAP itself fuse the workspaces that acmp_reconstruct --colmap writes, and compares its clouds with the exact
# surface. COLMAP's other tools and acmp_reconstruct read the model. Skipped (exit code 77) where there is
# no colmap. Usage: colmap_fusion_test.sh FOLDER_OF_THE_PROGRAMS
set -eu
bin=$(realpath "${1:?folder of the programs}")
if ! command -v colmap >/dev/null; then
  echo "skipped: there is no program colmap (Debian package colmap)"
  exit 77
fi
export QT_QPA_PLATFORM=offscreen  # also colmap's programs without a window may look for a display
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"

fail() {
  echo "FAILED: $*"
  exit 1
}

# check NAME MIN_POINTS SCENE OPTIONS...: reconstructs, fuses with COLMAP, looks at number and accuracy of the points.
check() {
  local name=$1 min_points=$2 scene=$3 table points accuracy
  shift 3
  "$bin/acmp_reconstruct" "$scene" "$name" --colmap --device cpu --no-pictures --quiet "$@"
  colmap stereo_fusion --workspace_path "$name/colmap" --output_path "$name/fused_by_colmap.ply" >"$name.log" 2>&1 ||
    fail "colmap stereo_fusion: $(tail -n 20 "$name.log")"
  if grep -iE "warning|ignoring" "$name.log"; then fail "colmap stereo_fusion warns"; fi
  table=$("$bin/acmp_evaluate" cloud "$name/fused_by_colmap.ply" room/surface.ply --thresholds 0.05)
  points=$(awk '/reconstructed points/ { print $1 }' <<<"$table")
  accuracy=$(awk '$1 == "0.05" { print $2 }' <<<"$table")
  echo "$name: $points points of COLMAP, $accuracy % of them within 5 cm"
  [ "$points" -ge "$min_points" ] || fail "$name: $points points, must be at least $min_points"
  awk -v a="$accuracy" 'BEGIN { exit !(a >= 80) }' || fail "$name: $accuracy % within 5 cm, must be at least 80"
}

"$bin/acmp_make_scene" room --width 160 --height 120 --keyframes 6
check offline 2000 room
for model in sparse sparse/0; do
  colmap model_analyzer --path "offline/colmap/$model" >model.log 2>&1 || fail "colmap model_analyzer: $(cat model.log)"
  grep -q "Registered images: 6" model.log || fail "colmap model_analyzer: $(cat model.log)"
done
colmap image_undistorter --image_path offline/colmap/images --input_path offline/colmap/sparse/0 --output_path undistorted \
  >undistorter.log 2>&1 || fail "colmap image_undistorter: $(tail -n 20 undistorter.log)"
cmp undistorted/sparse/cameras.bin offline/colmap/sparse/0/cameras.bin || fail "colmap found something to undistort"
check of_the_model 1200 offline/colmap --preset online --max-image-size 128
check online 2000 room --schedule online --preset online
