#!/bin/bash
# Puts the nodelets to faults: kill -9 while a map is saved, a full disk, a master that is restarted, wild messages,
# transforms, clocks and parameters, keyframes far away, damaged sessions. Prints a
# table: fault, runs, what was seen, ok or not. Fails when one is not ok.
# Usage: scripts/faults.sh [RUNS [SECONDS [FAULT...]]]     of each fault by kill -9 (5), of wild ones (30); names of the table
# Environment: ACMP_BUILD_DIR (build), which has been built. The full disk is a tmpfs and needs root.
set -euo pipefail
cd "$(dirname "$0")/.."
build=${ACMP_BUILD_DIR:-$PWD/build}
# shellcheck source=scripts/ros_environment.sh
source scripts/ros_environment.sh "$build"
exec /usr/bin/python3 scripts/faults.py "$build" "${1:-5}" "${2:-30}" "${@:3}"
