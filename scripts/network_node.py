#!/usr/bin/env python3
"""Runs a network in the ONNX format on images: depth for the mapper's topic prior_depth, or masks of what to ignore for its
topic mask, or classes for its topic labels. A YAML file says which network and how it is fed (config/networks).

    roslaunch acmp_mapping dense_mapper.launch depth_network:=midas_small.yaml mask_network:=$PWD/my_people.yaml ...
    network_node.py midas_small.yaml --images IMAGES OUT  # for acmp_reconstruct --prior-depth OUT, or --masks OUT

A name without a folder is a file there, or of config/networks.

As a node it takes topic image as the mapper does (parameters image_transport and overload of dense_mapper), and
publishes with the image's stamp and frame. Images that come while the network is busy are skipped, but for the newest;
with overload: block they wait, in at most 1 GiB. /diagnostics tells. Pictures of image_transport:=compressed are JPEG or
PNG, of the size that topic camera_info says. Parameter ~threads: of a CPU, 0 (default): all of them.

Needs ONNX Runtime (pip install onnxruntime, or onnxruntime-gpu), numpy, PIL, and the Python module of this package. Exit code 2:
what is wrong with the file or the network; the mapper goes on without.
"""
import argparse
import collections
import contextlib
import difflib
import math
import os
import signal
import sys
import threading
import time
import types
from pathlib import Path

import numpy as np
import PIL.Image
import yaml

from untrusted import Loader, Refused, read_file

DEPTH_KINDS, MASK_KINDS = ("depth", "inverse_depth"), ("probability", "classes")
# Key: what it is if it is not there (REQUIRED: it must be), its type, and what it may be: the words of a text, least and
# most of a number, or of a list how many numbers it has (None: some), of which type, least and most.
REQUIRED = object()
KEYS = {"file": (REQUIRED, str), "source": (None, str), "licence": (None, str), "input": (None, str),
        "output": (None, str), "kind": (REQUIRED, str, *DEPTH_KINDS, *MASK_KINDS), "size": (None, list, 2, int, 2, 4096),
        "longer_side": (None, int, 32, 4096), "multiple_of": (None, int, 1, 512),
        "color_order": ("rgb", str, "rgb", "bgr"), "pixel_max": (1, float, 1e-9, 1e9),
        "mean": ([0, 0, 0], list, 3, float, -1e9, 1e9), "std": ([1, 1, 1], list, 3, float, 1e-9, 1e9),
        "threshold": (None, float, -math.inf, math.inf), "ignore": (None, list, None, int, 0, 65535),
        "labels": (None, list, None, int, 0, 255), "grow": (0, int, 0, 100)}
DTYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16, "tensor(uint8)": np.uint8}
BILINEAR, NEAREST = PIL.Image.BILINEAR, PIL.Image.NEAREST
WAITING_BYTES = 1 << 30  # of images that wait with overload: block
UNTOLD_PIXELS = 1 << 24  # of a picture whose size no camera_info has told
# In the sources, and where the package is installed.
SHIPPED = [Path(__file__).resolve().parents[1] / "config/networks",
           Path(__file__).resolve().parents[2] / "share/acmp_mapping/config/networks"]


def is_a(value, kind):
    if kind is float:
        return is_a(value, int) or isinstance(value, float) and math.isfinite(value)
    return isinstance(value, kind) and not isinstance(value, bool)


def find_description(name):
    """The file of that name, or that of config/networks, with or without its ending. Refused: names those that are there."""
    shipped = next((folder for folder in SHIPPED if folder.is_dir()), SHIPPED[0])
    for path in (Path(name), shipped / name, shipped / f"{name}.yaml"):
        if path.exists():
            return path
    names = sorted(path.name for path in shipped.glob("*.yaml"))
    near = difflib.get_close_matches(Path(name).name, names, 1)
    raise Refused(f"{name}: there is no such file{f': {near[0]}?' if near else ''}; config/networks has {', '.join(names)}")


class Description:
    """What a YAML file says of a network. Throws Refused where it names key, value and bound."""

    def __init__(self, path):
        path = str(find_description(path))
        try:
            content = yaml.load(read_file(path).decode("utf-8"), Loader)  # a SafeLoader
        except (OSError, yaml.YAMLError, ValueError, RecursionError) as error:  # ValueError: no UTF-8, too many digits
            raise Refused(f"{path}: {error}") from error
        if not isinstance(content, dict):
            raise Refused(f"{path}: must have keys and values")
        self.path = path
        for name, value in content.items():
            self.check(name, value)
        for name, (default, *_) in KEYS.items():
            if default is REQUIRED and name not in content:
                self.refuse(name, "missing")
            setattr(self, name, content.get(name, default))
        if (self.size is None) == (self.longer_side is None):
            self.refuse("size", "must be there, or longer_side (with multiple_of) in its place")
        if self.multiple_of is not None and self.longer_side is None:
            self.refuse("multiple_of", "is for longer_side")
        for kind, name in (("probability", "threshold"), ("classes", "labels" if self.labels else "ignore")):
            if (self.kind == kind) != (getattr(self, name) is not None):
                self.refuse(name, f"must be there if kind is {kind}, and only then")
        if self.labels and self.ignore:
            self.refuse("labels", "must not be there beside ignore")
        self.is_depth = self.kind in DEPTH_KINDS
        self.topic = "prior_depth" if self.is_depth else "labels" if self.labels else "mask"
        if self.grow and self.topic != "mask":
            self.refuse("grow", "is for masks")
        self.file = Path(path).absolute().parent / Path(self.file).expanduser()

    def refuse(self, name, why):
        raise Refused(f"{self.path}: {name}: {why}")

    def check(self, name, value):
        if name not in KEYS:
            near = difflib.get_close_matches(str(name), KEYS, 1)
            self.refuse(name, "is not known" + (f": {near[0]}?" if near else "; known are " + ", ".join(KEYS)))
        _, kind, *allowed = KEYS[name]
        if not is_a(value, kind):
            names = {str: "text", int: "a whole number", float: "a number", list: "a list"}
            self.refuse(name, f"{value!r}: must be {names[kind]}")
        if kind is str and allowed and value not in allowed:
            self.refuse(name, f"{value!r}: must be one of {', '.join(allowed)}")
        if kind in (int, float) and not allowed[0] <= value <= allowed[1]:
            self.refuse(name, f"{value:g}: must be between {allowed[0]:g} and {allowed[1]:g}")
        if kind is list:
            count, item, least, most = allowed
            if not value or count not in (None, len(value)) or not all(is_a(v, item) and least <= v <= most for v in value):
                self.refuse(name, f"{value!r}: must be {count or 'some'}{' whole' if item is int else ''} numbers between "
                            f"{least:g} and {most:g}")

    def input_size(self, width, height):
        """Width and height of what the network gets of an image."""
        if self.size is not None:
            return tuple(self.size)
        multiple = self.multiple_of or 1
        scale = self.longer_side / max(width, height)
        return tuple(max(1, round(side * scale / multiple)) * multiple for side in (width, height))


def prepare(description, rgb, size):
    """An image (height x width x 3, RGB, uint8) as the network wants it: float32, 3 x size[1] x size[0]. The whole image,
    stretched where its shape is another."""
    image = np.asarray(PIL.Image.fromarray(rgb).resize(size, BILINEAR), np.float32)
    if description.color_order == "bgr":
        image = image[:, :, ::-1]
    image = image * np.float32(description.pixel_max / 255)
    return ((image - np.float32(description.mean)) / np.float32(description.std)).transpose(2, 0, 1)


def resized(plane, size, method):
    return np.asarray(PIL.Image.fromarray(plane).resize(size, method))


def to_depth(description, output):
    """Depth of the output (height x width): float32, up to scale and shift of 1 / z, 0 where it is unknown. The mapper fits
    both, so that any positive inverse depth does."""
    output = output.astype(np.float32)
    known = np.isfinite(output) & ((output > 0) | (description.kind != "depth"))
    if not known.any():
        wanted = "positive and finite" if description.kind == "depth" else "finite"
        raise Refused(f"none of the network's {output.size} values is {wanted}")
    least, most = output[known].min(), output[known].max()
    if not most - least > 1e-6 * max(abs(least), abs(most)):
        raise Refused(f"the network's output is the same everywhere: {least:g}")
    if description.kind == "inverse_depth":
        farthest = 10  # times as far as the nearest: what it is changes shift and scale only
        output = 1 / (1 / farthest + (output - least) / (most - least))
    return np.where(known, output, 0).astype(np.float32)


def to_mask(description, output, size):
    """Mask of the output (height x width, or classes x height x width), of the image's size: uint8, 0 where the image is
    to be ignored, else 255; or its labels."""
    unknown = np.count_nonzero(~np.isfinite(output))
    if unknown:
        raise Refused(f"{unknown} of the network's {output.size} values are not finite")
    if description.kind == "probability":
        ignored = resized(output.astype(np.float32), size, BILINEAR) >= description.threshold
    else:
        numbers = output.argmax(0) if output.ndim == 3 else output
        if description.labels:
            least, most = numbers.min(), numbers.max()
            if not 0 <= least <= most < len(description.labels):
                raise Refused(f"the network has classes from {least:g} to {most:g}: labels has {len(description.labels)}")
            return resized(np.array(description.labels, np.uint8)[numbers.astype(int)], size, NEAREST)
        ignored = resized(np.isin(numbers, description.ignore).astype(np.uint8), size, NEAREST) > 0
    return np.where(grown(ignored, description.grow), 0, 255).astype(np.uint8)


def grown(ignored, margin):
    """The same with so many pixels more on all sides of what is ignored."""
    for _ in range(2):  # along the rows, then along the columns
        wide = ignored.copy()
        for shift in range(1, margin + 1):
            wide[:, shift:] |= ignored[:, :-shift]
            wide[:, :-shift] |= ignored[:, shift:]
        ignored = wide.T
    return ignored


class Network:
    """A loaded network. Throws Refused where it is not as described."""

    def __init__(self, description, threads=0):
        self.description = description
        file = description.file
        try:
            import onnxruntime  # pylint: disable=import-outside-toplevel
        except ImportError as error:
            raise Refused(f"ONNX Runtime is missing (pip install onnxruntime, for a GPU onnxruntime-gpu): {error}") from error
        if not file.is_file():
            source = f"; get it from {description.source}" if description.source else ""
            raise Refused(f"{description.path}: file: {file} is missing{source}")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # others compute beside it
        options.log_severity_level = 3
        wanted = ("CUDAExecutionProvider", "CPUExecutionProvider")
        try:
            self.session = onnxruntime.InferenceSession(str(file), options, providers=[
                name for name in wanted if name in onnxruntime.get_available_providers()])
        except Exception as error:  # ONNX Runtime's have no base class of their own
            raise Refused(f"{file}: ONNX Runtime cannot read it: {error}") from error
        self.device = self.session.get_providers()[0].replace("ExecutionProvider", "")
        inputs = self.session.get_inputs()
        self.input, self.output = self.named("input", inputs), self.named("output", self.session.get_outputs())
        if len(inputs) > 1:
            raise Refused(f"{file}: has {len(inputs)} inputs ({', '.join(i.name for i in inputs)}): must have one")
        if self.input.type not in DTYPES:
            raise Refused(f"{file}: input {self.input.name} is a {self.input.type}: must be one of {', '.join(DTYPES)}")
        self.channels_last = self.input.shape[-1] == 3
        # A picture that the network cannot mistake for a constant: does it take and give what is described?
        ramp = np.add.outer(np.arange(48, dtype=np.uint8), np.arange(64, dtype=np.uint8))
        self.outputs_of(np.repeat(ramp[:, :, None], 3, 2))

    def named(self, key, tensors):
        """The input or output that the file names; else the first."""
        name = getattr(self.description, key)
        found = [tensor for tensor in tensors if name in (None, tensor.name)]
        if not found:
            others = ", ".join(tensor.name for tensor in tensors)
            raise Refused(f"{self.description.path}: {key}: the network has no {name}, but {others}")
        return found[0]

    def shaped(self, image):
        """The prepared image with the axes that the network has."""
        shape = self.input.shape
        array = image.transpose(1, 2, 0) if self.channels_last else image
        array = array.reshape((1,) * max(len(shape) - 3, 0) + array.shape)
        if len(shape) != array.ndim or any(isinstance(n, int) and n > 0 and n != m for n, m in zip(shape, array.shape)):
            raise Refused(f"{self.description.file}: input {self.input.name} is {list(shape)}: the description makes "
                          f"{list(array.shape)} of the image")
        return np.ascontiguousarray(array, DTYPES[self.input.type])

    def outputs_of(self, rgb):
        """What the network says of an image (height x width x 3, RGB, uint8): height x width, or classes x height x
        width."""
        size = self.description.input_size(rgb.shape[1], rgb.shape[0])
        array = self.shaped(prepare(self.description, rgb, size))
        try:
            output = self.session.run([self.output.name], {self.input.name: array})[0]
        except Exception as error:  # as above
            raise Refused(f"{self.description.file}: ONNX Runtime: {error}") from error
        shape, classes = output.shape, self.description.kind == "classes"
        while output.ndim > 2 and output.shape[0] == 1:
            output = output[0]
        if output.ndim == 3 and output.shape[2] == 1:
            output = output[:, :, 0]
        if output.ndim == 3 and self.channels_last and classes:
            output = output.transpose(2, 0, 1)
        height, width = output.shape[-2:] if output.ndim > 1 else (1, 1)
        # At any scale; a side of a small output may be rounded by a pixel.
        same_shape = abs(width * size[1] - height * size[0]) <= max(size)
        if (output.ndim != 2 and not (classes and output.ndim == 3)) or min(height, width) < 2 or not same_shape:
            scores = ", or one for each class and pixel," if classes else ""
            raise Refused(f"{self.description.file}: output {self.output.name} is {list(shape)}: kind "
                          f"{self.description.kind} needs one value for each pixel{scores} of an input of {size[0]} x "
                          f"{size[1]}, or at another scale")
        return output

    def run(self, rgb):
        """Depth (float32, of the network's size) or mask (uint8, of the image's size) of an image (height x width x 3,
        RGB, uint8)."""
        output = self.outputs_of(rgb)
        if self.description.is_depth:
            return to_depth(self.description, output)
        return to_mask(self.description, output, (rgb.shape[1], rgb.shape[0]))


def decoders():
    """The mapper's own. Not PIL's: that tries dozens of formats on what a sender calls a JPEG, and starts other programs for
    some."""
    try:
        from acmp_mapping import _offline  # pylint: disable=import-outside-toplevel
    except ImportError as error:
        raise Refused("the Python module of acmp_mapping is missing (source the workspace's setup.bash; built with "
                      f"ACMP_PYTHON=ON): {error}") from error
    return _offline


@contextlib.contextmanager
def refusals(name):
    """What a decoder refuses, as Refused. `name`: of the image."""
    try:
        yield
    except (ValueError, RuntimeError, MemoryError) as error:
        raise Refused(str(error) or f"{name}: no memory") from error


def decoded(data, size=None, max_pixels=1 << 28):
    """RGB, uint8, of the bytes of a JPEG or PNG, as it is stored (whatever its EXIF says of its orientation). `size`: width
    and height that its header must say."""
    name = f"picture of {len(data)} bytes"
    with refusals(name):
        return decoders().decode_image(name, bytes(data), size, max_pixels)


def raw_decoded(decoder, image):
    """The same of a sensor_msgs/Image, in the encodings that the mapper takes."""
    return decoder.decode(image.encoding, image.width, image.height, image.step, bool(image.is_bigendian), bytes(image.data))


def image_size(info):
    """Width and height of the images of a sensor_msgs/CameraInfo; None where it tells none."""
    width, height = info.roi.width or info.width, info.roi.height or info.height
    size = width // max(info.binning_x, 1), height // max(info.binning_y, 1)
    return size if min(size) > 0 else None


def run_on_folder(network, images, out):
    """Files for acmp_reconstruct, of all pictures below a folder. Returns how many images have none."""
    names = sorted(path.relative_to(images) for path in Path(images).rglob("*")
                   if path.suffix.lower() in (".jpg", ".jpeg", ".png") and path.is_file())
    if not names:
        raise Refused(f"{images}: has no .jpg or .png")
    refused, seconds = 0, 0.0
    for name in names:
        path = Path(out, name.with_suffix(".pfm") if network.description.is_depth else f"{name}.png")
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            rgb = decoded(read_file(Path(images, name), 1 << 30))
            start = time.monotonic()
            result = network.run(rgb)
            seconds += time.monotonic() - start
        except Refused as error:
            print(f"{name}: {error}", file=sys.stderr)
            refused += 1
            continue
        if network.description.is_depth:
            header = b"Pf\n%d %d\n-1.0\n" % result.shape[::-1]
            path.write_bytes(header + np.ascontiguousarray(result[::-1], "<f4").tobytes())
        else:
            PIL.Image.fromarray(result).save(path)
    done = len(names) - refused
    print(f"{done} of {len(names)} images in {out}, {1000 * seconds / max(done, 1):.0f} ms each ({network.device})")
    return refused


class Node:
    """Subscribes, publishes and tells. Messages wait in a queue of its own: of those that come while the network is busy the
    newest, or with overload: block all, and then the newest that fit in WAITING_BYTES."""

    def __init__(self, network, ros):
        self.network, self.ros, self.reader = network, ros, decoders().RawImageDecoder()
        mapper = ros.rospy.get_param("dense_mapper", {})
        self.condition = threading.Condition()
        self.waiting, self.waiting_bytes = collections.deque(), 0
        self.max_bytes = WAITING_BYTES if mapper.get("overload") == "block" else 0
        self.counts, self.told = collections.Counter(), collections.Counter()  # the latter: at the last diagnostics
        self.times, self.problem, self.size = collections.deque(maxlen=100), "", None
        topic, kind = "image", ros.Image
        if mapper.get("image_transport") == "compressed":  # by its own name if that is remapped, else beside the image
            kind, own = ros.CompressedImage, "image/compressed"
            topic = ros.rospy.resolve_name(own)
            if topic == ros.rospy.get_namespace() + own:
                topic = ros.rospy.resolve_name("image")
                topic += "" if topic.endswith("/compressed") else "/compressed"  # a name that ends so is the whole one
            self.infos = ros.rospy.Subscriber("camera_info", ros.CameraInfo, self.receive_info, queue_size=1)
        self.publisher = ros.rospy.Publisher(network.description.topic, ros.Image, queue_size=30)
        self.status = ros.rospy.Publisher("/diagnostics", ros.DiagnosticArray, queue_size=10)
        self.subscriber = ros.rospy.Subscriber(topic, kind, self.receive, queue_size=30, buff_size=2 ** 26)

    def receive_info(self, info):
        self.size = image_size(info) or self.size

    def receive(self, message):
        with self.condition:
            self.counts["received"] += 1
            self.waiting.append(message)
            self.waiting_bytes += len(message.data)
            while self.waiting_bytes > self.max_bytes and len(self.waiting) > 1:
                self.waiting_bytes -= len(self.waiting.popleft().data)
                self.counts["skipped"] += 1
            self.condition.notify()

    def run(self):
        """Until ROS ends; the network has a thread of its own, as nothing can end one that hangs but the end of the program."""
        for work in (self.tell, self.work):
            threading.Thread(target=work, daemon=True).start()
        while not self.ros.rospy.is_shutdown():
            time.sleep(0.1)

    def work(self):
        while not self.ros.rospy.is_shutdown():
            with self.condition:
                if not self.condition.wait_for(lambda: self.waiting, 0.2):
                    continue
                message = self.waiting.popleft()
                self.waiting_bytes -= len(message.data)
            start = time.monotonic()
            try:
                with refusals("image"):
                    rgb = self.decode(message) if hasattr(message, "format") else raw_decoded(self.reader, message)
                self.publish(message.header, self.network.run(rgb))
            except (Exception, SystemExit) as error:  # an image, or what the network makes of it: the next may be better
                self.counts["refused"] += 1
                what = str(error) if isinstance(error, Refused) else f"{type(error).__name__}: {error}"
                self.problem = f"image {message.header.stamp}: {what}"
                self.ros.rospy.logwarn_throttle(10, self.problem)
                continue
            self.counts["published"] += 1
            self.times.append(1000 * (time.monotonic() - start))

    def decode(self, message):
        try:
            return decoded(message.data, self.size, UNTOLD_PIXELS if self.size is None else 1 << 28)
        except Refused as error:
            if self.size is None and "at most" in str(error):
                raise Refused(f"{error} (no camera_info has come on {self.infos.resolved_name})") from error
            raise

    def publish(self, header, plane):
        image = self.ros.Image(header=header, height=plane.shape[0], width=plane.shape[1],
                               encoding="32FC1" if plane.dtype == np.float32 else "mono8",
                               is_bigendian=sys.byteorder == "big", step=plane.shape[1] * plane.itemsize, data=plane.tobytes())
        self.publisher.publish(image)

    def tell(self):
        """Once a second, whatever the clock of a recording does."""
        while not self.ros.rospy.is_shutdown():
            time.sleep(1)
            self.status.publish(self.ros.DiagnosticArray(
                header=self.ros.Header(stamp=self.ros.rospy.Time.now()), status=[self.diagnosis()]))

    def diagnosis(self):
        counts = collections.Counter(self.counts)
        new = counts - self.told
        self.told = counts
        kind, device = self.ros.DiagnosticStatus, self.network.device
        if new["refused"]:
            level, text = kind.ERROR, self.problem
        elif not counts["received"]:
            level, text = kind.WARN, f"no image yet on {self.subscriber.resolved_name}"
        elif new["skipped"]:
            level = kind.WARN
            text = f"the network is too slow: skipped {new['skipped']} of the last {new['received']} images"
            if self.max_bytes:
                text += f"; {self.max_bytes >> 20} MiB wait for it: play the recording more slowly (rosbag play -r)"
        else:
            level, text = kind.OK, "keeps up" if new["received"] else "waits for images"
        values = {"network": self.network.description.path, "device": device, "topic": self.publisher.resolved_name,
                  "images": counts["received"], "published": counts["published"], "skipped, too slow": counts["skipped"],
                  "refused": counts["refused"], "waiting": len(self.waiting)}
        if self.times:
            values["time per image [ms]"] = f"median {np.median(self.times):.0f}, most {max(self.times):.0f}"
        return kind(level=level, name=self.ros.rospy.get_name().lstrip("/") + ": network", message=text, hardware_id=device,
                    values=[self.ros.KeyValue(key, str(value)) for key, value in values.items()])


def import_ros():
    """What the node uses of ROS, which the rest of this file does without."""
    # pylint: disable=import-outside-toplevel, unused-import
    import rospy
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
    from sensor_msgs.msg import CameraInfo, CompressedImage, Image
    from std_msgs.msg import Header
    return types.SimpleNamespace(**locals())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("network", help="YAML file, or the name of one of config/networks")
    parser.add_argument("--images", nargs=2, metavar=("IMAGES", "OUT"), help="of a folder, without ROS")
    parser.add_argument("--threads", type=int, default=0, help="with --images: of a CPU; 0: all")
    arguments, ros = parser.parse_args([word for word in sys.argv[1:] if ":=" not in word]), None
    try:
        if arguments.images:
            network = Network(Description(arguments.network), arguments.threads)
            return 1 if run_on_folder(network, *arguments.images) else 0
        ros = import_ros()
        ros.rospy.init_node("network")
        signal.signal(signal.SIGTERM, signal.SIG_DFL)  # the system's: works whatever a network does
        network = Network(Description(arguments.network), ros.rospy.get_param("~threads", 0))
        ros.rospy.loginfo("%s on %s, to %s", arguments.network, network.device, network.description.topic)
        Node(network, ros).run()
    except Refused as error:
        if ros:
            ros.rospy.logerr("%s. The mapper goes on without this network", error)
            with contextlib.suppress(AttributeError):  # Debian 11: after all it does, of threads' isAlive of older Pythons
                ros.rospy.signal_shutdown("refused")  # unregisters the node
        else:
            print(f"network_node: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # without waiting for a network that may never return
