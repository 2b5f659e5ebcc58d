#!/bin/bash
# Format (clang-format), mistakes (clang-tidy on every .cpp; it cannot read .cu) and the package's build files
# (catkin_lint). Fails when one of them finds something.
# Usage: scripts/check_style.sh [BUILD_FOLDER]     a configured build; without it only what needs none is checked
set -euo pipefail
cd "$(dirname "$0")/.."
build=${1:-}
export PYENV_VERSION=system

mapfile -t sources < <(git ls-files '*.h' '*.cpp' '*.cu' '*.cuh')
clang-format --dry-run -Werror "${sources[@]}"
echo "clang-format: ${#sources[@]} files"

# catkin_lint does not know Debian's CMake packages; only its errors count.
catkin_lint --quiet -W0 . 2>&1 | { grep -v 'rosdep database' || true; }
[ "${PIPESTATUS[0]}" -eq 0 ]
echo "catkin_lint: no errors"

if [ -n "$build" ]; then
  mapfile -t units < <(git ls-files '*.cpp')
  # Slowest first would need a history; by size is near enough.
  ls -S "${units[@]}" | xargs -P "$(nproc)" -n 2 clang-tidy --quiet -p "$build" 2>/dev/null
  echo "clang-tidy: ${#units[@]} files"
fi
