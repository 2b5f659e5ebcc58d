#!/usr/bin/env python3
"""Converts the camera calibration of a SLAM frontend to the format of camera_calibration, for calibration_file.

    rosrun acmp_mapping convert_calibration.py euroc_config.yaml > camera.yaml        # VINS-Mono, VINS-Fusion (cam0_calib)
    rosrun acmp_mapping convert_calibration.py camchain.yaml --camera 1 > camera.yaml # Kalibr, OpenVINS; the second camera
    rosrun acmp_mapping convert_calibration.py TUM1.yaml --size 640x480 > camera.yaml # ORB-SLAM2 and 3

The kind of file is told by its keys: VINS (model_type), ORB-SLAM2 and 3 and stella_vslam (Camera.fx, Camera1.fx, Camera),
OV2SLAM (Camera.fxl), Kalibr (cam0), SVO (cam_model), OKVIS, SVO and maplab (cameras, sensors), EuRoC or Kimera-VIO
(intrinsics), basalt (value0), OpenCV or ROVIO (camera_matrix; as XML, too), and ZED's SN*.conf (of the size that --size says).
What camera_calibration writes calibration_file takes as it is, and a camera_info as `rostopic echo` prints it. Lens models become plumb_bob, rational_polynomial, equidistant, mei (of VINS' MEI and Kalibr's omni: D is xi k1 k2 p1 p2), double_sphere
(xi alpha), eucm (alpha beta; UCM is that with beta 1) or equirectangular; others (FOV) are refused: rectify those images.
Exit code 2: what the file lacks.
"""
import argparse
import contextlib
import math
import re
import sys
import xml.etree.ElementTree

import yaml

import untrusted
from untrusted import Refused, read_file

PLUMB_BOB, RATIONAL, EQUIDISTANT, MEI = "plumb_bob", "rational_polynomial", "equidistant", "mei"
DOUBLE_SPHERE, EUCM, EQUIRECTANGULAR = "double_sphere", "eucm", "equirectangular"
# By name, in small letters and digits alone.
MODELS = {"radtan": PLUMB_BOB, "radialtangential": PLUMB_BOB, "plumbbob": PLUMB_BOB, "brownconrady": PLUMB_BOB,
          "radialtangential8": RATIONAL, "rationalpolynomial": RATIONAL, "equidistant": EQUIDISTANT, "equi": EQUIDISTANT,
          "fisheye": EQUIDISTANT, "kannalabrandt": EQUIDISTANT, "kannalabrandt4": EQUIDISTANT,
          "kannalabrandt8": EQUIDISTANT, "none": PLUMB_BOB}
COUNTS = {PLUMB_BOB: (4, 5), RATIONAL: (8, 8), EQUIDISTANT: (4, 4)}  # least and most coefficients
PINHOLES = {"pinhole": PLUMB_BOB, "perspective": PLUMB_BOB}
AS_IT_IS = "is of camera_calibration, or a camera_info: calibration_file takes it as it is"


class Loader(untrusted.Loader):
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


def read_ini(text):
    """Sections in their order, each with its values by name."""
    sections = []
    for line in text.splitlines():
        header = re.fullmatch(r"\s*\[(.*)\]\s*", line)
        if header:
            sections.append((header.group(1), {}))
        elif "=" in line and sections:
            name, _, value = (part.strip() for part in line.partition("="))
            sections[-1][1][name] = value
    return {"ini": sections}


def read_content(text):
    """YAML, also as OpenCV reads it: text before "%YAML:1.0" (which is no directive of YAML), tabs, and no space after a
    colon."""
    if re.search(r"^\s*\[image\]\s*$", text, re.MULTILINE):
        raise Refused(AS_IT_IS)
    if re.search(r"^\s*\[(LEFT|RIGHT)_CAM_\w+\]\s*$", text, re.MULTILINE):
        content = read_ini(text)
    elif re.match(r"\s*<", text):
        content = read_xml(text)
    else:
        text = re.sub(r"\A(?:[^\n]*\n){0,20}?%YAML[^\n]*\n", "", text.replace("\r\n", "\n").replace("\r", "\n"))
        text = text.replace("\t", " ")
        text = re.sub(r"^([ -]*[A-Za-z_][\w.]*):(?=[^\s:])", r"\1: ", text, flags=re.MULTILINE)
        text = re.sub(r"([{,]\s*[A-Za-z_][\w.]*):(?=[^\s:])", r"\1: ", text)
        try:
            content = next(yaml.load_all(text, Loader), None)  # a SafeLoader; of messages, one after the other, the first
        except (yaml.YAMLError, ValueError, RecursionError) as error:  # ValueError: a number of thousands of digits
            raise Refused("is no YAML: %s" % str(error).replace("\n", " "))
    if not isinstance(content, dict):
        raise Refused("has no \"name: value\" lines")
    return content


class Fields:
    """Values of a file by name. Refuses those that are missing or of another kind, by `where` they are and their name."""

    def __init__(self, values, where=""):
        self.values, self.where = values if isinstance(values, dict) else {}, where

    def __contains__(self, name):
        return self.values.get(name) is not None

    def __getitem__(self, name):
        if name not in self:
            raise Refused(f"{self.where}{name} is missing")
        return self.values[name]

    def get(self, name, default):
        return self[name] if name in self else default

    def part(self, name):
        return Fields(self[name], f"{self.where}{name}: ")

    def number(self, name, default=None):
        value = self[name] if default is None else self.get(name, default)
        with contextlib.suppress(TypeError, ValueError, OverflowError):
            if math.isfinite(float(value)):
                return float(value)
        raise Refused(f"{self.where}{name} = {value!r}: must be a number")

    def numbers(self, names, before="", after="", default=None):
        """Of names with spaces between them."""
        return [self.number(before + name + after, default) for name in names.split()]

    def entries(self, name):
        """Of a list of cameras or sensors."""
        if not isinstance(self[name], list):
            raise Refused(f"{self.where}{name} = {self[name]!r}: must be a list")
        return [Fields(entry, f"{self.where}{name}[{index}]: ") for index, entry in enumerate(self[name])]

    def list(self, name, count=None):
        """`count` numbers, or any number of them: of lists in lists, or of a matrix with rows, cols and data."""
        value = self[name]
        found = flattened(value)
        if not isinstance(value, (dict, list)) or count not in (None, len(found)):
            raise Refused(f"{self.where}{name} = {value!r}: must be a list of {f'{count} ' if count else ''}numbers")
        return [Fields({name: number}, self.where).number(name) for number in found]

    def choice(self, name, known, default=None):
        """What `known` has for the value, in small or capital letters."""
        value = self[name] if default is None else self.get(name, default)
        return chosen(value, known, f"{self.where}{name}")


def flattened(values):
    if isinstance(values, dict):
        values = values.get("data")
    return [number for value in values for number in flattened(value)] if isinstance(values, list) else [values]


def chosen(value, known, what):
    if str(value).lower() not in known:
        raise Refused(f"{what} {value!r}: must be one of {', '.join(known)}; rectify the images of others")
    return known[str(value).lower()]


def chosen_camera(cameras, index):
    if index >= len(cameras):
        raise Refused(f"there is no camera {index}: the file has {len(cameras)}")
    return cameras[index]


def of_one_camera(index):
    chosen_camera(range(1), index)


def plain(name):
    """In small letters and digits alone."""
    return re.sub(r"[^a-z0-9]", "", str(name).lower())


def lens(name, coefficients, where=""):
    """Model and coefficients, of a file's name of the model and its list: those that are missing or too many must be 0."""
    if plain(name) not in MODELS:
        chosen(name, sorted(MODELS), where + "distortion model")
    model = MODELS[plain(name)]
    if model == PLUMB_BOB and len(coefficients) >= 8 and any(coefficients[5:8]):
        model = RATIONAL  # OpenCV has one list for both, and so have programs that write the name without a look at it
    least, most = COUNTS[model]
    if len(coefficients) < least and any(coefficients) and not (model == RATIONAL and len(coefficients) in (4, 5)):
        raise Refused(f"{where}{len(coefficients)} distortion coefficients: {model} has {most}")
    used = 0 if plain(name) == "none" else most
    if any(coefficients[used:]):
        raise Refused(f"{where}{len(coefficients)} distortion coefficients: {name} has {used}, and those after them are not "
                      "0 (k4 to k6, thin prism or tilt); rectify the images")
    return model, (coefficients + [0.0] * most)[:most]


# Each reader returns name, size, fx fy cx cy and lens of a camera; `index` counts from 0.


def from_vins(content, index):
    of_one_camera(index)
    radtan = "k1 k2 p1 p2"
    model, projection, distortion = content.choice("model_type", {
        "pinhole": (PLUMB_BOB, "fx fy cx cy", radtan), "pinhole_full": (RATIONAL, "fx fy cx cy", radtan + " k3 k4 k5 k6"),
        "kannala_brandt": (EQUIDISTANT, "mu mv u0 v0", "k2 k3 k4 k5"), "mei": (MEI, "gamma1 gamma2 u0 v0", radtan)})
    parameters = content.part("projection_parameters")
    intrinsics = parameters.numbers(projection)
    others = content.part("distortion_parameters") if model != EQUIDISTANT else parameters
    coefficients = others.numbers(distortion)
    xi = content.part("mirror_parameters").numbers("xi") if model == MEI else []
    return (content.get("camera_name", "camera"), content.numbers("image_width image_height"), intrinsics,
            (MEI, xi + coefficients) if xi else lens(model, coefficients))


def from_orb_slam(content, index):
    """ORB-SLAM and stella_vslam, with names such as Camera.fx."""
    prefix = f"Camera{index + 1}." if index > 0 or "Camera1.fx" in content else "Camera."
    size = [content.number("Camera." + side, content.number("Camera." + other, 0.0))
            for side, other in (("width", "cols"), ("height", "rows"))]
    kind = content.choice("Camera.type" if "Camera.type" in content else "Camera.model", {
        **PINHOLES, "rectified": "none", "fisheye": EQUIDISTANT, "kannalabrandt8": EQUIDISTANT,
        EQUIRECTANGULAR: EQUIRECTANGULAR}, "PinHole")
    if kind == EQUIRECTANGULAR:  # the size alone tells the camera: pixels per radian
        of_one_camera(index)
        focal_length = size[0] / (2 * math.pi)
        return "camera", size, [focal_length, focal_length, size[0] / 2, size[1] / 2], (EQUIRECTANGULAR, [])
    intrinsics = content.numbers("fx fy cx cy", prefix)
    if kind == EQUIDISTANT:
        return "camera", size, intrinsics, (EQUIDISTANT, content.numbers("k1 k2 k3 k4", prefix))
    # ORB-SLAM takes those that are missing for 0.
    coefficients = content.numbers("k1 k2 p1 p2 k3 k4 k5 k6", prefix, default=0.0) if kind == PLUMB_BOB else []
    return "camera", size, intrinsics, lens(RATIONAL if any(coefficients[5:]) else kind, coefficients)


def from_ov2slam(content, index):
    side = chosen_camera(("left", "right"), index)
    model = content.choice("Camera.model_" + side, {**PINHOLES, "fisheye": EQUIDISTANT})
    return ("camera", content.numbers("width height", f"Camera.{side}_n"),
            content.numbers("fx fy cx cy", "Camera.", side[0]),
            lens(model, content.numbers("k1 k2 p1 p2", "Camera.", side[0])))


def from_kalibr(content, index):
    name = f"cam{index}"
    chain = content.part(name)
    if "cam_model" in chain:
        return from_svo(chain, 0, name)
    # Model, how many parameters come before those of a pinhole, and what distortion may come after them.
    model, count, others = chain.choice("camera_model", {
        **dict.fromkeys(PINHOLES, (None, 0, MODELS)), "omni": (MEI, 1, ("radtan", "radialtangential", "none")),
        "ds": (DOUBLE_SPHERE, 2, ("none",)), "eucm": (EUCM, 2, ("none",))})
    distortion = chain["distortion_model"]
    if count and plain(distortion) not in others:
        raise Refused(f"{chain.where}distortion_model {distortion!r} of camera_model {chain['camera_model']}: must be "
                      f"{' or '.join(others)}")
    coefficients = [] if plain(distortion) == "none" else chain.list("distortion_coeffs", 4 if count else None)
    intrinsics, found = chain.list("intrinsics", count + 4), lens(distortion, coefficients, chain.where)
    if count:
        found = model, intrinsics[:count] + (found[1][:4] if model == MEI else [])
    return name, chain.list("resolution", 2), intrinsics[count:], found


def from_basalt(content, index):
    """calibration.json."""
    content = content.part("value0")
    cameras = content.entries("intrinsics")
    camera, sizes = chosen_camera(cameras, index), content.list("resolution", 2 * len(cameras))
    model, names, others = camera.choice("camera_type", {
        "ds": (DOUBLE_SPHERE, "xi alpha", []), "eucm": (EUCM, "alpha beta", []), "ucm": (EUCM, "alpha", [1.0]),
        "kb4": (EQUIDISTANT, "k1 k2 k3 k4", []), "pinhole": (PLUMB_BOB, "", [0.0] * 5),
        "pinhole-radtan8": (RATIONAL, "k1 k2 p1 p2 k3 k4 k5 k6", [])})
    parameters = Fields(camera["intrinsics"], camera.where)
    return (f"cam{index}", sizes[2 * index:2 * index + 2], parameters.numbers("fx fy cx cy"),
            (model, parameters.numbers(names) + others))


def from_svo(content, index, name="camera"):
    of_one_camera(index)
    model = content.choice("cam_model", {"pinhole": PLUMB_BOB, "pinholeradialtangential": PLUMB_BOB,
                                         "pinholeequidistant": EQUIDISTANT, "pinholenodistortion": "none"})
    return (name, content.numbers("width height", "cam_"), content.numbers("fx fy cx cy", "cam_"),
            lens(model, content.numbers("d0 d1 d2 d3", "cam_", default=0.0), content.where))


def from_list(content, index):
    """OKVIS, and the rigs of SVO and maplab."""
    rigs = [content] if "cameras" in content else [sensor for sensor in content.entries("sensors") if "cameras" in sensor]
    camera, name = chosen_camera([camera for rig in rigs for camera in rig.entries("cameras")], index), f"cam{index}"
    if "camera" in camera:
        camera = Fields(camera["camera"], camera.where)
    if "intrinsics" not in camera:
        return (name, camera.list("image_dimension", 2), camera.list("focal_length", 2) + camera.list("principal_point", 2),
                lens(camera["distortion_type"], camera.list("distortion_coefficients"), camera.where))
    camera.choice("type", PINHOLES)
    distortion = camera.part("distortion")
    coefficients = [] if plain(distortion["type"]) == "none" else distortion.list("parameters")
    return (name, camera.numbers("image_width image_height"), camera.list("intrinsics", 4),
            lens(distortion["type"], coefficients, camera.where))


def from_euroc(content, index):
    of_one_camera(index)
    content.choice("camera_model", PINHOLES, "pinhole")
    return (content.get("camera_id", "camera"), content.list("resolution", 2), content.list("intrinsics", 4),
            lens(content["distortion_model"], content.list("distortion_coefficients")))


def from_matrix(content, index):
    """OpenCV and ROVIO."""
    named = {plain(name): name for name in content.values}

    if "projectionmatrix" in named or "k" in named:
        raise Refused(AS_IT_IS)

    def first(*names):
        """The file's name of the first that it has, however it is written."""
        return next((named[plain(name)] for name in names if plain(name) in named), names[0])
    matrix_name = first(f"m{index + 1}", f"k{index + 1}")
    if matrix_name not in content:
        of_one_camera(index)
        matrix_name = first("camera_matrix")
    k = content.list(matrix_name, 9)
    if k[1] != 0 or k[3] != 0 or k[6:] != [0, 0, 1]:
        raise Refused(f"camera matrix {k!r}: must be fx 0 cx, 0 fy cy, 0 0 1")
    coefficients = content.list(first("distortion_coefficients", "distcoeffs", f"d{index + 1}"))
    fisheye = content.number(first("fisheyemodel"), 0.0) != 0
    by_count = EQUIDISTANT if fisheye else PLUMB_BOB if len(coefficients) <= 5 else RATIONAL
    size = [content.number(first("image_" + side, side), 0.0) for side in ("width", "height")]
    return (content.get(first("cameraname"), "camera"), size, [k[0], k[4], k[2], k[5]],
            lens(content.get(first("distortionmodel"), None) or by_count, coefficients))


ZED_SIZES = {"2K": [2208, 1242], "FHD1200": [1920, 1200], "FHD": [1920, 1080], "HD": [1280, 720], "SVGA": [960, 600],
             "VGA": [672, 376]}


def from_zed(content, index, size):
    """Factory calibration, for several sizes."""
    prefix = chosen_camera(("LEFT_CAM_", "RIGHT_CAM_"), index)
    cameras = [(name, ZED_SIZES[name[len(prefix):]], values) for name, values in content["ini"]
               if name.startswith(prefix) and name[len(prefix):] in ZED_SIZES]
    of_size = [camera for camera in cameras if size in (None, camera[1])]
    if len(of_size) != 1:
        raise Refused(f"has {', '.join('%dx%d' % tuple(camera[1]) for camera in cameras) or 'no size that is known'}: give "
                      "that of the images as --size")
    name, of_file, values = of_size[0]
    fields = Fields(values, f"[{name}] ")
    return name, of_file, fields.numbers("fx fy cx cy"), lens(
        RATIONAL, fields.numbers("k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4", default=0.0), fields.where)


# By a name that only these files have.
READERS = {"model_type": from_vins, "value0": from_basalt, r"Camera\.fxl": from_ov2slam,
           r"Camera1?\.fx|Camera\.(type|model)": from_orb_slam, r"cam\d+": from_kalibr, "cam_model": from_svo,
           "cameras|sensors": from_list, "intrinsics": from_euroc, "ini": from_zed, r"(?i)camera[\W_]*matrix|k|[mk]1": from_matrix}


def convert(text, index=0, size=None):
    """The camera `index` (from 0) of a file; `size` [width, height] in px takes the place of the file's. Raises Refused."""
    content = Fields(read_content(text))
    if isinstance(content.get("Camera", None), dict):  # stella_vslam
        content = Fields({f"Camera.{name}": value for name, value in content["Camera"].items()})
    reader = next((reader for names, reader in READERS.items()
                   if any(re.fullmatch(names, str(name)) for name in content.values)), None)
    if reader is None:
        for name in (f"cam{index}_calib", "relative_config_imucam"):  # VINS, OpenVINS
            if name in content:
                raise Refused(f"names the cameras' own file: convert {content[name]}")
        raise Refused("is of no known kind: there is no model_type (VINS), Camera.fx, Camera1.fx or Camera (ORB-SLAM, "
                      "stella_vslam), Camera.fxl (OV2SLAM), cam0 (Kalibr), cam_model (SVO), cameras or sensors (OKVIS, SVO, "
                      "maplab), intrinsics (EuRoC), value0 (basalt), camera_matrix (OpenCV, ROVIO)")
    arguments = (content, index, size) if reader is from_zed else (content, index)
    name, of_file, intrinsics, (model, coefficients) = reader(*arguments)
    check(size or of_file, intrinsics)
    return {"name": str(name), "size": size or of_file, "intrinsics": intrinsics, "model": model,
            "coefficients": coefficients}


def check(size, intrinsics):
    (width, height), (fx, fy, cx, cy) = size, intrinsics
    if width < 1 or height < 1 or width != int(width) or height != int(height):
        raise Refused(f"image size {width:g} x {height:g}: must be whole numbers above 0; give --size")
    if not (fx > 0 and fy > 0):
        raise Refused(f"focal length {fx:g}, {fy:g}: must be above 0")
    if not (0 <= cx < width and 0 <= cy < height):
        raise Refused(f"principal point ({cx:g}, {cy:g}): is outside of the image of {width:g} x {height:g}")


def format_calibration(result):
    fx, fy, cx, cy = result["intrinsics"]

    def matrix(rows, values):
        return {"rows": rows, "cols": len(values) // rows, "data": [float(value) for value in values]}
    width, height = map(int, result["size"])
    return yaml.safe_dump({
        "image_width": width, "image_height": height, "camera_name": re.sub(r"\W", "_", result["name"]),
        "camera_matrix": matrix(3, [fx, 0, cx, 0, fy, cy, 0, 0, 1]), "distortion_model": result["model"],
        "distortion_coefficients": matrix(1, result["coefficients"]),
        "rectification_matrix": matrix(3, [1, 0, 0, 0, 1, 0, 0, 0, 1]),
        "projection_matrix": matrix(3, [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0])},
                          default_flow_style=None, sort_keys=False, width=math.inf)


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
        print(format_calibration(convert(read_text(read_file(options.file)), options.camera, options.size)), end="")
    except (Refused, OSError, RecursionError) as error:  # the last: hundreds of lists in each other
        print("%s: %s" % (options.file, error), file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
