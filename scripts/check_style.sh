#!/bin/bash
# Format (clang-format) and mistakes (clang-tidy on every .cpp but the tests'; it cannot read .cu). Fails when one finds
# something.
# Usage: scripts/check_style.sh [BUILD_FOLDER]     a configured build; without it only what needs none is checked
set -euo pipefail
cd "$(dirname "$0")/.."
build=${1:-}
export PYENV_VERSION=system

mapfile -t sources < <(git ls-files '*.h' '*.cpp' '*.cu' '*.cuh')
failed=0
clang-format --dry-run -Werror "${sources[@]}" || failed=1
echo "clang-format: ${#sources[@]} files"
if grep -n '#include <oneapi/' "${sources[@]}"; then
  echo "TBB 2020 (Debian 11, Ubuntu 20.04) has no oneapi/ headers: include <tbb/...>"
  failed=1
fi

if [ -n "$build" ]; then
  # Only what this build compiles: without CUDA the files in cuda/ have no flags. All modules in three units, as to read
  # the headers takes longer than to check what includes them: a name without linkage means one thing in all of src/.
  units=$(mktemp -d)
  trap 'rm -rf "$units"' EXIT
  export units
  # tidy UNIT: what it says on stderr only where it fails, as that is mostly how many findings it does not show. That units
  # include .cpp files is no mistake.
  tidy() {
    clang-tidy --quiet -p "$units" --checks=-bugprone-suspicious-include "$1" 2>"$1.log" || { cat "$1.log"; return 1; }
  }
  export -f tidy
  /usr/bin/python3 scripts/style_units.py "$build/compile_commands.json" "$units" |
    xargs -P "$(nproc)" -I{} bash -c 'tidy {}' || failed=1
fi
exit $failed
