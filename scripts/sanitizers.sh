#!/bin/bash
# Builds everything with clang's AddressSanitizer (with leaks) and UndefinedBehaviorSanitizer and runs all tests of a CPU
# with it: libraries, tools, nodes, the nodelets in a manager that the sanitizer is loaded into, and the fuzz targets over
# their stored inputs. Prints one summary; fails when a test fails or a sanitizer reports, be it in a process whose exit
# nobody looks at. Third-party leaks that are left out are in scripts/sanitizer_suppressions/, each with its reason.
# Usage: scripts/sanitizers.sh [--thread] [CTEST_ARGUMENT...]         for example -R 'test_map|rostest'
#   --thread   ThreadSanitizer instead. It cannot see how an uninstrumented TBB, which is what Debian has, hands work from
#              thread to thread, and would report all of it: TBB works in its serial mode, without workers, as all runs on
#              one processor. Races between our own threads are found, races within parallel loops are not.
# Environment: ACMP_SANITIZE_BUILD_DIR (build_sanitize, build_thread). Needs what test.sh needs, and clang.
set -uo pipefail
cd "$(dirname "$0")/.." || exit 1
kind=asan sanitizers=address,undefined,float-cast-overflow folder=build_sanitize serial=()
if [ "${1:-}" = --thread ]; then
  kind=tsan sanitizers=thread folder=build_thread serial=(taskset -c 0)
  shift
fi
export ACMP_BUILD_DIR=${ACMP_SANITIZE_BUILD_DIR:-$PWD/$folder} PYENV_VERSION=system
# shellcheck source=scripts/build_steps.sh
source scripts/build_steps.sh
step "build in $build"
configure_sanitized "$sanitizers" || exit 1
cmake --build "$build" --parallel "$(nproc)" --target all || exit 1
if cmake --build "$build" --target help | grep -q '^tests:'; then cmake --build "$build" --target tests || exit 1; fi

# roslaunch and rosrun find this manager before the system's, which no sanitizer is linked into.
runtime=$(clang++ -print-runtime-dir)/libclang_rt.$kind-$(uname -m).so
mkdir -p "$build/devel/lib/nodelet"
cat >"$build/devel/lib/nodelet/nodelet" <<END
#!/bin/sh
LD_PRELOAD=$runtime exec /usr/lib/nodelet/nodelet "\$@"
END
chmod +x "$build/devel/lib/nodelet/nodelet"

step "tests"
# shellcheck source=scripts/ros_environment.sh
source scripts/ros_environment.sh "$build"
reports=$build/sanitizer_reports
rm -rf "$reports" "$build/Testing"
mkdir "$reports"
suppressions=$PWD/scripts/sanitizer_suppressions
common=log_path=$reports/report:external_symbolizer_path=$(clang++ -print-prog-name=llvm-symbolizer)
export ASAN_OPTIONS=$common:detect_stack_use_after_return=1:check_initialization_order=1:strict_string_checks=1
export UBSAN_OPTIONS=$common:print_stacktrace=1 TSAN_OPTIONS=$common:suppressions=$suppressions/races.txt
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
