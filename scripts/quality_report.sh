#!/usr/bin/env bash
# Measures presets on scenes and keeps what scripts/quality_report.py makes a report of:
#   scripts/quality_report.sh run FOLDER_WITH_SCENES RESULTS [PRESET...]
# PRESET: acmh acmm acmp_no_geometric acmp balanced online, unless given. acmp_reconstruct and acmp_evaluate are taken from
# PATH; python3 needs no modules. A scene is a folder with images/, cameras.txt and ground truth in depth/ (maps and
# cloud are measured) or gt_sparse/ (maps only). RESULTS/SCENE/PRESET gets depth.json, cloud.json, summary.json, and
# depth and confidence of a few images as maps/000007_depth.png (16 bit, thousandths) and maps/000007_confidence.png
# (8 bit, 255 = 1), thinned to at most 800 px. What is there already is not measured again.
# Environment: DEVICE (cuda), RECONSTRUCT_OPTIONS (further options of acmp_reconstruct), EXAMPLES (4 images per scene).
set -euo pipefail

usage() {
  sed -n '2,9p' "$0" >&2
  exit 2
}

# keep_maps MAPS TRUTH OUTPUT: depth and confidence of EXAMPLES images that have ground truth, evenly spread.
keep_maps() {
  python3 - "$@" "${EXAMPLES:-4}" << 'PYTHON'
import array, glob, os, struct, sys, zlib

MAX_SIZE = 800  # px


def read_pfm(path):
    """Rows from the top, each an array of floats."""
    with open(path, "rb") as file:
        assert file.readline().strip() == b"Pf", path
        width, height = map(int, file.readline().split())
        assert float(file.readline()) < 0, path  # little endian, as this machine
        rows = [array.array("f", file.read(4 * width)) for _ in range(height)]
    return rows[::-1]


def thin(rows):
    step = -(-max(len(rows), len(rows[0])) // MAX_SIZE)
    return [row[step // 2::step] for row in rows[step // 2::step]]


def write_png(path, rows, scale, code, largest):
    """One channel of unsigned integers: array code B (8 bit) or H (16 bit)."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    lines = []
    for row in rows:
        # What is not finite or does not fit is unknown.
        values = array.array(code, [int(x * scale + 0.5) if 0 < x * scale < largest + 0.5 else 0 for x in row])
        if sys.byteorder == "little":
            values.byteswap()
        lines.append(b"\0" + values.tobytes())
    header = struct.pack(">IIBBBBB", len(rows[0]), len(rows), 8 * array.array(code).itemsize, 0, 0, 0, 0)
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) +
                   chunk(b"IDAT", zlib.compress(b"".join(lines), 9)) + chunk(b"IEND", b""))


maps, truth, output, count = sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4])
stems = [os.path.basename(path)[:-4] for path in sorted(glob.glob(os.path.join(maps, "depth", "*.pfm")))]
stems = [stem for stem in stems if glob.glob(os.path.join(truth, stem + ".*"))]
chosen = sorted({int((k + 0.5) * len(stems) / count) for k in range(count)}) if stems else []
for stem in [stems[i] for i in chosen]:
    target = os.path.join(output, stem)
    depth, confidence = (thin(read_pfm(os.path.join(maps, kind, stem + ".pfm"))) for kind in ("depth", "confidence"))
    write_png(target + "_depth.png", depth, 1000, "H", 65535)
    write_png(target + "_confidence.png", confidence, 255, "B", 255)
PYTHON
}

# measure SCENE PRESET RESULT: leaves RESULT/summary.json last, so that a result with it is whole.
measure() {
  local scene=$1 preset=$2 result=$3 truth=depth
  [ -d "$scene/depth" ] || truth=gt_sparse
  rm -rf "$result" "$work/out"
  mkdir -p "$result/maps"
  # shellcheck disable=SC2086  # options are separate words
  acmp_reconstruct "$scene" "$work/out" --preset "$preset" --device "${DEVICE:-cuda}" --no-pictures --timings \
    --jobs-per-gpu 2 --quiet ${RECONSTRUCT_OPTIONS:-} || return 1
  acmp_evaluate depth "$scene" "$work/out/depth" --gt "$truth" --quiet --json "$result/depth.json" || return 1
  if [ "$truth" = depth ]; then
    acmp_evaluate cloud "$work/out/fused.ply" "$scene" --json "$result/cloud.json" || return 1
  fi
  keep_maps "$work/out" "$scene/$truth" "$result/maps" || return 1
  cp "$work/out/summary.json" "$result/"
}

run() {
  local scenes=$1 results=$2 scene preset result status=0
  shift 2
  [ $# -gt 0 ] || set -- acmh acmm acmp_no_geometric acmp balanced online
  [ -d "$scenes" ] || { echo "$scenes: no such folder" >&2; exit 2; }
  work=$(mktemp -d)
  trap 'rm -rf "$work"' EXIT
  for scene in "$scenes"/*/; do
    scene=${scene%/}
    if [ ! -d "$scene/depth" ] && [ ! -d "$scene/gt_sparse" ]; then
      echo "$scene: neither depth/ nor gt_sparse/: left out" >&2
      continue
    fi
    for preset in "$@"; do
      result=$results/$(basename "$scene")/$preset
      echo "-- $(basename "$scene") $preset"
      [ ! -e "$result/summary.json" ] || { echo "measured before"; continue; }
      measure "$scene" "$preset" "$result" || { echo "$scene $preset: failed" >&2; status=1; }
    done
  done
  du -sh "$results"
  return "$status"
}

case ${1:-} in
  run) shift; [ $# -ge 2 ] || usage; run "$@" ;;
  *) usage ;;
esac
