"""Open3D on the cases that `cargo run --release --example register_ct -- DATA OUT` leaves in OUT.

    pip install open3d numpy
    python3 scripts/peer_register_ct.py OUT

With landmarks: RANSAC over the pairs (similarity), then point-to-plane ICP at that scale. Without: FPFH descriptors and RANSAC with scale, then the same ICP. The template's scale is unknown to it as
it is to dsfms; descriptors get both clouds at unit size. Errors: targets inside, mm, root mean square.
"""

import csv
import json
import sys
import time
from pathlib import Path

import numpy as np
import open3d as o3d

reg = o3d.pipelines.registration


def cloud(path, voxel):
    mesh = o3d.io.read_triangle_mesh(str(path))
    mesh.compute_vertex_normals()
    pcd = o3d.geometry.PointCloud(mesh.vertices)
    pcd.normals = mesh.vertex_normals
    return pcd.voxel_down_sample(voxel * np.linalg.norm(pcd.get_max_bound() - pcd.get_min_bound()))


def icp(source, target, start, distance):
    """Rigid point-to-plane from the pose and scale of `start`: with scale, Open3D's ICP shrinks parts to a point."""
    if not np.isfinite(start).all() or abs(np.linalg.det(start[:3, :3])) < 1e-6:
        return start
    placed = o3d.geometry.PointCloud(source).transform(start)
    estimate = reg.TransformationEstimationPointToPlane()
    criteria = reg.ICPConvergenceCriteria(max_iteration=200)
    moved = np.eye(4)
    for factor in (4, 2, 1):
        moved = reg.registration_icp(placed, target, factor * distance, moved, estimate, criteria).transformation
    return moved @ start


def with_landmarks(folder, source, target):
    rows = list(csv.DictReader(open(folder / "landmarks.csv")))
    points = {s: np.array([[float(r[f"{s}_{a}"]) for a in "xyz"] for r in rows]) for s in ("ct", "template")}
    clouds = [o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points[s])) for s in ("template", "ct")]
    pairs = o3d.utility.Vector2iVector([[i, i] for i in range(len(rows))])
    found = reg.registration_ransac_based_on_correspondence(
        clouds[0], clouds[1], pairs, 12.0, reg.TransformationEstimationPointToPoint(True), 3
    )
    return icp(source, target, found.transformation, 3.0)


def without(source, target):
    size = {}
    features = []
    scaled = []
    for name, pcd in (("s", source), ("t", target)):
        size[name] = np.linalg.norm(pcd.get_max_bound() - pcd.get_min_bound())
        unit = o3d.geometry.PointCloud(pcd).scale(1.0 / size[name], np.zeros(3))
        scaled.append(unit)
        features.append(reg.compute_fpfh_feature(unit, o3d.geometry.KDTreeSearchParamHybrid(0.12, 100)))
    found = reg.registration_ransac_based_on_feature_matching(
        scaled[0], scaled[1], features[0], features[1], True, 0.03, reg.TransformationEstimationPointToPoint(True), 3,
        [reg.CorrespondenceCheckerBasedOnDistance(0.03)], reg.RANSACConvergenceCriteria(200000, 0.999),
    )
    start = np.diag([size["t"]] * 3 + [1.0]) @ found.transformation @ np.diag([1 / size["s"]] * 3 + [1.0])
    return icp(source, target, start, 3.0)


def main():
    o3d.utility.random.seed(0)
    print("| case | scale error | target error, mm | s |\n| --- | --- | --- | --- |")
    for folder in sorted(p for p in Path(sys.argv[1]).iterdir() if (p / "truth.json").exists()):
        truth = json.loads((folder / "truth.json").read_text())
        source, target = cloud(folder / "template.ply", 0.02), cloud(folder / "ct.ply", 0.015)
        start = time.time()
        marked = len(open(folder / "landmarks.csv").readlines()) > 1
        found = with_landmarks(folder, source, target) if marked else without(source, target)
        seconds = time.time() - start
        if abs(np.linalg.det(found[:3, :3])) < 1e-6:
            print(f"| {folder.name} | no pose | | {seconds:.1f} |", flush=True)
            continue
        back = np.linalg.inv(found)
        targets, now = np.array(truth["targets"]), np.array(truth["now"])
        placed = targets @ back[:3, :3].T + back[:3, 3]
        error = truth["scale"] * np.sqrt(np.mean(np.sum((placed - now) ** 2, axis=1)))
        scale = np.cbrt(np.linalg.det(found[:3, :3])) / truth["scale"] - 1
        print(f"| {folder.name} | {100 * scale:+.1f} % | {error:.1f} | {seconds:.1f} |", flush=True)


main()
