"""What consumers_rostest.py needs to play the part of the nodes that launch/consumers starts: their topics and
parameters from the launch files, synchronisation and lookups of poses."""
import threading
import xmlrpc.client

import numpy as np
import rosgraph.names
import roslaunch.config
import roslaunch.xmlloader
import rosnode
import rospy

FLOAT32 = 7  # sensor_msgs/PointField


class Consumer:
    """A node as a launch file starts it."""

    def __init__(self, path, node_type, *arguments):
        self.config = roslaunch.config.ROSLaunchConfig()
        roslaunch.xmlloader.XmlLoader().load(path, self.config, argv=list(arguments), verbose=False)
        found = [node for node in self.config.nodes if node.type == node_type]
        assert len(found) == 1, f"{path} starts {[node.type for node in self.config.nodes]}"
        self.node = found[0]
        self.name = self.node.namespace + self.node.name
        self.remaps = {self.resolve(source): self.resolve(target) for source, target in self.node.remap_args}

    def resolve(self, name):
        return rosgraph.names.resolve_name(name, self.name)

    def topic(self, name):
        """The topic that the node gets when it asks for `name`."""
        return self.remaps.get(self.resolve(name), self.resolve(name))

    def parameter(self, name, default=None):
        """Of the node itself ("~name"), or without "~" beside it."""
        found = self.config.params.get(self.resolve(name))
        return default if found is None else found.value

    def observation_sources(self):
        """Of the layer of a costmap, by name, with their parameters; topics as the node resolves them."""
        layer = "~costmap/points_layer/"
        names = ("topic", "data_type", "marking", "clearing", "min_obstacle_height", "max_obstacle_height",
                 "expected_update_rate", "observation_persistence")
        sources = {source: {name: self.parameter(f"{layer}{source}/{name}") for name in names}
                   for source in self.parameter(layer + "observation_sources").split()}
        for source in sources.values():
            source["topic"] = self.topic(source["topic"])
        return sources


class Recorder:
    """Subscribes to topics and keeps what comes, in the order in which it came."""

    def __init__(self):
        self.lock = threading.Lock()
        self.events = []  # (topic, message)
        self.subscribers = {}

    def subscribe(self, topic, message_type):
        if topic in self.subscribers:
            assert self.subscribers[topic].data_class is message_type, f"{topic} is wanted with two types"
            return
        self.subscribers[topic] = rospy.Subscriber(topic, message_type, self.receive, topic, queue_size=1000)

    def receive(self, message, topic):
        with self.lock:
            self.events.append((topic, message))

    def of(self, *topics):
        with self.lock:
            return [event for event in self.events if event[0] in topics]

    def messages(self, topic):
        return [message for _, message in self.of(topic)]


def receivers(node):
    """(subscriber, topic) of all that `node` sends, once the connection stands; nothing before the node has started, though
    the master may know one of the same name that has ended."""
    api = rosnode.get_api_uri(rosgraph.Master(rospy.get_name()), node, skip_cache=True)
    if not api:
        return set()
    try:
        info = xmlrpc.client.ServerProxy(api).getBusInfo(rospy.get_name())[2]
    except ConnectionRefusedError:
        return set()
    return {(entry[1], entry[4]) for entry in info if entry[2] == "o"}


def exact_sync(events, queue_size):
    """message_filters' ExactTime policy: the tuples of messages with one stamp, one of each topic, while at most
    `queue_size` stamps are incomplete. What is older than a tuple is given up."""
    topics = {topic for topic, _ in events}
    waiting, tuples = {}, []
    for topic, message in events:
        stamp = message.header.stamp.to_nsec()
        waiting.setdefault(stamp, {})[topic] = message
        if set(waiting[stamp]) == topics:
            tuples.append(waiting[stamp])
            waiting = {other: value for other, value in waiting.items() if other > stamp}
        while len(waiting) > queue_size:
            del waiting[min(waiting)]
    return tuples


def passing_rate(stamps_ns, rate_hz):
    """How many are taken by a node that passes over what comes within 1 / rate of the last one it took; rate 0: all."""
    taken, last = 0, None
    for stamp in stamps_ns:
        if rate_hz > 0 and last is not None and stamp - last < 1e9 / rate_hz:
            continue
        taken, last = taken + 1, stamp
    return taken


def matrix(translation, rotation):
    """4x4 of a geometry_msgs translation or position and a quaternion."""
    x, y, z, w = rotation.x, rotation.y, rotation.z, rotation.w
    result = np.eye(4)
    result[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                      [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                      [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
    result[:3, 3] = [translation.x, translation.y, translation.z]
    return result


class Tf:
    """Transforms from parent to child: moving ones at stamps that are asked for, and static ones (stamp None)."""

    def __init__(self):
        self.parents = {}  # child -> (parent, {stamp in ns: T_parent_child})

    def add(self, parent, child, stamp_ns, transform):
        known_parent, transforms = self.parents.setdefault(child, (parent, {}))
        assert known_parent == parent, f"{child} has two parents"
        transforms[stamp_ns] = transform

    def lookup(self, target, source, stamp_ns):
        """T_target_source, for a target that is `source` or above it; None where tf would fail."""
        result = np.eye(4)
        while source != target:
            if source not in self.parents:
                return None
            source, transforms = self.parents[source]
            transform = transforms.get(None, transforms.get(stamp_ns))
            if transform is None:
                return None
            result = transform @ result
        return result


def transformed(transform, points):
    return points @ transform[:3, :3].T + transform[:3, 3]


def cloud_fields(cloud):
    """The fields of a PointCloud2 by name, as PCL reads them: in the machine's byte order, of the types they have."""
    types = {1: "i1", 2: "u1", 3: "<i2", 4: "<u2", 5: "<i4", 6: "<u4", FLOAT32: "<f4", 8: "<f8"}
    layout = np.dtype({"names": [field.name for field in cloud.fields],
                       "formats": [types[field.datatype] for field in cloud.fields],
                       "offsets": [field.offset for field in cloud.fields], "itemsize": cloud.point_step})
    return np.frombuffer(cloud.data, layout)


def positions(cloud):
    fields = cloud_fields(cloud)
    return np.stack([fields[name] for name in "xyz"], axis=1).astype(float)


def back_projected(image, camera_info):
    """Points in the camera of the pixels that have a depth, by K."""
    depth = np.frombuffer(image.data, "<f4").reshape(image.height, image.width).astype(float)
    row, col = np.nonzero(depth > 0)
    z = depth[row, col]
    fx, fy, cx, cy = (camera_info.K[i] for i in (0, 4, 2, 5))
    return np.stack([(col - cx) * z / fx, (row - cy) * z / fy, z], axis=1)


def read_ply(path):
    """Positions of a binary PLY whose properties are floats and bytes."""
    properties, count = [], 0
    with open(path, "rb") as file:
        for line in iter(file.readline, b"end_header\n"):
            words = line.decode().split()
            if words[0] == "element":
                count = int(words[2])
            elif words[0] == "property":
                properties.append((words[2], {"float": "<f4", "uchar": "u1"}[words[1]]))
        values = np.frombuffer(file.read(), np.dtype(properties), count)
    return np.stack([values[name] for name in "xyz"], axis=1).astype(float)


class Near:
    """Which points are within `distance` of any of a dense set, to half a cell's precision."""

    def __init__(self, points, distance):
        self.cell = distance / 2.5
        reach = np.arange(-2, 3)
        offsets = np.stack(np.meshgrid(reach, reach, reach), axis=-1).reshape(-1, 3)
        offsets = offsets[(offsets ** 2).sum(1) <= 2.5 ** 2]
        cells = np.unique(np.floor(points / self.cell).astype(int), axis=0)
        self.cells = np.unique(np.concatenate([self.keys(cells + offset) for offset in offsets]))

    @staticmethod
    def keys(cells):
        return ((cells + 100000) * [1, 1 << 20, 1 << 40]).sum(axis=1)

    def __call__(self, points):
        return np.isin(self.keys(np.floor(points / self.cell).astype(int)), self.cells)
