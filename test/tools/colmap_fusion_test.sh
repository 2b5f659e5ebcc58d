#!/bin/bash
# Lets COLMAP itself fuse the workspaces that acmp_reconstruct --colmap writes, and compares its clouds with the exact
# surface. Skipped (exit code 77) where there is no colmap. Usage: colmap_fusion_test.sh FOLDER_OF_THE_PROGRAMS
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
check landmarks 2000 room
colmap model_analyzer --path landmarks/colmap/sparse >model.log 2>&1 || fail "colmap model_analyzer: $(cat model.log)"
grep -q "Registered images: 6" model.log || fail "colmap model_analyzer: $(cat model.log)"
check online 2000 room --schedule online --preset online
# Without landmarks the workspace has points of the fused cloud instead.
cp -r room no_landmarks && rm -r no_landmarks/sparse
check from_cloud 1200 no_landmarks --preset online --max-image-size 128
