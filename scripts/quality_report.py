#!/usr/bin/env python3
"""Measures presets on scenes with ground truth, and prints tables of all results as Markdown.

    scripts/quality_report.py SCENES RESULTS balanced online

SCENES holds one folder per scene, with images/, cameras.txt and ground truth in depth/ (maps and cloud are measured) or
gt_sparse/ (maps only). RESULTS/SCENE/PRESET gets depth.json, cloud.json and summary.json; what is there already is not
measured again. acmp_reconstruct and acmp_evaluate are taken from PATH. Needs nothing but Python.
"""
import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

PRESETS = ["acmh", "acmm", "acmp_no_geometric", "acmp", "balanced", "online"]
DEPTH = ["< 2 cm", "< 5 cm", "< 10 cm", "< 1 %", "< 2 %", "< 5 %"]  # of the ground-truth pixels, in this order


def measure(scene, preset, result, options):
    """Leaves summary.json last, so that a result with it is whole."""
    shutil.rmtree(result, ignore_errors=True)
    result.mkdir(parents=True)
    truth = "depth" if (scene / "depth").is_dir() else "gt_sparse"
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        subprocess.run(["acmp_reconstruct", scene, out, "--preset", preset, "--device", options.device, "--no-pictures",
                        "--timings", "--quiet", *options.reconstruct_options.split()],
                       check=True, stdout=subprocess.DEVNULL)
        subprocess.run(["acmp_evaluate", "depth", scene, out / "depth", "--gt", truth, "--quiet", "--json",
                        result / "depth.json"], check=True, stdout=subprocess.DEVNULL)
        if truth == "depth":
            subprocess.run(["acmp_evaluate", "cloud", out / "fused.ply", scene, "--json", result / "cloud.json"],
                           check=True, stdout=subprocess.DEVNULL)
        shutil.copy(out / "summary.json", result)


def figures(result):
    """All figures of a scene and preset by the names of their tables."""
    found = {}
    depth = json.loads((result / "depth.json").read_text())
    found.update(zip(DEPTH, depth["mean"]))
    for region in depth["regions"]:
        if region["name"] == "lowtex":
            found.update(zip(["low-textured " + name for name in DEPTH], region["mean"]))
    if (result / "cloud.json").exists():
        for row in json.loads((result / "cloud.json").read_text())["metrics"]:
            for name in ("accuracy", "completeness", "f1"):
                found["cloud at %g cm: %s" % (100 * row["threshold"], name)] = row[name]
    summary = json.loads((result / "summary.json").read_text())
    times = summary["milliseconds_in_last_run"]
    images = max(1, summary["images_matched_in_last_run"])
    found["whole run, ms per image"] = times["whole run (steps overlap)"] / images
    found["kernels, ms per image"] = sum(ms for name, ms in times.items() if name.startswith("kernels")) / images
    return {name: value for name, value in found.items() if value is not None}


def tables(results):
    """results: figures by preset and scene. One table per figure; the mean where no scene is missing."""
    names = list(dict.fromkeys(name for row in results.values() for found in row.values() for name in found))
    for name in names:
        scenes = sorted({scene for row in results.values() for scene, found in row.items() if name in found})
        yield "\n| %s | %s | mean |\n|---%s|" % (name, " | ".join(scenes), "|---" * (len(scenes) + 1))
        for preset, row in results.items():
            values = [row.get(scene, {}).get(name) for scene in scenes]
            values.append(None if None in values else sum(values) / len(values))
            yield "| %s | %s |" % (preset, " | ".join("-" if v is None else "%.1f" % v for v in values))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("results", type=Path)
    parser.add_argument("presets", nargs="*", default=PRESETS, help="by default " + " ".join(PRESETS))
    parser.add_argument("--device", default="cuda", help="of acmp_reconstruct (cuda)")
    parser.add_argument("--reconstruct-options", default="", help="more of them, as one word")
    options = parser.parse_args()
    scenes = [scene for scene in sorted(options.scenes.glob("*"))
              if (scene / "depth").is_dir() or (scene / "gt_sparse").is_dir()]
    if not scenes:
        sys.exit("%s: no folder in it has depth/ or gt_sparse/" % options.scenes)
    results, failed = {}, False
    for scene in scenes:
        for preset in options.presets:
            result = options.results / scene.name / preset
            if not (result / "summary.json").exists():
                print("-- %s %s" % (scene.name, preset), file=sys.stderr, flush=True)
                try:
                    measure(scene, preset, result, options)
                except subprocess.CalledProcessError as error:
                    print("%s %s: %s" % (scene.name, preset, error), file=sys.stderr)
                    failed = True
                    continue
            results.setdefault(preset, {})[scene.name] = figures(result)
    print("\n".join(tables(results)))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
