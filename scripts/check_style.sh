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
  # Only what this build compiles: without CUDA the files in cuda/ have no flags.
  mapfile -t units < <(/usr/bin/python3 - "$build/compile_commands.json" <<'PYTHON'
import json, os, subprocess, sys
tracked = {os.path.realpath(path) for path in subprocess.check_output(["git", "ls-files", "*.cpp"], text=True).split()}
units = {os.path.realpath(os.path.join(entry["directory"], entry["file"])) for entry in json.load(open(sys.argv[1]))}
# Large files first, so that no processor is left with one at the end.
print("\n".join(sorted(tracked & units, key=os.path.getsize, reverse=True)))
PYTHON
)
  printf '%s\0' "${units[@]}" | xargs -0 -P "$(nproc)" -n 4 clang-tidy --quiet -p "$build" 2>/dev/null
  echo "clang-tidy: ${#units[@]} files"
fi
