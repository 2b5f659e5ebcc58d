#!/bin/bash
# A stereo camera that stands, as a user starts it: dense_mapper.launch stereo:=true gives every image of the bag its map,
# the right images' stamps and place included; without stereo there is none.
# Usage: stereo_test.sh SOURCE_FOLDER BUILD_FOLDER ACMP_MAKE_BAG
set -euo pipefail
# A ROS master of its own, however long it takes to start: roslaunch gives up one of its own after ten seconds. $launch is
# ended with it.
folder=$(mktemp -d)
launch=
master=
# shellcheck disable=SC2154  # node: within quotes
trap 'for node in $launch $master; do kill -TERM "$node" || true; wait "$node" || true; done; rm -rf "$folder"' EXIT
# shellcheck source=scripts/ros_environment.sh
source "$1/scripts/ros_environment.sh" "$2"
port=$(/usr/bin/python3 -c 'import socket; s = socket.socket(); s.bind(("", 0)); print(s.getsockname()[1])')
export ROS_MASTER_URI=http://localhost:$port
rosmaster --core -p "$port" >"$folder/master.log" 2>&1 </dev/null &
master=$!
until rosparam list >/dev/null 2>&1; do
  kill -0 "$master" 2>/dev/null || { cat "$folder/master.log"; exit 1; }
  sleep 0.2
done
rosparam set /acmp/dense_mapper/sparse_wait 10.0  # clouds may come late on a busy machine
images=6
"$3" --synthetic "$folder/room.bag" --width 64 --height 48 --keyframes $images --standing --stereo-baseline 0.2

# run EXPECTED ARGUMENT...: what the mapper says of the images after the bag.
run() {
  local expected=$1 topics="/camera/image_raw /camera/camera_info /slam/pose /slam/sparse_points"
  shift
  roslaunch --port "$port" acmp_mapping dense_mapper.launch device:=cpu preset:=online overload:=block map:=false "$@" \
    >"$folder/roslaunch.log" 2>&1 </dev/null &
  launch=$!
  if [[ $* == *stereo* ]]; then topics+=" /camera_right/image_raw /camera_right/camera_info"; fi
  # shellcheck disable=SC2086
  timeout 300 rosbag play --quiet --wait-for-subscribers "$folder/room.bag" --topics $topics >"$folder/play.log" 2>&1 ||
    { cat "$folder/play.log" "$folder/roslaunch.log"; exit 1; }
  rosservice call --wait /acmp/dense_mapper/flush >"$folder/flush"
  cat "$folder/flush"
  grep -q "$expected" "$folder/flush" || { cat "$folder/roslaunch.log"; exit 1; }
  kill -TERM "$launch"
  wait "$launch" || true
  launch=
}

code=0
timeout 120 roslaunch --port "$port" acmp_mapping dense_mapper.launch device:=cpu map:=false stereo:=true \
  source_image:=/camera/image_raw >"$folder/twice.log" 2>&1 </dev/null || code=$?
grep -q "topics image and source_image are both /camera/image_raw: each camera must have its own" "$folder/twice.log" ||
  { cat "$folder/twice.log"; exit 1; }
[ "$code" -ne 124 ] || { echo "FAILED: it goes on with the same topic twice"; exit 1; }

run "$images received = $images refined + 0 dropped" stereo:=true mask_wait:=10
grep -q "source camera 1 is at (0.2 .* by P of the camera_infos" "$folder/roslaunch.log"
run "$images received = 0 refined + $images dropped"
