#!/bin/bash
# Builds everything with clang's AddressSanitizer (with leaks) and UndefinedBehaviorSanitizer, or with --thread
# ThreadSanitizer, and runs all tests of a CPU with it: libraries, tools, nodes, the nodelets in a manager linked with the
# sanitizer, and the fuzz targets over their stored inputs. Fails when a test fails or a sanitizer reports, be it in a
# process whose exit nobody looks at. docs/development.md says what is left out, and why.
# Usage: scripts/sanitizers.sh [--thread] [CTEST_ARGUMENT...]         for example -R 'test_map|rostest'
# Environment: ACMP_SANITIZE_BUILD_DIR (build_sanitize, build_thread), ACMP_TBB_SOURCE. Needs what test.sh needs, and clang.
set -uo pipefail
cd "$(dirname "$0")/.." || exit 1
kind=asan sanitizers=address,undefined,float-cast-overflow folder=build_sanitize serial=()
if [ "${1:-}" = --thread ]; then
  kind=tsan sanitizers=thread folder=build_thread
  if [ -z "${ACMP_TBB_SOURCE:-}" ]; then serial=(taskset -c 0); fi
  shift
fi
export ACMP_BUILD_DIR=${ACMP_SANITIZE_BUILD_DIR:-$PWD/$folder} PYENV_VERSION=system
# shellcheck source=scripts/build_steps.sh
source scripts/build_steps.sh
step "build in $build"
configure_sanitized "$sanitizers" || exit 1
cmake --build "$build" --parallel "$(nproc)" --target all || exit 1
if cmake --build "$build" --target help | grep -q '^tests:'; then cmake --build "$build" --target tests || exit 1; fi
if [ "$kind" = tsan ] && [ -n "${ACMP_TBB_SOURCE:-}" ]; then
  cmake -S "$ACMP_TBB_SOURCE" -B "$build/tbb" -G Ninja -DTBB_TEST=OFF -DTBB_STRICT=OFF -DTBBMALLOC_BUILD=OFF \
    -DTBB_SANITIZE=thread -DCMAKE_BUILD_TYPE=RelWithDebInfo -DTBB_OUTPUT_DIR_BASE=lib \
    -DCMAKE_CXX_COMPILER=clang++ -DCMAKE_C_COMPILER=clang >"$build/tbb.log" || exit 1
  cmake --build "$build/tbb" --parallel "$(nproc)" --target tbb >>"$build/tbb.log" || exit 1
  ln -sf "$build"/tbb/lib_relwithdebinfo/libtbb.so.* "$build/devel/lib/"  # where roslaunch looks, too
fi

# roslaunch and rosrun find this nodelet manager before the system's, which has no sanitizer in it.
mkdir -p "$build/devel/lib/nodelet"
cat >"$build/manager.cpp" <<END
#include <nodelet/loader.h>
#include <ros/ros.h>
int main(int argc, char** argv) {
  ros::init(argc, argv, "manager");
  nodelet::Loader loader;
  ros::spin();
}
END
clang++ -std=c++17 "-fsanitize=$sanitizers" "$build/manager.cpp" -o "$build/manager" -lnodeletlib -lroscpp -lrostime ||
  exit 1
cat >"$build/devel/lib/nodelet/nodelet" <<END
#!/bin/sh
if [ "\$1" = manager ]; then exec "$build/manager" "\$@"; fi
exec /usr/lib/nodelet/nodelet "\$@"
END
chmod +x "$build/devel/lib/nodelet/nodelet"

step "tests"
# shellcheck source=scripts/ros_environment.sh
source scripts/ros_environment.sh "$build"
export LD_LIBRARY_PATH=$build/devel/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
reports=$build/sanitizer_reports
rm -rf "$reports" "$build/Testing"
mkdir "$reports"
suppressions=$PWD/scripts/sanitizer_suppressions
common=log_path=$reports/report:external_symbolizer_path=$(clang++ -print-prog-name=llvm-symbolizer)
export ASAN_OPTIONS=$common:detect_stack_use_after_return=1:check_initialization_order=1:strict_string_checks=1
export UBSAN_OPTIONS=$common:print_stacktrace=1
export TSAN_OPTIONS=$common:suppressions=$suppressions/races.txt:ignore_noninstrumented_modules=1
export LSAN_OPTIONS=suppressions=$suppressions/leaks.txt:print_suppressions=0
(cd "$build" && "${serial[@]}" ctest -T Test --no-compress-output --test-output-size-passed 100000000 \
  --test-output-size-failed 100000000 --no-tests=error --output-on-failure -j"$(nproc)" --timeout 3000 "$@" </dev/null)
ctest_code=$?
step

found=$(find "$reports" -type f | wc -l)
for report in "$reports"/*; do
  if [ -f "$report" ]; then grep -hE -m 2 '^SUMMARY|ERROR: |WARNING: ThreadSanitizer|runtime error' "$report"; fi
done | sed 's/==[0-9]*==//' | sort | uniq -c | sort -rn
echo "$found reports of $sanitizers in $reports"
/usr/bin/python3 scripts/summarize_tests.py "$build" "$ctest_code" 0 $((found > 0)) 0
