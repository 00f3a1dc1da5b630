"""Cost that Ceres (through pycolmap) reaches on the libmv problems: poses and points free, the shared
camera and the first pose held, squared errors. Of Bundler's models (`.out`) every view has a focal
length and two distortions of its own, refined too; with `--shared` one camera for all, its centre too.

    venv/bin/python docs/peers/bundle_adjustment.py [--shared] PROBLEM.bin... BUNDLER.out...
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


def load_bundler(path, shared):
    """Cameras by view, poses, points, sightings; y down and z forward, pixels from the middle."""
    words = iter(open(path).read().split("\n", 1)[1].split())
    read = lambda n: [float(next(words)) for _ in range(n)]
    views, count = map(int, read(2))
    flip, own, poses, points, sightings = np.diag([1.0, -1.0, -1.0]), {}, {}, {}, []
    for view in range(views):
        f, k1, k2, *rt = read(15)
        own[view + 1] = (f, CENTRE, CENTRE, k1, k2)
        poses[view + 1] = (flip @ np.array(rt[:9]).reshape(3, 3), flip @ np.array(rt[9:]))
    for number in range(1, count + 1):
        points[number] = np.array(read(3))
        read(3)
        for _ in range(int(read(1)[0])):
            view, _, x, y = read(4)
            sightings.append((int(view) + 1, number, CENTRE + x, CENTRE - y))
    lenses = {1: tuple(np.mean(list(own.values()), 0))} if shared else own
    return "RADIAL", lenses, poses, points, sightings


# Room for the pixels of any image; only the middle matters.
CENTRE = 1e4


def load(path):
    """Model, cameras (of all views, or one each), poses, points, sightings."""
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
    return "OPENCV", {1: (f, f, cx, cy, k1, k2, p1, p2)}, poses, points, sightings


def main():
    shared = "--shared" in sys.argv
    for path in (a for a in sys.argv[1:] if not a.startswith("--")):
        bundler = path.endswith(".out")
        kind, lenses, poses, points, sightings = load_bundler(path, shared) if bundler else load(path)
        model = pycolmap.Reconstruction()
        for number, lens in lenses.items():
            middle = lens[1:3] if kind == "RADIAL" else lens[2:4]
            width, height = (int(2 * c) for c in middle)
            model.add_camera_with_trivial_rig(
                pycolmap.Camera(camera_id=number, model=kind, width=width, height=height, params=lens)
            )
        camera_of = {number: number if len(lenses) > 1 else 1 for number in poses}
        seen = {number: [] for number in poses}
        tracks = {number: pycolmap.Track() for number in points}
        for image, point, x, y in sightings:
            tracks[point].add_element(image, len(seen[image]))
            seen[image].append((x, y))
        for number, (r, t) in poses.items():
            image = pycolmap.Image(
                name=str(number),
                keypoints=np.array(seen[number]).reshape(-1, 2),
                camera_id=camera_of[number],
                image_id=number,
            )
            model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pycolmap.Rotation3d(r), t))
        for number, x in points.items():
            model.add_point3D(x, tracks[number], np.zeros(3, np.uint8))

        def cost():
            total = 0.0
            for image in model.images.values():
                pose, camera = image.cam_from_world(), model.cameras[image.camera_id]
                for p in image.points2D:
                    if p.has_point3D():
                        miss = camera.img_from_cam(pose * model.points3D[p.point3D_id].xyz) - p.xy
                        total += 0.5 * miss @ miss
            return total

        before = cost()
        config = pycolmap.BundleAdjustmentConfig()
        for number in poses:
            config.add_image(number)
        if not bundler:
            config.set_constant_cam_intrinsics(1)
        config.set_constant_rig_from_world_pose(min(poses))
        options = pycolmap.BundleAdjustmentOptions()
        options.refine_principal_point = bundler and shared
        options.print_summary = False
        began = time.time()
        pycolmap.create_default_bundle_adjuster(options, config, model).solve()
        print(f"| {path.split('/')[-1]} | {before:.6e} | {cost():.6e} | {time.time() - began:.2f} s |")


if __name__ == "__main__":
    main()
