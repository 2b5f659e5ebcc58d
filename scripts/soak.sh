#!/bin/bash
# Plays a looped bag of the synthetic room into the nodelets and looks, after each loop, at the manager's memory, file
# handles and threads. Prints a table and fails when one of them goes on growing after the first quarter of the time.
# Usage: scripts/soak.sh [MINUTES]     (60; at least 2)
# Environment: ACMP_BUILD_DIR (build), which has been built.
set -euo pipefail
cd "$(dirname "$0")/.."
build=${ACMP_BUILD_DIR:-$PWD/build}
# shellcheck source=scripts/ros_environment.sh
source scripts/ros_environment.sh "$build"
exec /usr/bin/python3 scripts/soak.py "$build" "${1:-60}"
