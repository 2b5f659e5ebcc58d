#!/usr/bin/env python3
"""Converts the camera calibration of a SLAM frontend to the format of camera_calibration, for calibration_file.

    rosrun acmp_mapping convert_calibration.py euroc_config.yaml > camera.yaml        # VINS-Mono, VINS-Fusion (cam0_calib)
    rosrun acmp_mapping convert_calibration.py camchain.yaml --camera 1 > camera.yaml # Kalibr, OpenVINS; the second camera
    rosrun acmp_mapping convert_calibration.py TUM1.yaml --size 640x480 > camera.yaml # ORB-SLAM2 and 3

The kind of file is told by its keys: VINS (model_type), ORB-SLAM2 and 3 (Camera.fx, Camera1.fx), Kalibr (cam0), OKVIS
(cameras) and EuRoC or Kimera-VIO (intrinsics). Lens models become plumb_bob, rational_polynomial or equidistant; others
(MEI, omni, double sphere, FOV) are refused: rectify those images. Exit code 2: what the file lacks.
"""
import argparse
import re
import sys

import yaml

PLUMB_BOB, RATIONAL, EQUIDISTANT = "plumb_bob", "rational_polynomial", "equidistant"
MODELS = {"radtan": PLUMB_BOB, "radial-tangential": PLUMB_BOB, "radialtangential": PLUMB_BOB, "plumb_bob": PLUMB_BOB,
          "radialtangential8": RATIONAL, "equidistant": EQUIDISTANT, "equi": EQUIDISTANT, "none": None}


class Refused(Exception):
    """The file does not say what is needed; the text names it."""


class Loader(yaml.SafeLoader):
    """YAML as OpenCV writes it: tags such as !!opencv-matrix are read as what they tag."""


def untagged(loader, _suffix, node):
    construct = {yaml.MappingNode: loader.construct_mapping, yaml.SequenceNode: loader.construct_sequence}
    return construct.get(type(node), loader.construct_scalar)(node)


Loader.add_multi_constructor("", untagged)


def read_yaml(text):
    text = re.sub(r"\A\ufeff?%YAML[: ]?1\.\d[^\n]*\n", "", text)  # OpenCV's "%YAML:1.0" is no directive of YAML
    try:
        content = yaml.load(text, Loader)  # a SafeLoader
    except yaml.YAMLError as error:
        raise Refused("is no YAML: %s" % str(error).replace("\n", " "))
    if not isinstance(content, dict):
        raise Refused("has no \"name: value\" lines")
    return content


def value_of(mapping, name, where=""):
    if not isinstance(mapping, dict) or mapping.get(name) is None:
        raise Refused("%s%s is missing" % (where, name))
    return mapping[name]


def number(mapping, name, where="", default=None):
    if default is not None and isinstance(mapping, dict) and mapping.get(name) is None:
        return default
    value = value_of(mapping, name, where)
    try:
        return float(value)
    except (TypeError, ValueError):
        raise Refused("%s%s = %r: must be a number" % (where, name, value))


def numbers(mapping, name, counts, where=""):
    """A list of as many numbers as one of `counts` says."""
    values = value_of(mapping, name, where)
    if not isinstance(values, list) or len(values) not in counts:
        raise Refused("%s%s = %r: must be a list of %s numbers" % (where, name, values, " or ".join(map(str, counts))))
    return [number({name: value}, name, where) for value in values]


def camera(name, size, intrinsics, model, coefficients):
    return {"name": name, "size": size, "intrinsics": intrinsics, "model": model, "coefficients": coefficients}


def padded(coefficients, count):
    return coefficients + [0.0] * (count - len(coefficients))


def from_lens_model(name, size, intrinsics, model, coefficients, where):
    """For files with a name of the model and a list of coefficients."""
    if str(model).lower() not in MODELS:
        raise Refused("%sdistortion model %r: must be one of %s; rectify the images of others" %
                      (where, model, ", ".join(sorted(MODELS))))
    model = MODELS[str(model).lower()]
    if model is None:
        return camera(name, size, intrinsics, PLUMB_BOB, [0.0] * 5)
    counts = {PLUMB_BOB: (4, 5), RATIONAL: (8,), EQUIDISTANT: (4,)}[model]
    if len(coefficients) not in counts:
        raise Refused("%s%d distortion coefficients: %s has %s" %
                      (where, len(coefficients), model, " or ".join(map(str, counts))))
    return camera(name, size, intrinsics, model, padded(coefficients, 5) if model == PLUMB_BOB else coefficients)


def from_vins(content, index):
    only_camera(index)
    kind = str(content["model_type"]).upper()
    size = [number(content, "image_width"), number(content, "image_height")]
    name = str(content.get("camera_name", "camera"))
    parameters, where = value_of(content, "projection_parameters"), "projection_parameters: "
    if kind == "KANNALA_BRANDT":
        intrinsics = [number(parameters, key, where) for key in ("mu", "mv", "u0", "v0")]
        return camera(name, size, intrinsics, EQUIDISTANT, [number(parameters, k, where) for k in ("k2", "k3", "k4", "k5")])
    if kind not in ("PINHOLE", "PINHOLE_FULL"):
        raise Refused("model_type %r: must be PINHOLE, PINHOLE_FULL or KANNALA_BRANDT; rectify the images of others" % kind)
    intrinsics = [number(parameters, key, where) for key in ("fx", "fy", "cx", "cy")]
    keys = ["k1", "k2", "p1", "p2"] + (["k3", "k4", "k5", "k6"] if kind == "PINHOLE_FULL" else [])
    distortion = value_of(content, "distortion_parameters")
    coefficients = [number(distortion, key, "distortion_parameters: ") for key in keys]
    return camera(name, size, intrinsics, RATIONAL if kind == "PINHOLE_FULL" else PLUMB_BOB,
                  coefficients if kind == "PINHOLE_FULL" else padded(coefficients, 5))


def from_orb_slam(content, index):
    prefix = "Camera%d." % (index + 1) if "Camera%d.fx" % (index + 1) in content else "Camera."
    if index > 0 and prefix == "Camera.":
        raise Refused("Camera%d.fx is missing" % (index + 1))
    kind = str(content.get("Camera.type", "PinHole"))
    size = [number(content, "Camera." + side, default=0.0) for side in ("width", "height")]
    intrinsics = [number(content, prefix + key) for key in ("fx", "fy", "cx", "cy")]
    if kind.lower() == "rectified":
        return camera("camera", size, intrinsics, PLUMB_BOB, [0.0] * 5)
    if kind == "KannalaBrandt8":
        return camera("camera", size, intrinsics, EQUIDISTANT, [number(content, prefix + k) for k in ("k1", "k2", "k3", "k4")])
    if kind.lower() != "pinhole":
        raise Refused("Camera.type %r: must be PinHole, Rectified or KannalaBrandt8" % kind)
    # ORB-SLAM takes those that are missing for 0.
    coefficients = [number(content, prefix + key, default=0.0) for key in ("k1", "k2", "p1", "p2", "k3")]
    return camera("camera", size, intrinsics, PLUMB_BOB, coefficients)


def from_kalibr(content, index):
    name = "cam%d" % index
    chain, where = value_of(content, name), name + ": "
    if value_of(chain, "camera_model", where) != "pinhole":
        raise Refused("%scamera_model %r: must be pinhole; rectify the images of others" % (where, chain["camera_model"]))
    model = value_of(chain, "distortion_model", where)
    coefficients = [] if str(model).lower() == "none" else numbers(chain, "distortion_coeffs", (4, 5, 8), where)
    return from_lens_model(name, numbers(chain, "resolution", (2,), where), numbers(chain, "intrinsics", (4,), where), model,
                           coefficients, where)


def from_okvis(content, index):
    cameras = content["cameras"]
    if not isinstance(cameras, list) or index >= len(cameras):
        raise Refused("cameras: there is no camera %d" % index)
    entry, where = cameras[index], "cameras[%d]: " % index
    intrinsics = numbers(entry, "focal_length", (2,), where) + numbers(entry, "principal_point", (2,), where)
    return from_lens_model("cam%d" % index, numbers(entry, "image_dimension", (2,), where), intrinsics,
                           value_of(entry, "distortion_type", where),
                           numbers(entry, "distortion_coefficients", (4, 5, 8), where), where)


def from_euroc(content, index):
    only_camera(index)
    return from_lens_model(str(content.get("camera_id", "camera")), numbers(content, "resolution", (2,)),
                           numbers(content, "intrinsics", (4,)), value_of(content, "distortion_model"),
                           numbers(content, "distortion_coefficients", (4, 5, 8)), "")


def only_camera(index):
    if index > 0:
        raise Refused("is of one camera: there is no camera %d" % index)


def convert(text, index=0, size=None):
    """The camera `index` (from 0) of a file; `size` [width, height] in px takes the place of the file's. Raises Refused."""
    content = read_yaml(text)
    if "model_type" in content:
        result = from_vins(content, index)
    elif "Camera.fx" in content or "Camera1.fx" in content:
        result = from_orb_slam(content, index)
    elif any(re.fullmatch(r"cam\d+", str(key)) for key in content):
        result = from_kalibr(content, index)
    elif "cameras" in content:
        result = from_okvis(content, index)
    elif "intrinsics" in content:
        result = from_euroc(content, index)
    elif "camera_matrix" in content:
        raise Refused("is in the format of camera_calibration already: give it as it is")
    elif "cam%d_calib" % index in content:
        raise Refused("names the camera's own file: convert %s" % content["cam%d_calib" % index])
    else:
        raise Refused("is of no known kind: there is no model_type (VINS), Camera.fx or Camera1.fx (ORB-SLAM), cam0 "
                      "(Kalibr), cameras (OKVIS) or intrinsics (EuRoC)")
    if size:
        result["size"] = size
    check(result)
    return result


def check(result):
    fx, fy, cx, cy = result["intrinsics"]
    width, height = result["size"]
    if width < 1 or height < 1 or width != int(width) or height != int(height):
        raise Refused("image size %g x %g: must be whole numbers above 0; give --size" % (width, height))
    if not (fx > 0 and fy > 0):
        raise Refused("focal length %g, %g: must be above 0" % (fx, fy))
    if not (0 <= cx < width and 0 <= cy < height):
        raise Refused("principal point (%g, %g): is outside of the image of %d x %d" % (cx, cy, width, height))


def shortest(value):
    """All digits, and a point: "1e-05" is text to YAML 1.1."""
    text = repr(float(value))
    return text if "." in text else text.replace("e", ".0e")


def matrix(name, rows, values):
    return "%s:\n  rows: %d\n  cols: %d\n  data: [%s]\n" % (name, rows, len(values) // rows,
                                                        ", ".join(shortest(value) for value in values))


def format_calibration(result):
    fx, fy, cx, cy = result["intrinsics"]
    return ("image_width: %d\nimage_height: %d\ncamera_name: %s\n" %
            (*result["size"], re.sub(r"\W", "_", result["name"])) +
            matrix("camera_matrix", 3, [fx, 0, cx, 0, fy, cy, 0, 0, 1]) +
            "distortion_model: %s\n" % result["model"] +
            matrix("distortion_coefficients", 1, result["coefficients"]) +
            matrix("rectification_matrix", 3, [1, 0, 0, 0, 1, 0, 0, 0, 1]) +
            matrix("projection_matrix", 3, [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0]))


def parse_size(text):
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    if not match:
        raise argparse.ArgumentTypeError("%s: must be WIDTHxHEIGHT in px" % text)
    return [float(match.group(1)), float(match.group(2))]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("--camera", type=int, default=0, help="of a file with several, from 0")
    parser.add_argument("--size", type=parse_size, help="WIDTHxHEIGHT in px, where the file does not say it")
    options = parser.parse_args()
    if options.camera < 0:
        parser.error("--camera %d: must be 0 or more" % options.camera)
    try:
        with open(options.file, encoding="utf-8") as file:
            print(format_calibration(convert(file.read(), options.camera, options.size)), end="")
    except (Refused, OSError, UnicodeDecodeError) as error:
        print("%s: %s" % (options.file, error), file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
