#!/usr/bin/env python3
"""Writes what the fuzz targets start from into a folder for each: valid inputs (fuzz_messages.cpp and the targets say what
the bytes of a message mean) and copies of former findings in corpus/. Usage: make_seeds.py FOLDER"""
import io
import shutil
import struct
import sys
from pathlib import Path

import PIL.Image

FOLDER = Path(sys.argv[1])
if (FINDINGS := Path(__file__).resolve().parent / "corpus").exists():
    shutil.copytree(FINDINGS, FOLDER, dirs_exist_ok=True)


def seed(target, name, *parts):
    content = b"\n%%\n".join(part.encode() if isinstance(part, str) else part for part in parts)
    (FOLDER / target).mkdir(parents=True, exist_ok=True)
    (FOLDER / target / name).write_bytes(content)


def text(value):
    return bytes([len(value)]) + value.encode()


def vector(code, values):
    return struct.pack(f"<H{len(values)}{code}", len(values), *values)


def picture(kind="PNG", mode="RGB"):
    content = io.BytesIO()
    PIL.Image.new(mode, (8, 6)).save(content, kind)
    return content.getvalue()


# Files.
POSE = "extrinsic\n1 0 0 {}\n0 1 0 0\n0 0 1 0\n0 0 0 1\n\nintrinsic\n9 0 4\n0 9 3\n0 0 1\n\n1 0.1 192 20\n"
seed("mvsnet", "two", "2\n0\n1 1 2.5\n1\n1 0 2.5\n", POSE.format(0), POSE.format(0.1))
CAMERAS = "1 {} 8 6 {}\n"
IMAGES = "1 1 0 0 0 0 0 0 1 00000000.png\n4 3 1 5 2 -1\n2 1 0 0 0 0.1 0 0 1 00000001.png\n4 3 1\n"
POINTS = "1 0 0 2 255 0 0 0.5 1 0 2 0\n"
for model, values in (("PINHOLE", "9 9 4 3"), ("OPENCV", "9 9 4 3 0.1 0.01 0 0"), ("SIMPLE_RADIAL", "9 4 3 0.1"),
                      ("OPENCV_FISHEYE", "9 9 4 3 0.1 0.01 0 0"), ("FULL_OPENCV", "9 9 4 3 0.1 0.01 0 0 0 0 0 0")):
    seed("colmap_text", model.lower(), CAMERAS.format(model, values), IMAGES, POINTS)


def colmap_image(number, tx, features):
    head = struct.pack("<I7dI", number, 1, 0, 0, 0, tx, 0, 0, 1) + b"%08d.png\0" % (number - 1)
    return head + struct.pack("<Q", len(features)) + b"".join(struct.pack("<2dq", *f) for f in features)


for model, values in ((1, [9, 9, 4, 3]), (4, [9, 9, 4, 3, 0.1, 0.01, 0, 0])):
    seed("colmap_binary", f"model_{model}", struct.pack(f"<QIiQQ{len(values)}d", 1, 1, model, 8, 6, *values),
         struct.pack("<Q", 2) + colmap_image(1, 0, [(4, 3, 1), (5, 2, -1)]) + colmap_image(2, 0.1, [(4, 3, 1)]),
         struct.pack("<QQ3d3BdQ4I", 1, 1, 0, 0, 2, 255, 0, 0, 0.5, 2, 1, 0, 2, 0))
seed("camera_list", "two", "# index filename fx fy cx cy width height qw qx qy qz tx ty tz\n"
     "0 a.png 9 9 4 3 8 6 1 0 0 0 0 0 0\n1 b.png 9 9 4 3 8 6 1 0 0 0 0.1 0 0\n")
for name, *kind in (("rgb.png",), ("grey.png", "PNG", "L"), ("grey16.png", "PNG", "I;16"), ("rgb.jpg", "JPEG")):
    seed("image", name, picture(*kind))
seed("float_map", "depth.pfm", b"Pf\n3 2\n-1.0\n" + struct.pack("<6f", *range(6)))
seed("float_map", "normals.pfm", b"PF\n2 1\n-1.0\n" + struct.pack("<6f", *range(6)))
seed("float_map", "depth.dmb", struct.pack("<4i6f", 1, 2, 3, 1, *range(6)))
PLY = "ply\nformat {} 1.0\nelement vertex 2\n" + "".join(f"property float {n}\n" for n in ("x", "y", "z", "nx", "ny", "nz")) + \
    "".join(f"property uchar {n}\n" for n in ("red", "green", "blue")) + \
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
seed("ply", "ascii.ply", PLY.format("ascii") + "0 0 1 0 0 -1 9 8 7\n1 0 1 0 0 -1 9 8 7\n3 0 1 1\n")
seed("ply", "binary.ply", PLY.format("binary_little_endian").encode() +
     struct.pack("<6f3B", 0, 0, 1, 0, 0, -1, 9, 8, 7) * 2 + struct.pack("<B3i", 3, 0, 1, 1))
seed("work_file", "estimate", struct.pack("<3i30f", 3, 2, 0, *range(30)))
seed("work_file", "final_maps", struct.pack("<3i30f18B6f", 3, 2, 1, *range(54)))
seed("output_folder", "complete", "# settings of the run that made this folder\npreset = acmp\n",
     "# bytes and name of each file of the finished run\n3 fused.ply\n", '{"failure": "disk full", "points": 0}\n')
MATRICES = "".join(f"{name}:\n  rows: {rows}\n  cols: {cols}\n  data: {data}\n" for name, rows, cols, data in (
    ("camera_matrix", 3, 3, [9, 0, 4, 0, 9, 3, 0, 0, 1]), ("distortion_coefficients", 1, 5, [0.1, 0, 0, 0, 0]),
    ("rectification_matrix", 3, 3, [1, 0, 0, 0, 1, 0, 0, 0, 1]),
    ("projection_matrix", 3, 4, [9, 0, 4, 0, 0, 9, 3, 0, 0, 0, 1, 0])))
seed("calibration_file", "yaml", f"yimage_width: 8\nimage_height: 6\ncamera_name: a\n{MATRICES}distortion_model: plumb_bob\n")
seed("calibration_file", "ini", "i[image]\n\nwidth\n8\n\nheight\n6\n\n[a]\n\ncamera matrix\n9 0 4\n0 9 3\n0 0 1\n\n"
     "distortion\n0.1 0 0 0 0\n\nrectification\n1 0 0\n0 1 0\n0 0 1\n\nprojection\n9 0 4 0\n0 9 3 0\n0 0 1 0\n")

# Messages: all their fields in order; text() and vector() have lengths of their own.
HEADER = struct.pack("<III", 1, 5, 0) + text("map")
POSE_MESSAGE = struct.pack("<7d", 0.1, 0, 0, 0, 0, 0, 1)


def camera_info(model, coefficients, binning=1, roi=(0, 0, 0, 0), focal=9, cx=4):
    return (HEADER + struct.pack("<II", 6, 8) + text(model) + vector("d", coefficients) +
            struct.pack("<30d", focal, 0, cx, 0, focal, 3, 0, 0, 1, 1, 0, 0, 0, 1, 0, 0, 0, 1,
                        focal, 0, cx, 0, 0, focal, 3, 0, 0, 0, 1, 0) +
            struct.pack("<6IB", binning, binning, *roi, 0))


def image(encoding, row_bytes, width=8, height=6, count=None):
    return (HEADER + struct.pack("<II", height, width) + text(encoding) + struct.pack("<BI", 0, row_bytes) +
            vector("B", [7] * (row_bytes * height if count is None else count)))


def compressed(content):
    return HEADER + text("png") + vector("B", list(content))


def cloud(names, points):
    fields = b"".join(text(name) + struct.pack("<IBI", 4 * i, 7, 1) for i, name in enumerate(names))
    step = 4 * len(names)
    data = b"".join(struct.pack(f"<{len(names)}f", *point) for point in points)
    return (HEADER + struct.pack("<IIH", 1, len(points), len(names)) + fields +
            struct.pack("<BII", 0, step, step * len(points)) + vector("B", list(data)) + b"\1")


XYZ = ["x", "y", "z"]
PACKED = XYZ + ["rgb", "normal_x", "normal_y", "normal_z", "confidence"]
seed("camera_info", "plumb_bob", camera_info("plumb_bob", [0.1, 0, 0, 0, 0], 2, (2, 2, 4, 4)))
seed("camera_info", "rational", camera_info("rational_polynomial", [0.1, 0, 0, 0, 0, 0, 0, 0]))
seed("camera_info", "equidistant", camera_info("equidistant", [0.1, 0, 0, 0]))
seed("camera_info", "wide", camera_info("equidistant", [0, 0, 0, 0], focal=2))
seed("camera_info", "beside_the_image", camera_info("plumb_bob", [0, 0, 0, 0, 0], cx=1e9))
for name, size in (("rgb8", 3), ("mono16", 2), ("bayer_rggb8", 1), ("yuv422", 2), ("bgra8", 4)):
    seed("image_message", name, b"\1" + image(name, 8 * size))
seed("image_message", "rows_that_wrap", b"\1" + image("mono8", 0x55555556, 2, 3, count=2))  # 3 rows: 2 bytes in 32 bits
seed("image_message", "png", b"\0" + compressed(picture()))
seed("mask_message", "mono8", image("mono8", 8))
seed("label_message", "16UC1", image("16UC1", 16))
seed("prior_depth_message", "float", image("32FC1", 32))
seed("prior_depth_message", "thousandths", image("16UC1", 16))
seed("point_cloud", "xyz", cloud(XYZ, [(0, 0, 1), (0, 0, 0), (1, 1, 2)]))
seed("point_cloud", "packed", cloud(PACKED, [(0, 0, 1, 0, 0, 0, -1, 0.5)] * 2))
COVARIANCE = bytes(36 * 8)
for kind, rest in enumerate((POSE_MESSAGE, POSE_MESSAGE + COVARIANCE, text("camera") + POSE_MESSAGE + COVARIANCE,
                             text("camera") + POSE_MESSAGE, struct.pack("<H3fH", 1, 1, 2, 3, 0))):
    seed("pose", str(kind), bytes([kind]) + HEADER + rest)
KEYFRAME = (camera_info("plumb_bob", [0.1, 0, 0, 0, 0]) + POSE_MESSAGE + text("camera") + cloud(XYZ, [(0, 0, 1)] * 2))
seed("keyframe", "raw", (HEADER + image("mono8", 8) + compressed(b"") + KEYFRAME) * 2)
seed("keyframe", "compressed", HEADER + image("", 0, 0, 0) + compressed(picture()) + KEYFRAME)
RIGID = struct.pack("<12d", 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0)


def keyframe_points(number):
    return (HEADER + text("mapper") + struct.pack("<QQQQBQ", number, 1, number, number, 0, 0) + RIGID * 2 +
            camera_info("plumb_bob", [0] * 5) + cloud(PACKED, [(0, 0, 1, 0, 0, 0, -1, 0.5), (1, 0, 2, 0, 0, 0, -1, 0.5)]) +
            compressed(b"") + struct.pack("<Q", number) + RIGID + struct.pack("<d", 1) + RIGID + b"\0" + RIGID +
            text("map") + struct.pack("<d", 0.001))


seed("keyframe_points", "two", keyframe_points(0) + keyframe_points(1) + HEADER + struct.pack("<H", 2) +
     (HEADER + POSE_MESSAGE) * 2)
