#!/bin/bash
# Builds everything with warnings as errors and runs all tests and style checks, on Debian 11 to 13 with nothing
# installed. Ends with one line "N passed, N failed, N skipped" (a test is one ctest entry or one style check). The style is
# that of clang 14, Debian 12's: other versions see other things, and the style checks are skipped where they are.
# Environment: ACMP_BUILD_DIR (build, that of demo.sh), ACMP_CUDA (AUTO, ON or OFF), ACMP_SKIP_STYLE=1 to leave the style
# checks out.
set -uo pipefail
cd "$(dirname "$0")/.." || exit 1
# shellcheck source=scripts/build_steps.sh
source scripts/build_steps.sh
export PYENV_VERSION=system

step "packages"
scripts/install_dependencies.sh || exit 1
step "build in $build"
configure || exit 1
cmake --build "$build" --parallel "$(nproc)" --target all || exit 1
if cmake --build "$build" --target help | grep -q '^tests:'; then  # catkin's own tests are not part of "all"
  cmake --build "$build" --parallel "$(nproc)" --target tests || exit 1
fi

step "tests and style"
# Style beside the tests, many of which wait most of the time.
style_passed=0
style_failed=0
style_skipped=0
clang=$(clang-format --version | sed 's/.*version \([0-9]*\).*/\1/')
if [ "${ACMP_SKIP_STYLE:-0}" != 1 ] && [ "$clang" != 14 ]; then
  echo "skipped: style: clang-format is $clang, not 14"
  style_skipped=1
elif [ "${ACMP_SKIP_STYLE:-0}" != 1 ]; then
  nice scripts/check_style.sh "$build" >"$build/style.log" 2>&1 </dev/null &
  style=$!
fi
# shellcheck source=scripts/ros_environment.sh
source scripts/ros_environment.sh "$build"
# Tests write small files and wait until the disk has them: in memory, where there are 2 GB of it, they take a tenth of that.
shm_kb=$(df -k --output=avail /dev/shm 2>/dev/null | tail -n 1)
if [ -w /dev/shm ] && [ "${shm_kb:-0}" -gt 2000000 ]; then
  TMPDIR=$(mktemp -d -p /dev/shm)
  export TMPDIR
  trap 'rm -rf "$TMPDIR"' EXIT
fi
rm -rf "$build/Testing"
# In a form that every ctest from 3.16 on writes; without a limit on what is kept of the output.
(cd "$build" && ctest -T Test --no-compress-output --test-output-size-passed 100000000 --test-output-size-failed 100000000 \
                      --no-tests=error --output-on-failure -j4 --timeout 600 </dev/null)
ctest_code=$?
if [ -n "${style:-}" ]; then
  if wait "$style"; then style_passed=1; else style_failed=1; fi
  cat "$build/style.log"
fi
step
/usr/bin/python3 scripts/summarize_tests.py "$build" "$ctest_code" "$style_passed" "$style_failed" "$style_skipped"
