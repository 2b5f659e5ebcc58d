#!/usr/bin/env python3
"""Shows what the mapper publishes in the viewer Rerun (pip install rerun-sdk), which can also go back in time: image, depth
and camera of the keyframes, the map, its occupancy, the camera path.

    rosrun acmp_mapping rerun_bridge.py                                           # opens the viewer
    rosrun acmp_mapping rerun_bridge.py --save session.rrd                        # for later: rerun session.rrd
    rosrun acmp_mapping rerun_bridge.py --connect rerun+http://HOST:9876/proxy    # a viewer that runs already

Exit code 1: Rerun is missing.
"""
import argparse
import sys

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Path
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

try:
    import rerun as rr
except ImportError as error:
    sys.exit("rerun_bridge: Rerun is missing (pip install rerun-sdk): %s" % error)

IMAGE = "world/camera/image"
OCCUPIED = 50  # of 100, from which on a cell is


def camera(message):
    yield IMAGE, rr.Pinhole(image_from_camera=np.reshape(message.K, (3, 3)), width=message.width, height=message.height,
                            camera_xyz=rr.ViewCoordinates.RDF)


def pose(message):
    p, q = message.pose.position, message.pose.orientation
    yield "world/camera", rr.Transform3D(translation=[p.x, p.y, p.z], quaternion=[q.x, q.y, q.z, q.w])


def color(message):
    yield IMAGE + "/rgb", rr.Image(np.frombuffer(message.data, "u1").reshape(message.height, message.width, 3))


def depth(message):
    z = np.frombuffer(message.data, "<f4").reshape(message.height, message.width)
    yield IMAGE + "/depth", rr.DepthImage(np.nan_to_num(z), meter=1.0)


def points(message):
    values = np.frombuffer(message.data, "<f4").reshape(-1, message.point_step // 4)  # all fields are float32
    column = {field.name: field.offset // 4 for field in message.fields}
    rgb = values[:, column["rgb"]].view("<u4")
    yield "world/map", rr.Points3D(values[:, [column[axis] for axis in "xyz"]],
                                   colors=np.stack([rgb >> 16 & 255, rgb >> 8 & 255, rgb & 255], 1).astype("u1"))


def path(message):
    positions = [pose.pose.position for pose in message.poses]
    yield "world/path", rr.LineStrips3D([[[p.x, p.y, p.z] for p in positions]], colors=[[255, 160, 0]])


def occupancy(message):
    """The occupied cells, as squares without height."""
    info, cell = message.info, message.info.resolution
    rows, cols = np.nonzero(np.reshape(message.data, (info.height, info.width)) >= OCCUPIED)
    centers = np.stack([cols + 0.5, rows + 0.5, 0 * rows], 1) * cell
    origin = info.origin.position
    yield "world/occupancy", rr.Boxes3D(centers=centers + [origin.x, origin.y, origin.z],
                                        half_sizes=np.tile([cell / 2, cell / 2, 0], (len(rows), 1)), fill_mode="solid")


TOPICS = {"depth/camera_info": (CameraInfo, camera), "keyframe_pose": (PoseStamped, pose),
          "rgb/image_rect_color": (Image, color), "depth/image_rect": (Image, depth), "map_points": (PointCloud2, points),
          "keyframe_path": (Path, path), "occupancy": (OccupancyGrid, occupancy)}


def send(message, convert):
    rr.set_time("stamp", timestamp=message.header.stamp.to_sec())
    for entity, value in convert(message):
        rr.log(entity, value)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--save", metavar="FILE")
    parser.add_argument("--connect", metavar="URL")
    parser.add_argument("--namespace", default="/acmp", help="of the mapper")
    arguments = parser.parse_args(rospy.myargv()[1:])
    rospy.init_node("rerun_bridge", anonymous=True)
    rr.init("acmp_mapping", spawn=not (arguments.save or arguments.connect))
    if arguments.save:
        rr.save(arguments.save)
    elif arguments.connect:
        rr.connect_grpc(arguments.connect)
    for topic, (kind, convert) in TOPICS.items():
        rospy.Subscriber(arguments.namespace + "/" + topic, kind, send, convert, queue_size=30, buff_size=2 ** 26)
    rospy.spin()


if __name__ == "__main__":
    main()
