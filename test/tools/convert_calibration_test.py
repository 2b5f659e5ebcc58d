#!/usr/bin/python3
"""Calibrations that scripts/convert_calibration.py reads and writes.

usage: convert_calibration_test.py SOURCE_FOLDER"""
import json
import math
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import yaml

SOURCE = Path(sys.argv.pop(1)).absolute()
SCRIPT = SOURCE / "scripts/convert_calibration.py"
sys.dont_write_bytecode = True
sys.path.insert(0, str(SCRIPT.parent))
import convert_calibration

K = [458.654, 457.296, 367.215, 248.375]
RADTAN = [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
OTHER_K = [190.5, 191.5, 254.5, 256.5]
PINHOLE, DISTORTION = dict(zip(("fx", "fy", "cx", "cy"), K)), dict(zip(("k1", "k2", "p1", "p2"), RADTAN))
OTHER = dict(zip(("fx", "fy", "cx", "cy"), OTHER_K))


def lines(prefix, suffix="", **values):
    return "".join(f"{prefix}{name}{suffix}: {value}\n" for name, value in values.items())


VINS = """%YAML:1.0
---
model_type: PINHOLE
camera_name: camera
image_width: 752
image_height: 480
distortion_parameters: {k1: -0.28340811, k2: 0.07395907, p1: 0.00019359, p2: 1.76187114e-05}
projection_parameters: {fx: 458.654, fy: 457.296, cx: 367.215, cy: 248.375}
#Rotation from camera frame to imu frame, imu^R_cam
extrinsicRotation: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [0, -1, 0, 1, 0, 0, 0, 0, 1]
"""
VINS_FULL = VINS.replace("PINHOLE", "PINHOLE_FULL").replace("p1:", "k3: 3, k4: 4, k5: 5, k6: 6, p1:")
VINS_FISHEYE = "%YAML:1.0\n---\n" + lines("", model_type="KANNALA_BRANDT", camera_name="cam0", image_width=512, image_height=512) + \
    "projection_parameters:\n" + lines("   ", k2=0.01, k3=0.02, k4=0.03, k5=0.04, mu=190.5, mv=191.5, u0=254.5, v0=256.5)
ORB_SLAM3 = "%YAML:1.0\n#------------------\nFile.version: \"1.0\"\nCamera.type: \"PinHole\"\n" + lines(
    "Camera1.", **PINHOLE, **DISTORTION) + lines("Camera2.", **OTHER) + lines(
        "Camera.", width=752, height=480, newWidth=600, newHeight=350) + \
    "IMU.T_b_c1: !!opencv-matrix\n   rows: 1\n   cols: 1\n   dt: f\n   data: [1.0]\n"
ORB_SLAM3_FISHEYE = "%YAML:1.0\nCamera.type: KannalaBrandt8\n" + lines("Camera.", k1=0.01, k2=0.02, k3=0.03, k4=0.04, width=512,
                                                                       height=512, **OTHER)
ORB_SLAM2 = "%YAML:1.0\n" + lines("Camera.", **OTHER, k1=0.262383, k2=-0.953104, p1=-0.005358, p2=0.002628, k3=1.163314, fps=30.0)

KALIBR = """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
  distortion_model: radtan
  intrinsics: [458.654, 457.296, 367.215, 248.375]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.1]
  camera_model: pinhole
  distortion_coeffs: [0.01, 0.02, 0.03, 0.04]
  distortion_model: equidistant
  intrinsics: [190.5, 191.5, 254.5, 256.5]
  resolution: [512, 512]
"""
OKVIS = """%YAML:1.0
cameras:
     - {T_SC:
        [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
        image_dimension: [752, 480],
        distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05],
        distortion_type: radialtangential,
        focal_length: [458.654, 457.296],
        principal_point: [367.215, 248.375]}
"""
EUROC = """sensor_type: camera
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
"""
STELLA = "# stella_vslam\nCamera:\n" + lines("  ", name='"EuRoC"', setup='"monocular"', model='"perspective"', **PINHOLE, **DISTORTION,
                                            k3=0.0, cols=752, rows=480) + "Feature:\n  max_num_keypoints: 1000\n"
OV2SLAM = "%YAML 1.0\n---\n" + lines(
    "Camera.", topic_left="/cam0/image_raw", model_left="pinhole", model_right="fisheye", left_nwidth=752, left_nheight=480,
    right_nwidth=512, right_nheight=512) + lines("Camera.", "l", **PINHOLE, **DISTORTION) + lines(
        "Camera.", "r", **OTHER, k1=0.01, k2=0.02, p1=0.03, p2=0.04) + "dop3p : 0\n"
SVO = "cam_model: Pinhole\n" + lines("cam_", width=752, height=480, **PINHOLE, **{f"d{i}": d for i, d in enumerate(RADTAN)})

RIG = """label: "rig"
cameras:
- camera:
    label: cam0
    image_height: 480
    image_width: 752
    type: pinhole
    intrinsics: {cols: 1, rows: 4, data: [458.654, 457.296, 367.215, 248.375]}
    distortion:
      type: radial-tangential
      parameters: {cols: 1, rows: 4, data: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]}
"""
MAPLAB = "sensors:\n - sensor_type: IMU\n - sensor_type: NCAMERA\n   " + RIG.split("\n", 1)[1].replace("\n", "\n   ")

OPENCV = """%YAML:1.0
---
calibration_time: "Tue 01 Jan 2019 12:00:00"
image_width: 752
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 458.654, 0., 367.215, 0., 457.296,
       248.375, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0. ]
flags: 0
"""
OPENCV_XML = """<?xml version="1.0"?>
<opencv_storage>
<calibration_time>"Tue 01 Jan 2019"</calibration_time>
<image_Width>752</image_Width>
<image_Height>480</image_Height>
<Camera_Matrix type_id="opencv-matrix">
  <rows>3</rows> <cols>3</cols> <dt>d</dt>
  <data>458.654 0. 367.215 0. 457.296
    248.375 0. 0. 1.</data></Camera_Matrix>
<Distortion_Coefficients type_id="opencv-matrix">
  <rows>5</rows> <cols>1</cols> <dt>d</dt>
  <data>-0.28340811 0.07395907 0.00019359 1.76187114e-05 0.</data></Distortion_Coefficients>
</opencv_storage>
"""
ROVIO = """###### Camera Calibration File For Cam 0 ######
image_width: 752
image_height: 480
camera_name: cam0
camera_matrix: {rows: 3, cols: 3, data: [458.654, 0.0, 367.215, 0.0, 457.296, 248.375, 0.0, 0.0, 1.0]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0.0]}
"""

ZED = "[LEFT_CAM_2K]\nfx=1400\nfy=1400\ncx=1104\ncy=600\n\n[RIGHT_CAM_2K]\nfx=1400\n\n[LEFT_CAM_HD]\nfx=700\nfy = 701\ncx=640\n" \
    "cy=350\nk1=-0.17\nk2=0.03\np1=1e-4\np2=2e-4\nk3=3e-11\n[RIGHT_CAM_HD]\nfx=710\nfy=701\ncx=640\ncy=350\n[STEREO]\nBaseline=119.978\n"


def basalt(kind, **parameters):
    """A calibration.json as basalt writes it; the camera is the second of two."""
    cameras = [{"camera_type": "pinhole", "intrinsics": OTHER}, {"camera_type": kind, "intrinsics": {**PINHOLE, **parameters}}]
    pose = dict.fromkeys(("px", "py", "pz", "qx", "qy", "qz", "qw"), 0.1)
    return json.dumps({"value0": {"T_imu_cam": [pose, pose], "intrinsics": cameras,
                                  "resolution": [[320, 240], [752, 480]], "vignette": []}}, indent=4)


def converted(text, *arguments):
    return yaml.safe_load(convert_calibration.format_calibration(convert_calibration.convert(text, *arguments)))


def refusal(text, *arguments):
    try:
        convert_calibration.convert(text, *arguments)
    except convert_calibration.Refused as error:
        return str(error)
    return "not refused"


class ConvertCalibration(unittest.TestCase):
    def expect(self, result, size, intrinsics, model, coefficients):
        fx, fy, cx, cy = intrinsics
        self.assertEqual([result["image_width"], result["image_height"]], size)
        self.assertEqual(result["camera_matrix"], {"rows": 3, "cols": 3, "data": [fx, 0, cx, 0, fy, cy, 0, 0, 1]})
        self.assertEqual(result["projection_matrix"],
                         {"rows": 3, "cols": 4, "data": [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0]})
        self.assertEqual(result["distortion_model"], model)
        self.assertEqual(result["distortion_coefficients"], {"rows": 1, "cols": len(coefficients), "data": coefficients})

    def test_pinhole_cameras_of_every_kind(self):
        for text in (VINS, ORB_SLAM3, KALIBR, OKVIS, EUROC, STELLA, OV2SLAM, SVO, "cam0:\n  " + SVO.replace("\n", "\n  "), RIG,
                     MAPLAB, OPENCV, OPENCV_XML, ROVIO):
            with self.subTest(text[:80]):
                self.expect(converted(text), [752, 480], K, "plumb_bob", RADTAN + [0])

    def test_fisheye_cameras(self):
        for text, index in ((VINS_FISHEYE, 0), (ORB_SLAM3_FISHEYE, 0), (KALIBR, 1), (OV2SLAM, 1)):
            self.expect(converted(text, index), [512, 512], OTHER_K, "equidistant", [0.01, 0.02, 0.03, 0.04])
        fisheye = STELLA.replace("perspective", "fisheye").replace("p1:", "k4:")
        self.expect(converted(fisheye), [752, 480], K, "equidistant", [RADTAN[0], RADTAN[1], 0, RADTAN[2]])
        flat = "".join("Camera." + line.strip() + "\n" for line in fisheye.split("\n")[2:-3])
        self.expect(converted(flat), [752, 480], K, "equidistant", [RADTAN[0], RADTAN[1], 0, RADTAN[2]])
        for text in OPENCV + "fisheye_model: 1\n", ROVIO.replace("plumb_bob", "KannalaBrandt8"):
            self.expect(converted(text), [752, 480], K, "equidistant", RADTAN)

    def test_yaml_as_opencv_reads_it(self):
        text = ORB_SLAM3.replace("Camera.width: 752", "Camera.width:\t752\t# px")
        text = "# my camera\n" + text.replace("Camera.height: 480", "Camera.height:480") + "Viewer.PointSize:2\nmap: { x:1, y:2 }\n"
        for data in text.encode(), b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode(), \
                text.replace("my camera", "\u76f8\u673a\u53c2\u6570").encode("gbk"), \
                text.replace("my camera", "\u00e4\u0085 caf\u00e9").encode("latin-1"):
            self.expect(converted(convert_calibration.read_text(data)), [752, 480], K, "plumb_bob", RADTAN + [0])

    def test_coefficients_that_are_zero(self):
        for zeros in "0, 0", "0, 0, 0, 0":
            self.expect(converted(EUROC.replace("e-05]", "e-05, %s]" % zeros)), [752, 480], K, "plumb_bob", RADTAN + [0])
        full = ROVIO.replace("plumb_bob", "rational_polynomial")
        self.expect(converted(full), [752, 480], K, "rational_polynomial", RADTAN + [0] * 4)
        for zeros in "0, 0, 0, 0, 0, 0, 0", "0, 0, 0, 0, 0, 0, 0, 0, 0":
            self.expect(converted(full.replace("05, 0.0]", "05, 0.0, %s]" % zeros)), [752, 480], K, "rational_polynomial",
                        RADTAN + [0] * 4)
        self.assertIn("thin prism", refusal(full.replace("05, 0.0]", "05, 0, 0, 0, 0, 0.1, 0, 0, 0]")))

    def test_other_models(self):
        self.expect(converted(VINS_FULL), [752, 480], K, "rational_polynomial", RADTAN + [3, 4, 5, 6])
        self.expect(converted(KALIBR.replace("radtan", "none")), [752, 480], K, "plumb_bob", [0] * 5)
        self.expect(converted(ORB_SLAM3.replace("PinHole", "Rectified")), [752, 480], K, "plumb_bob", [0] * 5)
        self.expect(converted(ORB_SLAM3, 1), [752, 480], OTHER_K, "plumb_bob", [0] * 5)

    def test_omnidirectional(self):
        names = (("fx:", "gamma1:"), ("fy:", "gamma2:"), ("cx:", "u0:"), ("cy:", "v0:"), ("PINHOLE", "MEI"),
                 ("projection_parameters:", "mirror_parameters:\n   xi: 1.9\nprojection_parameters:"))
        mei = VINS
        for old, new in names:
            mei = mei.replace(old, new)
        self.expect(converted(mei), [752, 480], K, "mei", [1.9] + RADTAN)
        omni = KALIBR.replace("camera_model: pinhole", "camera_model: omni", 1).replace("[458.654", "[1.9, 458.654", 1)
        self.expect(converted(omni), [752, 480], K, "mei", [1.9] + RADTAN)
        self.assertIn("must be radtan", refusal(omni.replace("radtan", "equidistant", 1)))
        self.assertIn("must be a list of 4 numbers", refusal(omni.replace("e-05]", "e-05, 0.1]", 1)))
        self.expect(converted(omni.replace("radtan", "none", 1)), [752, 480], K, "mei", [1.9, 0, 0, 0, 0])

    def test_double_sphere_and_eucm(self):
        plain = KALIBR.replace("radtan", "none", 1).replace("[458.654", "[0.6, 1.1, 458.654", 1)
        for kind, model in (("ds", "double_sphere"), ("eucm", "eucm")):
            text = plain.replace("camera_model: pinhole", "camera_model: " + kind, 1)
            self.expect(converted(text), [752, 480], K, model, [0.6, 1.1])
            self.assertIn("must be none", refusal(text.replace("distortion_model: none", "distortion_model: radtan", 1)))
        for kind, names, model, coefficients in (
                ("ds", ("xi", "alpha"), "double_sphere", [0.25, 0.5]), ("eucm", ("alpha", "beta"), "eucm", [0.25, 0.5]),
                ("ucm", ("alpha",), "eucm", [0.25, 1]), ("pinhole", (), "plumb_bob", [0] * 5),
                ("kb4", ("k1", "k2", "k3", "k4"), "equidistant", [0.25, 0.5, 0.75, 1])):
            text = basalt(kind, **{name: 0.25 * (i + 1) for i, name in enumerate(names)})
            self.expect(converted(text, 1), [752, 480], K, model, coefficients)
        self.assertIn("there is no camera 2", refusal(text, 2))
        self.assertIn("intrinsics[1]: k2 is missing", refusal(text.replace('"k2"', '"other"'), 1))
        self.assertIn("camera_type 'fov'", refusal(basalt("fov", w=1), 1))

    def test_a_sphere_needs_its_size_alone(self):
        sphere = "Camera:\n  model: equirectangular\n  cols: 1920\n  rows: 960\n"
        self.expect(converted(sphere), [1920, 960], [960 / math.pi, 960 / math.pi, 960, 480], "equirectangular", [])
        self.assertIn("no camera 1", refusal(sphere, 1))

    def test_size_that_the_file_lacks(self):
        self.assertIn("image size 0 x 0", refusal(ORB_SLAM2))
        self.expect(converted(ORB_SLAM2, 0, [640, 480]), [640, 480], OTHER_K, "plumb_bob", [0.262383, -0.953104, -0.005358, 0.002628, 1.163314])

    def test_what_the_mapper_takes_itself_is_refused(self):
        for text in ((SOURCE / "config/camera.yaml").read_text(), "# oST version 5.0 parameters\n[image]\n\nwidth\n640\n",
                     "height: 480\nwidth: 752\nD: [0.0]\nK: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]\n"):
            self.assertIn("calibration_file takes it as it is", refusal(text))

    def test_factory_calibration_of_a_zed(self):
        self.assertIn("2208x1242, 1280x720", refusal(ZED))
        self.expect(converted(ZED, 0, [1280, 720]), [1280, 720], [700, 701, 640, 350], "rational_polynomial",
                    [-0.17, 0.03, 1e-4, 2e-4, 3e-11, 0, 0, 0])
        self.assertEqual(converted(ZED, 1, [1280, 720])["camera_matrix"]["data"][0], 710)
        self.assertIn("--size", refusal(ZED, 0, [640, 480]))

    def test_eight_coefficients_are_of_the_rational_model(self):
        eight = ROVIO.replace("05, 0.0]", "05, 0.0, 0.4, 0.5, 0.6]")
        self.expect(converted(eight), [752, 480], K, "rational_polynomial", RADTAN + [0, 0.4, 0.5, 0.6])

    def test_what_is_refused(self):
        for text, words in (
                (VINS.replace("PINHOLE", "SCARAMUZZA").replace("projection_p", "poly_p"), "'SCARAMUZZA'"),
                (VINS.replace("fx: 458.654, ", ""), "projection_parameters: fx is missing"),
                (VINS.replace("458.654", "large"), "fx = 'large': must be a number"),
                (VINS.replace("image_width: 752", "image_width: 300"), "principal point (367.215, 248.375)"),
                (KALIBR.replace("camera_model: pinhole", "camera_model: ds"), "distortion_model 'radtan' of camera_model ds"),
                (KALIBR.replace("camera_model: pinhole", "camera_model: omni"), "must be a list of 5 numbers"),
                (KALIBR.replace("[-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]", "[1, 2, 3, 4, 5, 6, 7]"),
                 "7 distortion coefficients"),
                (KALIBR.replace("458.654", ".nan"), "intrinsics = nan: must be a number"),
                ("image_width: 3\ncamera_matrix: 1\n", "camera_matrix = 1: must be a list of 9 numbers"),
                ("cam0_calib: \"cam0_pinhole.yaml\"\n", "convert cam0_pinhole.yaml"),
                (ROVIO.replace("367.215, 0.0", "367.215, 0.5"), "must be fx 0 cx"),
                (ROVIO.replace("distortion_c", "c"), "distortion_coefficients is missing"),
                (RIG.replace("radial-tangential", "fisheye-fov"), "distortion model 'fisheye-fov'"),
                (OPENCV_XML.replace("</data>", ""), "is no XML"),
                ("sensors: 3\n", "sensors = 3: must be a list"), ("cameras: [3]\n", "cameras[0]: image_dimension is missing"),
                (MAPLAB.replace("cameras:", "cameras: 3\nothers:"), "cameras = 3: must be a list"),
                (basalt("ds").replace("[\n                320", "[\n                [320, 1]"), "must be a list of 4 numbers"),
                (VINS.replace("752", "1" + 400 * "0"), "must be a number"),
                ("a: 1\n", "no known kind"), ("", "name: value"), ("a: [1\n", "no YAML")):
            with self.subTest(words):
                self.assertIn(words, refusal(text))
        self.assertIn("no camera 1", refusal(VINS, 1))
        self.assertIn("cam2 is missing", refusal(KALIBR, 2))
        self.assertIn("Camera2.fx is missing", refusal(ORB_SLAM2, 1))

    def test_command(self):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "camchain.yaml")
            path.write_text(KALIBR)
            for arguments, code, out, err in (([path, "--camera", "1"], 0, "camera_name: cam1\n", ""),
                                              ([path, "--camera", "7"], 2, "", f"{path}: cam7 is missing"),
                                              ([path, "--camera", "-1"], 2, "", "must be 0 or more"),
                                              ([f"{folder}/none.yaml"], 2, "", "No such file"),
                                              ([path, "--size", "big"], 2, "", "big: must be WIDTHxHEIGHT")):
                result = subprocess.run([sys.executable, SCRIPT, *arguments], capture_output=True, text=True, check=False)
                self.assertEqual((result.returncode, bool(result.stdout), bool(result.stderr)), (code, bool(out), bool(err)))
                self.assertIn(out, result.stdout)
                self.assertIn(err, result.stderr)

    def test_bombs_and_what_never_ends_are_refused(self):
        bomb = "a: &a [1, 1]\n" + "".join(f"{chr(98 + i)}: &{chr(98 + i)} [*{chr(97 + i)}, *{chr(97 + i)}]\n" for i in range(20))
        with tempfile.TemporaryDirectory() as folder:
            paths = [Path(folder, name) for name in ("bomb", "digits", "nested", "large", "pipe")]
            paths[0].write_text(bomb + KALIBR)
            paths[1].write_text(KALIBR + "x: " + "9" * 100000)
            paths[2].write_text(KALIBR + "x: " + "[" * 100000)
            with open(paths[3], "wb") as file:
                file.truncate(3 << 30)
            os.mkfifo(paths[4])
            for path, word in zip([*paths, "/dev/zero"], ("alias", "digits", "is no YAML", "at most", "pipe", "pipe")):
                done = subprocess.run([sys.executable, str(SCRIPT), str(path)], capture_output=True, text=True, check=False,
                                      timeout=60)
                with self.subTest(path):
                    self.assertEqual(done.returncode, 2, done.stderr)
                    self.assertIn(word, done.stderr)

    def test_template_is_what_is_written(self):
        template = yaml.safe_load((SOURCE / "config/camera.yaml").read_text())
        written = converted(EUROC)
        self.assertEqual(set(template), set(written))
        for key in set(written) - {"camera_name"}:
            self.assertEqual(template[key], written[key], key)


if __name__ == "__main__":
    unittest.main(verbosity=2)
