#!/usr/bin/env python3
"""One HTML file, with all pictures in it, of what scripts/quality_report.sh measured.

Tables of presets x scenes, bar plots, error pictures side by side, and how well the confidence sorts the errors.
Distances are in metres. Debian packages: python3-numpy python3-matplotlib python3-pil."""
import argparse
import csv
import glob
import html
import json
import os
import sys

try:
    import numpy as np
    from PIL import Image
    import quality_figures as figures
except ImportError as error:
    sys.exit("quality_report.py: %s: install the Debian packages python3-numpy python3-matplotlib python3-pil" % error)

DEPTH_METRICS = ["< 2 cm", "< 5 cm", "< 10 cm", "< 1 %", "< 2 %", "< 5 %"]
LOW_TEXTURED_METRICS = ["low-textured " + name for name in DEPTH_METRICS]
TIME_METRICS = ["whole run, ms per image", "kernels, ms per image"]
CLOUD_METRICS = [("accuracy", "accuracy"), ("completeness", "completeness"), ("f1", "F1")]
CLOUD_THRESHOLDS_M = [0.02, 0.05]
PICTURE_WIDTH = 300  # px
STYLE = """body { font: 14px sans-serif; margin: 24px; color: #222; } h2 { margin-top: 36px; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: 0 28px 18px 0; }
caption { text-align: left; font-weight: bold; padding: 4px 0; } td, th { padding: 2px 10px; text-align: right; }
th { font-weight: normal; color: #555; border-bottom: 1px solid #bbb; }
td:first-child, th:first-child { text-align: left; }
td.best { font-weight: bold; } td:last-child, th:last-child { border-left: 1px solid #ddd; }
tr.reference td { color: #777; font-style: italic; } .tables { display: flex; flex-wrap: wrap; }
.row { display: flex; gap: 6px; overflow-x: auto; margin-bottom: 12px; } figure { margin: 0; }
.row img { width: 300px; image-rendering: pixelated; }
figcaption { font-size: 12px; color: #555; } p { max-width: 900px; line-height: 1.4; }"""


class InputError(Exception):
    """The caller's files or options are wrong."""


def read_json(path):
    try:
        with open(path) as file:
            return json.load(file)
    except (OSError, ValueError) as error:
        raise InputError("%s: cannot be read: %s" % (path, error))


def numbers(values, count, where):
    if not isinstance(values, list) or len(values) != count:
        raise InputError("%s: %s: must be a list of %d figures" % (where, values, count))
    try:
        return [float("nan") if value in (None, "") else float(value) for value in values]
    except (TypeError, ValueError):
        raise InputError("%s: %s: must be numbers" % (where, values))


def read_result(folder):
    """All figures of a scene and preset by the names of their tables."""
    found = {}
    depth = read_json(os.path.join(folder, "depth.json"))
    found.update(zip(DEPTH_METRICS, numbers(depth["mean"][:6], 6, folder)))
    for region in depth["regions"]:
        if region["name"] == "lowtex":
            found.update(zip(LOW_TEXTURED_METRICS, numbers(region["mean"][:6], 6, folder)))
    if os.path.exists(os.path.join(folder, "cloud.json")):
        for row in read_json(os.path.join(folder, "cloud.json"))["metrics"]:
            for key, name in CLOUD_METRICS:
                found["%s at %g cm" % (name, 100 * row["threshold"])] = row[key]
    summary = read_json(os.path.join(folder, "summary.json"))
    times, images = summary["milliseconds_in_last_run"], max(1, summary["images_matched_in_last_run"])
    kernels = [ms for name, ms in times.items() if name.startswith("kernels")]
    found.update(zip(TIME_METRICS, [times["whole run (steps overlap)"] / images, sum(kernels) / images]))
    return found


def read_results(root):
    """{preset: {scene: figures}} of the folders RESULTS/SCENE/PRESET that are whole."""
    results = {}
    for path in sorted(glob.glob(os.path.join(root, "*", "*", "summary.json"))):
        scene, preset = path.split(os.sep)[-3:-1]
        results.setdefault(preset, {})[scene] = read_result(os.path.dirname(path))
    if not results:
        raise InputError("%s: holds 0 results SCENE/PRESET/summary.json: must hold at least 1" % root)
    return results


def read_reference(path):
    """Rows (scene, name, six figures, perhaps six of low-textured pixels) of a CSV, or of a JSON list of objects with
    scene, name, figures and perhaps low_texture; returned as read_results does."""
    if path.endswith(".json"):
        rows = [(row["scene"], row["name"], row["figures"], row.get("low_texture")) for row in read_json(path)]
    else:
        with open(path, newline="") as file:
            lines = [line for line in csv.reader(file) if line and line[0] != "scene"]
        rows = [(line[0], line[1], line[2:8], line[8:14] or None) for line in lines if len(line) >= 2]
    results = {}
    for scene, name, values, low_texture in rows:
        where = "%s: %s %s" % (path, scene, name)
        found = results.setdefault(name, {}).setdefault(scene, {})
        found.update(zip(DEPTH_METRICS, numbers(values, 6, where)))
        if low_texture is not None:
            found.update(zip(LOW_TEXTURED_METRICS, numbers(low_texture, 6, where)))
    return results


def read_png(path):
    with Image.open(path) as image:
        return np.array(image)


def read_maps(results, scene_folder, scene, preset, unit):
    """{index: (depth, confidence, truth)} of the kept images, at the size of the kept maps."""
    maps = {}
    for path in sorted(glob.glob(os.path.join(results, scene, preset, "maps", "*_depth.png"))):
        stem = os.path.basename(path)[:6]
        truths = [os.path.join(scene_folder, name, stem + ".png") for name in ("depth", "gt_sparse")]
        truths = [truth for truth in truths if os.path.exists(truth)]
        if not truths:
            raise InputError("%s: no depth/%s.png nor gt_sparse/%s.png in it" % (scene_folder, stem, stem))
        depth = read_png(path) / 1000.0
        confidence = read_png(path.replace("_depth", "_confidence")) / 255.0
        maps[int(stem)] = depth, confidence, figures.truth_at(read_png(truths[0]) / unit, *depth.shape)
    return maps


def read_picture(scene_folder, index):
    with open(os.path.join(scene_folder, "cameras.txt")) as file:
        names = {line.split()[0]: line.split()[1] for line in file if line.split() and line[0] != "#"}
    with Image.open(os.path.join(scene_folder, "images", names[str(index)])) as image:
        return np.array(image.convert("RGB"))


def table(title, rows, scenes, references, digits=1, smallest=False):
    """`rows[name][scene]`. The mean is given where no scene is missing; the best of the presets is bold."""
    scenes = [scene for scene in scenes if any(scene in row for row in rows.values())]
    cells = {name: [row.get(scene, float("nan")) for scene in scenes] for name, row in rows.items()}
    for values in cells.values():
        values.append(float(np.mean(values)))
    own = [values for name, values in cells.items() if name not in references]
    lines = []
    for name, values in cells.items():
        text = "<td>%s</td>" % html.escape(name)
        for column, value in enumerate(values):
            shown = [round(other[column], digits) for other in own if not np.isnan(other[column])]
            best = name not in references and len(shown) > 1 and round(value, digits) == (
                min(shown) if smallest else max(shown))
            number = "\N{EN DASH}" if np.isnan(value) else "%.*f" % (digits, value)
            text += "<td%s>%s</td>" % (" class=best" if best else "", number)
        lines.append("<tr%s>%s</tr>" % (" class=reference" if name in references else "", text))
    heads = "".join("<th>%s</th>" % html.escape(scene) for scene in [""] + scenes + ["mean"])
    return "<table><caption>%s</caption><tr>%s</tr>%s</table>" % (html.escape(title), heads, "".join(lines))


def metric_tables(results, scenes, references, names, **options):
    """Three in a line: the distances, the shares, or the three figures of a cloud at one distance."""
    tables = []
    for name in names:
        rows = {preset: {scene: found[name] for scene, found in row.items() if not np.isnan(found.get(name, np.nan))}
                for preset, row in results.items()}
        rows = {preset: row for preset, row in rows.items() if row}
        if rows:
            tables.append(table(name, rows, scenes, references, **options))
    lines = ["".join(tables[i:i + 3]) for i in range(0, len(tables), 3)]
    return "".join("<div class=tables>%s</div>" % line for line in lines) or "<p>None.</p>"


def scene_plots(results, scene, colors):
    text = ""
    for metrics, title in ((DEPTH_METRICS, "all pixels"), (LOW_TEXTURED_METRICS, "low-textured pixels")):
        values = {preset: [row[scene].get(name, np.nan) for name in metrics]
                  for preset, row in results.items() if scene in row}
        values = {preset: row for preset, row in values.items() if not np.all(np.isnan(row))}
        if values:
            plot = figures.bar_plot(DEPTH_METRICS, list(values), values, colors, "%s: %s" % (scene, title))
            text += "<img src='%s'><br>" % plot
    return text


def example_rows(maps, scene_folder):
    """`maps[preset][index]`; one row of pictures per image."""
    def cell(picture, caption, kind="PNG"):
        return "<figure><img src='%s'><figcaption>%s</figcaption></figure>" % (
            figures.encode(picture, PICTURE_WIDTH, kind), html.escape(caption))
    text = ""
    for index in sorted(set().union(*maps.values())):
        truth = next(found[index][2] for found in maps.values() if index in found)
        known = truth > 0
        low, high = np.percentile(truth[known], [2, 98]) if known.any() else (1.0, 2.0)
        row = cell(read_picture(scene_folder, index), "image %d" % index, "JPEG")
        row += cell(figures.spread_sparse(figures.depth_picture(truth, low, high), known),
                    "ground truth, %.2f (bright) to %.2f m" % (low, high))
        for preset, found in maps.items():
            if index in found:
                depth, _, truth = found[index]
                picture = figures.spread_sparse(figures.error_picture(depth, truth), truth > 0)
                good = 100 * np.mean((np.abs(depth - truth) < figures.WRONG_M)[truth > 0])
                row += cell(picture, "%s: %.1f %% < %g cm" % (preset, good, 100 * figures.WRONG_M))
        text += "<div class=row>%s</div>" % row
    return text


def confidence_curves(maps):
    """{preset: (density, risk, ideal)} for wrong pixels, {preset: area ratio} for those and for absolute errors."""
    curves, wrong_ratio, error_ratio = {}, {}, {}
    for preset, found in maps.items():
        depth, confidence, truth = (np.concatenate([item[k].ravel() for item in found.values()]) for k in range(3))
        known, both = truth > 0, (truth > 0) & (depth > 0)
        if not both.any():
            continue
        error = np.abs(depth - truth)[both]
        risk, ideal = figures.risk_coverage(confidence[both], error >= figures.WRONG_M)
        curves[preset] = both.sum() / known.sum(), risk, ideal
        wrong_ratio[preset] = figures.area_ratio(risk, ideal)
        error_ratio[preset] = figures.area_ratio(*figures.risk_coverage(confidence[both], error))
    return curves, wrong_ratio, error_ratio


def confidence_section(maps, scenes, colors):
    text, wrong_rows, error_rows = "", {}, {}
    for scene in scenes:
        curves, wrong, error = confidence_curves(maps[scene])
        for rows, ratios in ((wrong_rows, wrong), (error_rows, error)):
            for preset, ratio in ratios.items():
                rows.setdefault(preset, {})[scene] = ratio
        if curves:
            text += "<h3>%s</h3><img src='%s'>" % (html.escape(scene), figures.risk_plot(curves, colors))
    tables = table("area ratio, share of wrong pixels", wrong_rows, scenes, (), 2, True)
    tables += table("area ratio, mean absolute error", error_rows, scenes, (), 2, True)
    return "<div class=tables>%s</div>%s" % (tables, text)


def report(arguments):
    results = read_results(arguments.results)
    reference = read_reference(arguments.reference) if arguments.reference else {}
    presets, scenes = list(results), sorted(set().union(*results.values()))
    folders = {scene: os.path.join(arguments.scenes, scene) for scene in scenes}
    maps = {scene: {preset: read_maps(arguments.results, folders[scene], scene, preset, arguments.gt_png_unit)
                    for preset in presets if scene in results[preset]} for scene in scenes}
    both = {**results, **{name + " (reference)" if name in results else name: row for name, row in reference.items()}}
    references = [name for name in both if name not in results]
    colors = {name: figures.COLORS[i % len(figures.COLORS)] for i, name in enumerate(results)}
    colors.update({name: figures.GREYS[i % len(figures.GREYS)] for i, name in enumerate(references)})
    cloud = ["%s at %g cm" % (name, 100 * m) for m in CLOUD_THRESHOLDS_M for _, name in CLOUD_METRICS]

    text = "<h1>Quality of the presets</h1><p>%d scenes: %s. A ground-truth pixel without an estimate counts as " \
           "wrong. Best preset bold; rows in italics are given for comparison.</p>" % (
               len(scenes), html.escape(", ".join(scenes)))
    text += "<h2>Depth: % of ground-truth pixels with an error below</h2>"
    text += metric_tables(both, scenes, references, DEPTH_METRICS)
    text += "<h2>Depth of low-textured pixels: %</h2>"
    text += metric_tables(both, scenes, references, LOW_TEXTURED_METRICS)
    text += "<h2>Point cloud: %</h2>" + metric_tables(both, scenes, references, cloud)
    text += "<h2>Time</h2>" + metric_tables(both, scenes, references, TIME_METRICS, smallest=True)
    text += "<h2>Per scene</h2>" + "".join(scene_plots(both, scene, colors) for scene in scenes)
    text += "<h2>Errors</h2><p><img src='%s'><br>" % figures.error_legend()
    text += "Black: no ground truth. White: no estimate.</p>"
    for scene in scenes:
        text += "<h3>%s</h3>%s" % (html.escape(scene), example_rows(maps[scene], folders[scene]))
    text += "<h2>Confidence</h2><p>Of the pictures above: pixels that have ground truth and an estimate, the most " \
            "confident first; dashed, sorted by their true error. A curve ends where estimates do. The ratio of the " \
            "areas under the two is 1 for a confidence that sorts as well as the truth.</p>"
    text += confidence_section(maps, scenes, colors)
    head = "<meta charset=utf-8><title>Quality of the presets</title><style>%s</style>" % STYLE
    return "<!DOCTYPE html><html><head>%s</head><body>%s</body></html>\n" % (head, text)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", metavar="RESULTS", help="what quality_report.sh run wrote")
    parser.add_argument("scenes", metavar="SCENES", help="folder with the scenes that it measured")
    parser.add_argument("output", metavar="OUTPUT.html")
    parser.add_argument("--reference", metavar="FILE", help="further rows: CSV with scene, name, six figures in the "
                        "order 2, 5, 10 cm, 1, 2, 5 %% and perhaps six more of low-textured pixels; or JSON, a list "
                        'of {"scene", "name", "figures": [...], "low_texture": [...]}')
    parser.add_argument("--gt-png-unit", type=float, default=1000.0, help="counts per metre of ground truth (1000)")
    arguments = parser.parse_args()
    try:
        if not arguments.gt_png_unit > 0:
            raise InputError("--gt-png-unit = %g: must be > 0" % arguments.gt_png_unit)
        text = report(arguments)
    except KeyError as error:
        sys.stderr.write("quality_report.py: a file of RESULTS, cameras.txt or FILE has no entry %s\n" % error)
        return 2
    except (InputError, OSError) as error:
        sys.stderr.write("quality_report.py: %s\n" % error)
        return 2
    with open(arguments.output + ".part", "w", encoding="utf-8") as file:
        file.write(text)
    os.replace(arguments.output + ".part", arguments.output)
    print("%s: %.1f MB" % (arguments.output, len(text) / 1e6))
    return 0


if __name__ == "__main__":
    sys.exit(main())
