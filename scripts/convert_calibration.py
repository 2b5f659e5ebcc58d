#!/usr/bin/env python3
"""Converts the camera calibration of a SLAM frontend to the format of camera_calibration, for calibration_file.

    rosrun acmp_mapping convert_calibration.py euroc_config.yaml > camera.yaml        # VINS-Mono, VINS-Fusion (cam0_calib)
    rosrun acmp_mapping convert_calibration.py camchain.yaml --camera 1 > camera.yaml # Kalibr, OpenVINS; the second camera
    rosrun acmp_mapping convert_calibration.py TUM1.yaml --size 640x480 > camera.yaml # ORB-SLAM2 and 3

The kind of file is told by its keys: VINS (model_type), ORB-SLAM2 and 3 and stella_vslam (Camera.fx, Camera1.fx, Camera),
OV2SLAM (Camera.fxl), Kalibr (cam0), SVO (cam_model), OKVIS, SVO and maplab (cameras, sensors), EuRoC or Kimera-VIO
(intrinsics), basalt (value0), and OpenCV, ROVIO or camera_calibration (camera_matrix; as XML, too). Lens models become
plumb_bob, rational_polynomial, equidistant, mei (of VINS' MEI and Kalibr's omni: D is xi k1 k2 p1 p2), double_sphere
(xi alpha), eucm (alpha beta; UCM is that with beta 1) or equirectangular; others (FOV) are refused: rectify those images.
Exit code 2: what the file lacks.
"""
import argparse
import math
import re
import sys
import xml.etree.ElementTree

import yaml

PLUMB_BOB, RATIONAL, EQUIDISTANT, MEI = "plumb_bob", "rational_polynomial", "equidistant", "mei"
EQUIRECTANGULAR = "equirectangular"
DOUBLE_SPHERE, EUCM = "double_sphere", "eucm"
# By name, in small letters and digits alone.
MODELS = {"radtan": PLUMB_BOB, "radialtangential": PLUMB_BOB, "plumbbob": PLUMB_BOB, "brownconrady": PLUMB_BOB,
          "radialtangential8": RATIONAL, "rationalpolynomial": RATIONAL, "equidistant": EQUIDISTANT, "equi": EQUIDISTANT,
          "fisheye": EQUIDISTANT, "kannalabrandt": EQUIDISTANT, "kannalabrandt4": EQUIDISTANT,
          "kannalabrandt8": EQUIDISTANT, "none": None}
COUNTS = {PLUMB_BOB: (4, 5), RATIONAL: (8, 8), EQUIDISTANT: (4, 4)}  # least and most coefficients
PINHOLES = ("pinhole", "perspective")


class Refused(Exception):
    """The file does not say what is needed; the text names it."""


class Loader(yaml.SafeLoader):
    """YAML as OpenCV writes it: tags such as !!opencv-matrix are read as what they tag."""


def untagged(loader, _suffix, node):
    construct = {yaml.MappingNode: loader.construct_mapping, yaml.SequenceNode: loader.construct_sequence}
    return construct.get(type(node), loader.construct_scalar)(node)


Loader.add_multi_constructor("", untagged)


def read_text(data):
    """Comments may be in any encoding: what is no UTF-8 is replaced, names and numbers are ASCII."""
    return data.decode("utf-8", errors="replace").lstrip("\ufeff")


def read_xml(text):
    """A file of OpenCV's FileStorage; names and numbers as YAML would have them."""
    def value(element):
        content = {child.tag: value(child) for child in element}
        if not content:
            words = (element.text or "").split()
            return words[0].strip('"') if len(words) == 1 else words
        if element.get("type_id") == "opencv-matrix" and isinstance(content.get("data"), str):
            content["data"] = [content["data"]]
        return content
    try:
        return value(xml.etree.ElementTree.fromstring(text))
    except xml.etree.ElementTree.ParseError as error:
        raise Refused("is no XML: %s" % error)


def read_content(text):
    """YAML, also as OpenCV reads it: text before "%YAML:1.0" (which is no directive of YAML), tabs, and no space after a
    colon."""
    if re.search(r"^\[image\]\s*$", text, re.MULTILINE):
        raise Refused("is an INI of camera_calibration: calibration_file takes it as it is")
    if re.match(r"\s*<", text):
        content = read_xml(text)
    else:
        text = re.sub(r"\A(?:[^\n]*\n){0,20}?%YAML[^\n]*\n", "", text.replace("\r\n", "\n").replace("\r", "\n"))
        text = text.replace("\t", " ")
        text = re.sub(r"^([ -]*[A-Za-z_][\w.]*):(?=[^\s:])", r"\1: ", text, flags=re.MULTILINE)
        text = re.sub(r"([{,]\s*[A-Za-z_][\w.]*):(?=[^\s:])", r"\1: ", text)
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


def flattened(values):
    """Of lists in lists, or of a matrix with rows, cols and data."""
    if isinstance(values, dict):
        values = values.get("data")
    if not isinstance(values, list):
        return [values]
    return [number for value in values for number in flattened(value)]


def numbers(mapping, name, count=None, where=""):
    """A list of `count` numbers, or of any number of them."""
    values = value_of(mapping, name, where)
    found = flattened(values) if isinstance(values, (dict, list)) else []
    if not isinstance(values, (dict, list)) or (count is not None and len(found) != count):
        raise Refused("%s%s = %r: must be a list of %snumbers" % (where, name, values, "%d " % count if count else ""))
    return [number({name: value}, name, where) for value in found]


def camera(name, size, intrinsics, model, coefficients):
    return {"name": name, "size": size, "intrinsics": intrinsics, "model": model, "coefficients": coefficients}


def plain(name):
    """In small letters and digits alone."""
    return re.sub(r"[^a-z0-9]", "", str(name).lower())


def is_pinhole(name):
    return str(name).lower() in PINHOLES


def from_lens_model(name, size, intrinsics, model, coefficients, where):
    """For files with a name of the model and a list of coefficients: those that are missing or too many must be 0."""
    key = plain(model)
    if key not in MODELS:
        raise Refused("%sdistortion model %r: must be one of %s; rectify the images of others" %
                      (where, model, ", ".join(sorted(MODELS))))
    known = MODELS[key]
    if known is None:
        if any(coefficients):
            raise Refused("%sdistortion model %r has coefficients that are not 0: %r" % (where, model, coefficients))
        return camera(name, size, intrinsics, PLUMB_BOB, [0.0] * 5)
    least, most = COUNTS[known]
    if len(coefficients) < least and any(coefficients) and not (known == RATIONAL and len(coefficients) in (4, 5)):
        raise Refused("%s%d distortion coefficients: %s has %d" % (where, len(coefficients), known, most))
    if any(coefficients[most:]):
        raise Refused("%s%d distortion coefficients: %s has %d, and those after them are not 0 (k4 to k6, thin prism or "
                      "tilt); rectify the images" % (where, len(coefficients), known, most))
    return camera(name, size, intrinsics, known, (coefficients + [0.0] * most)[:most])


def from_vins(content, index):
    only_camera(index)
    kind = str(content["model_type"]).upper()
    if kind not in ("PINHOLE", "PINHOLE_FULL", "KANNALA_BRANDT", "MEI"):
        raise Refused("model_type %r: must be PINHOLE, PINHOLE_FULL, KANNALA_BRANDT or MEI; rectify the images of others" % kind)
    size = [number(content, "image_width"), number(content, "image_height")]
    name = str(content.get("camera_name", "camera"))
    parameters, where = value_of(content, "projection_parameters"), "projection_parameters: "
    if kind == "KANNALA_BRANDT":
        intrinsics = [number(parameters, key, where) for key in ("mu", "mv", "u0", "v0")]
        return camera(name, size, intrinsics, EQUIDISTANT, [number(parameters, k, where) for k in ("k2", "k3", "k4", "k5")])
    keys = ["k1", "k2", "p1", "p2"] + (["k3", "k4", "k5", "k6"] if kind == "PINHOLE_FULL" else [])
    distortion = value_of(content, "distortion_parameters")
    coefficients = [number(distortion, key, "distortion_parameters: ") for key in keys]
    if kind == "MEI":
        intrinsics = [number(parameters, key, where) for key in ("gamma1", "gamma2", "u0", "v0")]
        xi = number(value_of(content, "mirror_parameters"), "xi", "mirror_parameters: ")
        return camera(name, size, intrinsics, MEI, [xi] + coefficients)
    intrinsics = [number(parameters, key, where) for key in ("fx", "fy", "cx", "cy")]
    return from_lens_model(name, size, intrinsics, RATIONAL if kind == "PINHOLE_FULL" else PLUMB_BOB, coefficients, "")


def from_orb_slam(content, index):
    """ORB-SLAM and stella_vslam: `content` has names such as Camera.fx."""
    prefix = "Camera%d." % (index + 1) if "Camera%d.fx" % (index + 1) in content else "Camera."
    if index > 0 and prefix == "Camera.":
        raise Refused("Camera%d.fx is missing" % (index + 1))
    key = "Camera.type" if "Camera.type" in content else "Camera.model"
    kind = str(content.get(key, "PinHole"))
    rectified, fisheye = kind.lower() == "rectified", kind.lower() in ("fisheye", "kannalabrandt8")
    sphere = kind.lower() == "equirectangular"
    if not (rectified or fisheye or sphere or is_pinhole(kind)):
        raise Refused("%s %r: must be PinHole, perspective, Rectified, fisheye, KannalaBrandt8 or equirectangular; rectify "
                      "the images of others" % (key, kind))
    size = [number(content, "Camera." + side, default=number(content, "Camera." + other, default=0.0))
            for side, other in (("width", "cols"), ("height", "rows"))]
    if sphere:  # the size alone tells the camera: pixels per radian
        focal_length = size[0] / (2 * math.pi)
        return camera("camera", size, [focal_length, focal_length, size[0] / 2, size[1] / 2], EQUIRECTANGULAR, [])
    intrinsics = [number(content, prefix + name) for name in ("fx", "fy", "cx", "cy")]
    if rectified:
        return camera("camera", size, intrinsics, PLUMB_BOB, [0.0] * 5)
    if fisheye:
        return camera("camera", size, intrinsics, EQUIDISTANT, [number(content, prefix + k) for k in ("k1", "k2", "k3", "k4")])
    # ORB-SLAM takes those that are missing for 0.
    coefficients = [number(content, prefix + k, default=0.0) for k in ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")]
    return from_lens_model("camera", size, intrinsics, RATIONAL if any(coefficients[5:]) else PLUMB_BOB, coefficients, "")


def from_ov2slam(content, index):
    if index > 1:
        raise Refused("is of two cameras: there is no camera %d" % index)
    side = ("left", "right")[index]
    value = lambda name: number(content, "Camera." + name + side[0])
    model = str(value_of(content, "Camera.model_" + side))
    if not is_pinhole(model) and model.lower() != "fisheye":
        raise Refused("Camera.model_%s %r: must be pinhole or fisheye" % (side, model))
    return from_lens_model("camera", [number(content, "Camera.%s_n%s" % (side, name)) for name in ("width", "height")],
                           [value(name) for name in ("fx", "fy", "cx", "cy")],
                           PLUMB_BOB if is_pinhole(model) else EQUIDISTANT,
                           [value(name) for name in ("k1", "k2", "p1", "p2")], "")


def from_kalibr(content, index):
    name = "cam%d" % index
    chain, where = value_of(content, name), name + ": "
    if isinstance(chain, dict) and "cam_model" in chain:
        return from_svo(chain, name, where)
    kind = str(value_of(chain, "camera_model", where))
    wide = {"omni": (MEI, 1), "ds": (DOUBLE_SPHERE, 2), "eucm": (EUCM, 2)}  # and how many parameters come first
    if not (kind in wide or is_pinhole(kind)):
        raise Refused("%scamera_model %r: must be pinhole, omni, ds or eucm; rectify the images of others" % (where, kind))
    model, size = value_of(chain, "distortion_model", where), numbers(chain, "resolution", 2, where)
    is_none = str(model).lower() == "none"
    if kind in wide:
        lens, count = wide[kind]
        if not (is_none or (kind == "omni" and MODELS.get(plain(model)) == PLUMB_BOB)):
            raise Refused("%sdistortion_model %r of camera_model %s: must be %s" %
                          (where, model, kind, "radtan or none" if kind == "omni" else "none"))
        intrinsics = numbers(chain, "intrinsics", count + 4, where)
        coefficients = ([0.0] * 4 if is_none else numbers(chain, "distortion_coeffs", 4, where)) if kind == "omni" else []
        return camera(name, size, intrinsics[count:], lens, intrinsics[:count] + coefficients)
    coefficients = [] if is_none else numbers(chain, "distortion_coeffs", where=where)
    return from_lens_model(name, size, numbers(chain, "intrinsics", 4, where), model, coefficients, where)


def from_basalt(content, index):
    """`content` is what basalt's calibration.json has as value0."""
    cameras, sizes, where = value_of(content, "intrinsics"), value_of(content, "resolution"), "intrinsics[%d]: " % index
    if not isinstance(cameras, list) or not isinstance(sizes, list) or index >= min(len(cameras), len(sizes)):
        raise Refused("intrinsics and resolution: there is no camera %d" % index)
    kind, parameters = str(value_of(cameras[index], "camera_type", where)), value_of(cameras[index], "intrinsics", where)
    lenses = {"ds": (DOUBLE_SPHERE, ("xi", "alpha")), "eucm": (EUCM, ("alpha", "beta")), "ucm": (EUCM, ("alpha",)),
              "kb4": (EQUIDISTANT, ("k1", "k2", "k3", "k4")), "pinhole": (PLUMB_BOB, ()),
              "pinhole-radtan8": (RATIONAL, ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"))}
    if kind not in lenses:
        raise Refused("%scamera_type %r: must be one of %s; rectify the images of others" % (where, kind, ", ".join(lenses)))
    model, names = lenses[kind]
    coefficients = [number(parameters, name, where) for name in names]
    coefficients += {"ucm": [1.0], "pinhole": [0.0] * 5}.get(kind, [])
    return camera("cam%d" % index, numbers({"resolution": sizes[index]}, "resolution", 2, where),
                  [number(parameters, name, where) for name in ("fx", "fy", "cx", "cy")], model, coefficients)


def from_svo(content, name, where):
    kind = str(content["cam_model"])
    lens = {"pinhole": PLUMB_BOB, "pinholeradialtangential": PLUMB_BOB, "pinholeequidistant": EQUIDISTANT,
            "pinholenodistortion": "none"}
    if kind.lower() not in lens:
        raise Refused("%scam_model %r: must be one of %s; rectify the images of others" % (where, kind, ", ".join(lens)))
    value = lambda key, default=None: number(content, "cam_" + key, where, default)
    return from_lens_model(name, [value("width"), value("height")], [value(key) for key in ("fx", "fy", "cx", "cy")],
                           lens[kind.lower()], [value("d%d" % i, 0.0) for i in range(4)], where)


def from_list(cameras, index):
    """OKVIS, and the rigs of SVO and maplab."""
    if not isinstance(cameras, list) or index >= len(cameras):
        raise Refused("cameras: there is no camera %d" % index)
    entry, where, name = cameras[index], "cameras[%d]: " % index, "cam%d" % index
    if isinstance(entry, dict) and "camera" in entry:
        entry = entry["camera"]
    if isinstance(entry, dict) and "intrinsics" in entry:
        kind = value_of(entry, "type", where)
        if not is_pinhole(kind):
            raise Refused("%stype %r: must be pinhole; rectify the images of others" % (where, kind))
        distortion = value_of(entry, "distortion", where)
        model = value_of(distortion, "type", where + "distortion.")
        coefficients = [] if str(model).lower() == "none" else numbers(distortion, "parameters", where=where + "distortion.")
        return from_lens_model(name, [number(entry, "image_" + side, where) for side in ("width", "height")],
                               numbers(entry, "intrinsics", 4, where), model, coefficients, where)
    intrinsics = numbers(entry, "focal_length", 2, where) + numbers(entry, "principal_point", 2, where)
    return from_lens_model(name, numbers(entry, "image_dimension", 2, where), intrinsics,
                           value_of(entry, "distortion_type", where),
                           numbers(entry, "distortion_coefficients", where=where), where)


def from_euroc(content, index):
    only_camera(index)
    kind = content.get("camera_model", "pinhole")
    if not is_pinhole(kind):
        raise Refused("camera_model %r: must be pinhole; rectify the images of others" % kind)
    return from_lens_model(str(content.get("camera_id", "camera")), numbers(content, "resolution", 2),
                           numbers(content, "intrinsics", 4), value_of(content, "distortion_model"),
                           numbers(content, "distortion_coefficients"), "")


def from_matrix(content, index, named):
    """OpenCV, ROVIO and camera_calibration. `named`: the file's name of what is called so in small letters and digits."""
    def first(*names):
        return next((named[plain(name)] for name in names if plain(name) in named), names[0])
    numbered = first("m%d" % (index + 1), "k%d" % (index + 1))
    if numbered not in content:
        only_camera(index)
    k = numbers(content, numbered if numbered in content else first("camera_matrix", "k"), 9)
    if k[1] != 0 or k[3] != 0 or k[6:] != [0, 0, 1]:
        raise Refused("camera matrix %r: must be fx 0 cx, 0 fy cy, 0 0 1" % k)
    coefficients = numbers(content, first("distortion_coefficients", "distcoeffs", "d%d" % (index + 1), "d"))
    fisheye = number(content, first("fisheyemodel"), default=0.0) != 0
    by_count = EQUIDISTANT if fisheye else PLUMB_BOB if len(coefficients) <= 5 else RATIONAL
    result = from_lens_model(str(content.get(first("cameraname"), "camera")),
                             [number(content, first("image_" + side), default=0.0) for side in ("width", "height")],
                             [k[0], k[4], k[2], k[5]], content.get(first("distortionmodel")) or by_count, coefficients, "")
    for name, count in (("rectification_matrix", 9), ("projection_matrix", 12)):
        if plain(name) in named:
            result[name] = numbers(content, first(name), count)
    return result


def only_camera(index):
    if index > 0:
        raise Refused("is of one camera: there is no camera %d" % index)


def convert(text, index=0, size=None):
    """The camera `index` (from 0) of a file; `size` [width, height] in px takes the place of the file's. Raises Refused."""
    content = read_content(text)
    if isinstance(content.get("Camera"), dict):  # stella_vslam
        content = {"Camera.%s" % key: value for key, value in content["Camera"].items()}
    named = {plain(key): key for key in content}
    rigs = [sensor["cameras"] for sensor in content.get("sensors") or [] if isinstance(sensor, dict) and "cameras" in sensor]
    if "model_type" in content:
        result = from_vins(content, index)
    elif "value0" in content:
        result = from_basalt(content["value0"], index)
    elif "Camera.fxl" in content:
        result = from_ov2slam(content, index)
    elif any(key in content for key in ("Camera.fx", "Camera1.fx", "Camera.type", "Camera.model")):
        result = from_orb_slam(content, index)
    elif any(re.fullmatch(r"cam\d+", str(key)) for key in content):
        result = from_kalibr(content, index)
    elif "cam_model" in content:
        only_camera(index)
        result = from_svo(content, "camera", "")
    elif "cameras" in content or rigs:
        result = from_list(content["cameras"] if "cameras" in content else sum(rigs, []), index)
    elif "intrinsics" in content:
        result = from_euroc(content, index)
    elif any(name in named for name in ("cameramatrix", "k", "m1", "k1")):
        result = from_matrix(content, index, named)
    else:
        for key in ("cam%d_calib" % index, "relative_config_imucam"):  # VINS, OpenVINS
            if key in content:
                raise Refused("names the cameras' own file: convert %s" % content[key])
        raise Refused("is of no known kind: there is no model_type (VINS), Camera.fx, Camera1.fx or Camera (ORB-SLAM, "
                      "stella_vslam), Camera.fxl (OV2SLAM), cam0 (Kalibr), cam_model (SVO), cameras or sensors (OKVIS, SVO, "
                      "maplab), intrinsics (EuRoC), value0 (basalt) or camera_matrix (OpenCV, ROVIO)")
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
            matrix("rectification_matrix", 3, result.get("rectification_matrix", [1, 0, 0, 0, 1, 0, 0, 0, 1])) +
            matrix("projection_matrix", 3,
                   result.get("projection_matrix", [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0])))


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
        with open(options.file, "rb") as file:
            print(format_calibration(convert(read_text(file.read()), options.camera, options.size)), end="")
    except (Refused, OSError) as error:
        print("%s: %s" % (options.file, error), file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
