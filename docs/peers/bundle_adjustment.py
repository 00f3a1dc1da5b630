"""Cost that Ceres (through pycolmap) reaches on the libmv problems: poses and points free, the shared
camera and the first pose held, squared errors.

    venv/bin/python docs/peers/bundle_adjustment.py PROBLEM.bin...
"""

import struct
import sys
import time

import numpy as np
import pycolmap


class Reader:
    def __init__(self, path):
        self.data, self.at = open(path, "rb").read(), 2

    def __call__(self, form):
        values = struct.unpack_from("<" + form, self.data, self.at)
        self.at += struct.calcsize("<" + form)
        return values


def load(path):
    """OpenCV camera, poses, points, sightings."""
    read = Reader(path)
    f, cx, cy, k1, k2, _, p1, p2 = read("8f")
    poses = {}
    for _ in range(read("i")[0]):
        number, *rt = read("i12f")
        poses[number] = (np.array(rt[:9]).reshape(3, 3).T, np.array(rt[9:]))
    points = {}
    for _ in range(read("i")[0]):
        number, *x = read("i3f")
        points[number] = np.array(x)
    sightings = [read("ii2f") for _ in range(read("i")[0])]
    return (f, f, cx, cy, k1, k2, p1, p2), poses, points, sightings


def main():
    for path in sys.argv[1:]:
        lens, poses, points, sightings = load(path)
        model = pycolmap.Reconstruction()
        camera = pycolmap.Camera(
            camera_id=1, model="OPENCV", width=int(2 * lens[2]), height=int(2 * lens[3]), params=lens
        )
        model.add_camera_with_trivial_rig(camera)
        seen = {number: [] for number in poses}
        tracks = {number: pycolmap.Track() for number in points}
        for image, point, x, y in sightings:
            tracks[point].add_element(image, len(seen[image]))
            seen[image].append((x, y))
        for number, (r, t) in poses.items():
            image = pycolmap.Image(
                name=str(number), keypoints=np.array(seen[number]).reshape(-1, 2), camera_id=1, image_id=number
            )
            model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pycolmap.Rotation3d(r), t))
        for number, x in points.items():
            model.add_point3D(x, tracks[number], np.zeros(3, np.uint8))

        def cost():
            total = 0.0
            for image in model.images.values():
                pose = image.cam_from_world()
                for p in image.points2D:
                    if p.has_point3D():
                        miss = camera.img_from_cam(pose * model.points3D[p.point3D_id].xyz) - p.xy
                        total += 0.5 * miss @ miss
            return total

        before = cost()
        config = pycolmap.BundleAdjustmentConfig()
        for number in poses:
            config.add_image(number)
        config.set_constant_cam_intrinsics(1)
        config.set_constant_rig_from_world_pose(min(poses))
        options = pycolmap.BundleAdjustmentOptions()
        began = time.time()
        pycolmap.create_default_bundle_adjuster(options, config, model).solve()
        print(f"| {path.split('/')[-1]} | {before:.6e} | {cost():.6e} | {time.time() - began:.2f} s |")


if __name__ == "__main__":
    main()
