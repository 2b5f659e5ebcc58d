# shellcheck shell=bash
# Sourced by stereo_test.sh with its arguments SOURCE_FOLDER BUILD_FOLDER: a folder of their own, and a ROS
# master, however long it takes to start: roslaunch gives up one of its own after ten seconds. $launch is ended with them.
set -euo pipefail
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
