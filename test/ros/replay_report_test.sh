#!/bin/sh
# A small bag played fast with each overload policy: scripts/replay_report.py fails unless it can account for every image.
# Usage: replay_report_test.sh SOURCE_FOLDER BUILD_FOLDER ACMP_MAKE_BAG
set -e
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$3" --synthetic "$folder/room.bag" --width 64 --height 48
/usr/bin/python3 "$1/scripts/replay_report.py" "$2" "$folder/room.bag" --rates 20 \
  --set device=cpu preset=online >"$folder/table"
cat "$folder/table"
test "$(grep -c '| 14 |' "$folder/table")" -ge 3  # all 14 images came with each policy
