#!/bin/bash
# acmp_benchmark --expect: each preset of the online mapper has a measured rate and, by the number of pixels, computed ones.
# Usage: benchmark_cli_test.sh FOLDER_OF_THE_PROGRAMS
set -euo pipefail
cd "$(mktemp -d)"
trap 'rm -rf "$PWD"' EXIT
"$1/acmp_benchmark" --expect --device cpu --source-views 1 >table
cat table
for preset in acmh acmp_no_geometric acmp balanced online; do grep -Eq "^$preset +[0-9]" table; done
grep -q "measured: at 64x48, 2 keyframes" table
if grep -q "^acmm" table; then echo "acmm is for offline use"; exit 1; fi
# 320x240 and 640x480 have 25 and 100 times the pixels of 64x48; three digits are shown.
awk '/^(acm|bal|onl)/ {rows++; for (i = 3; i <= 5; i += 2) if (!($2 > 0 && ($2 / $i / (i == 3 ? 25 : 100) - 1)^2 < 1e-4)) exit 1}
     END {exit rows != 5}' table
if "$1/acmp_benchmark" --expect --preset online 2>wrong; then echo "--expect measures all presets"; exit 1; fi
grep -q -- "excludes" wrong

# --auto: what preset: auto chooses with all the time in the world, and with none.
"$1/acmp_benchmark" --auto 1000 --device cpu --source-views 2 --sizes 64x48 >best
cat best
tail -n 1 best | grep -q "^balanced, 100 % of max_image_size, at most 10 source views: keyframes come every 1000 s"
test "$(wc -l <best)" -ge 2
"$1/acmp_benchmark" --auto 1e-6 --device cpu --source-views 2 --sizes 64x48 >cheapest
cat cheapest
tail -n 1 cheapest | grep -q "^online, 37.5 % .*too long for all of them"
if "$1/acmp_benchmark" --auto 1 --keyframes 5 2>wrong; then echo "--auto has its own keyframes"; exit 1; fi
grep -q -- "excludes" wrong
