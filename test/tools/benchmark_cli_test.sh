#!/bin/bash
# acmp_benchmark --expect: each preset of the online mapper has a measured rate and, by the number of pixels, computed ones.
# Usage: benchmark_cli_test.sh FOLDER_OF_THE_PROGRAMS
set -euo pipefail
cd "$(mktemp -d)"
trap 'rm -rf "$PWD"' EXIT
"$1/acmp_benchmark" --expect --device cpu --source-views 1 --json expected.json >table
cat table
for preset in acmh acmp_no_geometric acmp balanced online; do grep -Eq "^$preset +[0-9]" table; done
grep -q "measured: at 64x48, 2 keyframes" table
if grep -q "^acmm" table; then echo "acmm is for offline use"; exit 1; fi
/usr/bin/python3 - <<'PYTHON'
import json
rows = json.load(open("expected.json"))["expected"]
assert len(rows) == 5, rows
for row in rows:
    assert row["keyframes_per_s"] > 0, row
    for other in row["computed"]:
        pixels = other["width"] * other["height"] / (row["width"] * row["height"])
        assert abs(other["keyframes_per_s"] * pixels / row["keyframes_per_s"] - 1) < 1e-9, row
PYTHON
if "$1/acmp_benchmark" --expect --preset online 2>wrong; then echo "--expect measures all presets"; exit 1; fi
grep -q -- "excludes" wrong

# --auto: what preset: auto chooses with all the time in the world, and with none.
"$1/acmp_benchmark" --auto 1000 --device cpu --source-views 2 --sizes 64x48 --json auto.json >best
cat best
tail -n 1 best | grep -q "^balanced, 100 % of max_image_size, at most 10 source views: keyframes come every 1000 s"
/usr/bin/python3 -c 'import json; assert len(json.load(open("auto.json"))["auto"]) >= 2'
"$1/acmp_benchmark" --auto 1e-6 --device cpu --source-views 2 --sizes 64x48 >cheapest
cat cheapest
tail -n 1 cheapest | grep -q "^online, 37.5 % .*too long for all of them"
if "$1/acmp_benchmark" --auto 1 --keyframes 5 2>wrong; then echo "--auto has its own keyframes"; exit 1; fi
grep -q -- "excludes" wrong
