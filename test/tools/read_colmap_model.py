"""Reads FOLDER/images and FOLDER/sparse/0/*.bin as gaussian-splatting and nerfstudio do, and checks what they rely on:
pinhole cameras, images of their size, points that lie where their features say and have the colours of the images. Ends with 1
and a message where something is wrong."""

import argparse
import pathlib
import struct

import numpy as np
from PIL import Image

MAX_REPROJECTION_PX = 1e-6  # a feature is the projection of its point, in doubles


class Reader:
    def __init__(self, path):
        self.path, self.bytes, self.place = path, path.read_bytes(), 0

    def values(self, layout):
        values = struct.unpack_from("<" + layout, self.bytes, self.place)
        self.place += struct.calcsize("<" + layout)
        return values

    def text(self):
        end = self.bytes.index(b"\0", self.place)
        text = self.bytes[self.place:end].decode()
        self.place = end + 1
        return text

    def records(self):
        for _ in range(self.values("Q")[0]):
            yield self
        assert self.place == len(self.bytes), f"{self.path}: {len(self.bytes) - self.place} bytes too many"


def rotation(w, x, y, z):
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def read(folder):
    model = folder / "sparse/0"
    cameras, images, points = {}, {}, {}
    for file in Reader(model / "cameras.bin").records():
        number, kind, width, height = file.values("IiQQ")
        assert kind == 1, f"camera {number} is of model {kind}, not PINHOLE"
        cameras[number] = (width, height, *file.values("4d"))
    for file in Reader(model / "images.bin").records():
        number, *pose, camera = file.values("I7dI")
        name, (features,) = file.text(), file.values("Q")
        data = np.frombuffer(file.bytes, np.dtype([("pixel", "<f8", 2), ("point", "<i8")]), features, file.place)
        file.place += data.nbytes
        images[number] = (name, camera, rotation(*pose[:4]), np.array(pose[4:]), data)
    for file in Reader(model / "points3D.bin").records():
        number, x, y, z, r, g, b, _, length = file.values("Q3d3BdQ")
        points[number] = ((x, y, z), (r, g, b), np.reshape(file.values(f"{2 * length}I"), (-1, 2)))
    return cameras, images, points


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--min-points", type=int, default=100)
    parser.add_argument("--min-shared", type=float, default=0.3, help="share of the points that two images or more see")
    parser.add_argument("--max-colour", type=float, default=20, help="median over an image's points of the difference to its "
                        "pixel: points are means of several views, whose exposures may differ")
    arguments = parser.parse_args()
    cameras, images, points = read(arguments.folder)
    assert len(points) >= arguments.min_points, f"{len(points)} points, must be at least {arguments.min_points}"
    shared = sum(len(track) > 1 for _, _, track in points.values()) / len(points)
    assert shared >= arguments.min_shared, f"{shared:.2f} of the points are seen by two images or more"
    for point, (_, _, track) in points.items():
        for image, feature in track:
            assert images[image][4]["point"][feature] == point, f"point {point} is not what image {image} says it sees"
    files = {str(path.relative_to(arguments.folder / "images")) for path in (arguments.folder / "images").rglob("*.*")}
    assert files == {image[0] for image in images.values()}, f"images/ has {files}"
    differences = []
    for name, camera, turn, shift, features in images.values():
        width, height, fx, fy, cx, cy = cameras[camera]
        picture = np.asarray(Image.open(arguments.folder / "images" / name).convert("RGB")).astype(float)
        assert picture.shape == (height, width, 3), f"{name} is of {picture.shape}, its camera of {width} x {height}"
        if not len(features):
            continue
        seen = [points[point] for point in features["point"]]
        x, y, z = (np.array([point[0] for point in seen]) @ turn.T + shift).T
        assert (z > 0).all(), f"{name} sees points behind it"
        pixels = np.stack([fx * x / z + cx, fy * y / z + cy], 1)
        error = np.abs(pixels - features["pixel"]).max()
        assert error <= MAX_REPROJECTION_PX, f"{name}: a feature lies {error} px beside its point"
        col, row = np.floor(pixels).astype(int).T  # pixel centres at +0.5
        difference = np.abs(picture[row.clip(0, height - 1), col.clip(0, width - 1)] - [point[1] for point in seen])
        differences.append(np.median(difference))
        assert differences[-1] <= arguments.max_colour, f"{name}: points differ by {differences[-1]} from the image's colours"
    tracks = np.mean([len(track) for _, _, track in points.values()])
    print(f"{len(images)} images, {len(cameras)} cameras, {len(points)} points, {shared:.0%} of them shared, "
          f"{tracks:.1f} images each; colours within {np.mean(differences):.1f}")


if __name__ == "__main__":
    try:
        main()
    except AssertionError as error:
        raise SystemExit(f"read_colmap_model.py: {error}")
