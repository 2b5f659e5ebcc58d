"""Figures and pictures of scripts/quality_report.py: what confidence is worth, coloured errors, bar plots, curves."""
import base64
import io

import matplotlib
matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

WRONG_M = 0.05          # scene units (metres): an error from here on is wrong in the risk curves
WITHIN_M, LIMIT_M = 0.02, 0.20  # error pictures: grey up to the first, full colour from the second on
GREY, NEAR, FAR = np.array([185, 185, 185]), np.array([20, 50, 200]), np.array([205, 25, 20])
NO_ESTIMATE = np.array([255, 255, 255])
COLORS = ["#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#999933", "#882255"]  # presets
GREYS = ["#999999", "#555555", "#cccccc", "#333333"]  # references


def nearest(image, height, width):
    """The image looked up at the nearest pixel centre for each pixel of another size."""
    rows = np.floor((np.arange(height) + 0.5) * image.shape[0] / height).astype(int)
    cols = np.floor((np.arange(width) + 0.5) * image.shape[1] / width).astype(int)
    return image[rows[:, None], cols[None, :]]


def is_sparse(known):
    """Points rather than surfaces: they would get lost in thinned maps and pictures."""
    return known.any() and known.mean() < 0.05


def truth_at(truth, height, width):
    """Ground truth for a map of another size. Every pixel of sparse truth goes to the pixel of the map it lies in."""
    if not is_sparse(truth > 0):
        return nearest(truth, height, width)
    small = np.zeros((height, width), truth.dtype)
    rows, cols = np.nonzero(truth > 0)
    small_rows = (2 * rows + 1) * height // (2 * truth.shape[0])
    small_cols = (2 * cols + 1) * width // (2 * truth.shape[1])
    small[small_rows, small_cols] = truth[rows, cols]
    return small


def running_mean(loss, order_by):
    """Mean loss of the first 1, 2, ... n pixels by falling order_by; pixels of equal order share their mean loss."""
    _, group = np.unique(-order_by, return_inverse=True)
    shared = (np.bincount(group, loss) / np.bincount(group))[group]
    return np.cumsum(shared[np.argsort(group, kind="stable")]) / np.arange(1, len(loss) + 1)


def risk_coverage(confidence, loss):
    """(risk by falling confidence, ideal risk by rising loss), each over the first 1, 2, ... n pixels."""
    confidence, loss = np.asarray(confidence, float), np.asarray(loss, float)
    return running_mean(loss, confidence), running_mean(loss, -loss)


def area_ratio(risk, ideal):
    """Area under the risk over the ideal's: 1 = the confidence sorts the errors perfectly. NaN without any error."""
    return float(np.mean(risk) / np.mean(ideal)) if len(ideal) and np.mean(ideal) > 0 else float("nan")


def error_picture(estimate, truth):
    """RGB: blue too near, red too far, grey within WITHIN_M, full colour from LIMIT_M on; black where the truth is
    unknown, white where only the estimate is (both: not > 0)."""
    error = np.where(truth > 0, estimate - truth, 0.0)
    strength = np.clip((np.abs(error) - WITHIN_M) / (LIMIT_M - WITHIN_M), 0, 1)[..., None]
    # Even a small error beyond the grey must be seen as blue or red: the colour begins with a step.
    strength = np.where(strength > 0, 0.25 + 0.75 * strength, 0)
    end = np.where(error[..., None] < 0, NEAR, FAR)
    picture = (1 - strength) * GREY + strength * end
    picture[~(estimate > 0)] = NO_ESTIMATE
    picture[~(truth > 0)] = 0
    return np.round(picture).astype(np.uint8)


def spread_sparse(picture, known, radius=2):
    """Each known pixel of sparse truth as a square, so that it can be seen."""
    if not is_sparse(known):
        return picture
    spread = picture.copy()
    height, width = known.shape
    for row, col in zip(*np.nonzero(known)):
        spread[max(row - radius, 0):min(row + radius + 1, height),
               max(col - radius, 0):min(col + radius + 1, width)] = picture[row, col]
    return spread


def depth_picture(depth, low, high):
    """RGB of inverse depth between two depths, near is bright; unknown black."""
    inverse = 1 / np.where(depth > 0, depth, high)
    shade = np.clip((inverse - 1 / high) / max(1 / low - 1 / high, 1e-12), 0, 1)
    picture = np.round(255 * plt.get_cmap("viridis")(shade)[..., :3]).astype(np.uint8)
    picture[~(depth > 0)] = 0
    return picture


def encode(picture, width, kind="PNG"):
    """A picture as data: URI, at most `width` px wide (nearest pixels, which keep their colours; JPEG: averaged)."""
    image = Image.fromarray(picture)
    if image.width > width:
        size = (width, max(1, round(image.height * width / image.width)))
        image = image.resize(size, Image.BOX if kind == "JPEG" else Image.NEAREST)
    data = io.BytesIO()
    image.save(data, kind, **({"quality": 88} if kind == "JPEG" else {"optimize": True}))
    return "data:image/%s;base64,%s" % (kind.lower(), base64.b64encode(data.getvalue()).decode())


def encode_figure(figure):
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=100, bbox_inches="tight")
    plt.close(figure)
    return "data:image/png;base64," + base64.b64encode(data.getvalue()).decode()


def hide_frame(axes):
    """Leaves the left and the lower line of a plot's frame."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def bar_plot(groups, names, values, colors, title):
    """Bars of `values[name]` (one per group, NaN: none), percent."""
    figure, axes = plt.subplots(figsize=(9, 2.6))
    width = 0.84 / max(len(names), 1)
    for i, name in enumerate(names):
        at = np.arange(len(groups)) + (i - (len(names) - 1) / 2) * width
        axes.bar(at, np.nan_to_num(values[name]), 0.92 * width, label=name, color=colors[name])
    axes.set_xticks(range(len(groups)))
    axes.set_xticklabels(groups)
    axes.set_ylim(0, 100)
    axes.set_ylabel("%")
    axes.set_title(title, loc="left", fontsize=10)
    axes.grid(axis="y", alpha=0.3)
    axes.set_axisbelow(True)
    hide_frame(axes)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=9)
    return encode_figure(figure)


def risk_plot(curves, colors):
    """`curves[name]` = (share of true pixels with an estimate, risk, ideal); dashed: ideal."""
    figure, axes = plt.subplots(figsize=(6.4, 3.6))
    for name, (density, risk, ideal) in curves.items():
        at = np.linspace(0, len(risk) - 1, min(len(risk), 400)).astype(int)
        coverage = 100 * density * (at + 1) / len(risk)
        axes.plot(coverage, 100 * risk[at], color=colors[name], label=name)
        axes.plot(coverage, 100 * ideal[at], color=colors[name], linestyle="--", linewidth=1)
    axes.set_xlim(0, 100)
    axes.set_ylim(0)
    axes.set_xlabel("coverage: % of the pixels with ground truth, most confident first")
    axes.set_ylabel("%% of them wrong by %g cm or more" % (100 * WRONG_M))
    axes.grid(alpha=0.3)
    hide_frame(axes)
    axes.plot([], [], color="grey", linestyle="--", linewidth=1, label="ideal order")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=9)
    return encode_figure(figure)


def error_legend():
    """The colour scale of error_picture, drawn by it."""
    figure, axes = plt.subplots(figsize=(5.2, 0.35))
    error = np.linspace(-1.25 * LIMIT_M, 1.25 * LIMIT_M, 500)[None, :]
    axes.imshow(error_picture(10 + error, np.full_like(error, 10.0)), aspect="auto",
                extent=(100 * error[0, 0], 100 * error[0, -1], 0, 1))
    axes.set_yticks([])
    ticks = [100 * x for x in (-LIMIT_M, -LIMIT_M / 2, -WITHIN_M, WITHIN_M, LIMIT_M / 2, LIMIT_M)]
    axes.set_xticks(ticks)
    axes.set_xticklabels(["%+g" % x for x in ticks], fontsize=8)
    axes.set_xlabel("too near   \N{LEFTWARDS ARROW}   error in cm   \N{RIGHTWARDS ARROW}   too far", fontsize=8)
    return encode_figure(figure)
