#!/bin/bash
# Installs a package made by cpack (docs/development.md), maps the demo's room with what is installed, and removes it. Fails
# when one does not work, the map is poor, or something stays. Changes the system: for a new root, by
#   ACMP_PACKAGE=build/acmp-mapping_0.1.0_amd64.deb scripts/test_on.sh bookworm scripts/test_package.sh
# Usage: scripts/test_package.sh [FILE.deb]       (default: /package.deb, where test_on.sh puts ACMP_PACKAGE)
set -euo pipefail
deb=$(realpath "${1:-/package.deb}")
name=$(dpkg-deb --field "$deb" Package)
work=$(mktemp -d)
cd "$work" # nothing of a checkout is found
export ROS_HOME=$work/ros_home ROS_HOSTNAME=localhost PYENV_VERSION=system LC_ALL=C.UTF-8
export PYTHONUNBUFFERED=1 DEBIAN_FRONTEND=noninteractive # roslaunch says at once that the player has ended
launch=
trap '[ -z "$launch" ] || kill -INT "$launch" 2>/dev/null || true; wait; rm -rf "$work"' EXIT

SECONDS=0
apt-get update >/dev/null
apt-get install -y --no-install-recommends "$deb" >"$work/apt.log" 2>&1 || { tail -n 20 "$work/apt.log"; exit 1; }
echo "-- installed after $SECONDS s"
python3 -c 'import acmp_mapping.offline, acmp_mapping.msg, acmp_mapping.srv'

roslaunch acmp_mapping demo.launch rviz:=false preset:=online device:=cpu save_folder:="$work" >"$work/launch.log" 2>&1 &
launch=$!
# The player ends with the recording.
for _ in $(seq 600); do
  grep -q 'player.*has finished cleanly' "$work/launch.log" && break
  kill -0 "$launch" 2>/dev/null || break
  sleep 0.5
done
rosservice call /acmp/dense_mapper/flush || { cat "$work/launch.log"; exit 1; }
rosservice call /acmp/map_server/save_map '{path: map.ply, format: 0, binary: true}'
kill -INT "$launch"
wait "$launch" || true
launch=
echo "-- mapped after $SECONDS s"

acmp_make_bag --synthetic --labels --width 320 --height 240 again.bag --ground-truth truth >/dev/null
cmp again.bag "$ROS_HOME/acmp_room.bag"
acmp_evaluate cloud map.ply truth/surface.ply --json map.json
python3 -c '
import json
metrics = {m["threshold"]: m["f1"] for m in json.load(open("map.json"))["metrics"]}
assert metrics[0.05] > 75, metrics  # the demo has 86: far below, something is missing
'

apt-get purge -y "$name" >"$work/apt.log" 2>&1 || { tail -n 20 "$work/apt.log"; exit 1; }
left=$(find /usr /etc /var/lib \( -name '*acmp*' -o -path '*/acmp_mapping/*' \) -not -path '/var/lib/apt/*' 2>/dev/null)
[ -z "$left" ] || { echo "left behind: $left"; exit 1; }
echo "-- $name is removed, and nothing of it is left"
