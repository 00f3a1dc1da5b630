"""Write one scene: pictures, masks, camera.json and the ground truth, in the layout of ../shared/data/rendered_scene."""

import csv
import json

import numpy as np
import trimesh
from PIL import Image

from render import OFFSETS, encode

NOISE = {False: (40000, 0.0015), True: (9000, 0.003)}  # electrons at 1.0, read noise (linear)
FALLOFF = "inverse square times a spot profile: 1 within 10 deg of the optical axis, falling linearly with the angle to 0 at 52 deg"


def camera_json(spec, cam):
    """Intrinsics, tone curve, light and noise."""
    electrons, read = NOISE[spec.noisy]
    return dict(
        width=cam.width,
        height=cam.height,
        fx=cam.f[0],
        fy=cam.f[1],
        cx=cam.c[0],
        cy=cam.c[1],
        distortion_model="brown_conrady (OpenCV: k1,k2,p1,p2,k3=0)",
        distortion=dict(zip(("k1", "k2", "p1", "p2"), cam.dist)),
        pixel_convention="OpenCV: the centre of the top-left pixel is (0,0)",
        axes="x right, y down, z forward; millimetres",
        tone_curve="8-bit value = round(255*OETF(clip(exposure-scaled linear radiance,0,1))), OETF = sRGB (IEC 61966-2-1: 12.92*x if x<=0.0031308 else 1.055*x^(1/2.4)-0.055), same for R,G,B; fixed exposure for the whole scene",
        light=dict(
            kind=spec.light,
            offsets_mm_camera_frame=[list(o) for o in OFFSETS[spec.light]],
            falloff=FALLOFF,
            note="rigidly attached to the camera",
        ),
        noise=f"on linear values before the OETF: Poisson with {electrons} electrons at 1.0, then Gaussian sigma {read}"
        + ("; JPEG quality 90, 4:2:0" if spec.noisy else ""),
        image_format="jpg" if spec.noisy else "png",
    )


def write_ply(path, v, f):
    """Binary PLY, mm."""
    head = f"ply\nformat binary_little_endian 1.0\ncomment units mm\nelement vertex {len(v)}\nproperty float x\nproperty float y\nproperty float z\nelement face {len(f)}\nproperty list uchar int vertex_indices\nend_header\n"
    faces = np.empty(len(f), dtype=[("n", "u1"), ("i", "<i4", 3)])
    faces["n"], faces["i"] = 3, f
    path.write_bytes(head.encode() + np.ascontiguousarray(v, "<f4").tobytes() + faces.tobytes())


def write_obj(path, organ):
    """OBJ with uv and albedo.png; order of vertices and faces as in every PLY of the scene."""
    with open(path, "w") as out:
        out.write(
            "# units mm; v order and f order equal those of every PLY of this scene\nmtllib rest_world.mtl\nusemtl organ\n"
        )
        out.writelines("v %.5f %.5f %.5f\n" % tuple(p) for p in organ.v)
        out.writelines("vt %.6f %.6f\n" % tuple(t) for t in organ.uv)
        out.writelines(
            "f %d/%d %d/%d %d/%d\n" % tuple(np.stack([a, b], -1).ravel()) for a, b in zip(organ.f + 1, organ.wedge + 1)
        )
    path.with_suffix(".mtl").write_text("newmtl organ\nKd 1 1 1\nmap_Kd albedo.png\n")


def picture(path, image, spec, rng):
    """Sensor noise, tone curve, file; returns its path relative to the scene."""
    electrons, read = NOISE[spec.noisy]
    noisy = rng.poisson(np.clip(image, 0, 1.5) * electrons) / electrons + rng.normal(0, read, image.shape)
    made = Image.fromarray(np.round(encode(np.clip(noisy, 0, 1)) * 255).astype(np.uint8))
    path = path.with_suffix(".jpg" if spec.noisy else ".png")
    made.save(path, **(dict(quality=90, subsampling=2) if spec.noisy else {}))
    return f"{path.parent.name}/{path.name}"


def extension(v0, v, f):
    """Statistics of edge extension in percent."""
    e = np.unique(np.sort(np.vstack([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), 1), axis=0)
    r = 100 * (np.linalg.norm(v[e[:, 0]] - v[e[:, 1]], axis=1) / np.linalg.norm(v0[e[:, 0]] - v0[e[:, 1]], axis=1) - 1)
    a = abs(r)
    return dict(
        mean_abs=a.mean(),
        mean_signed=r.mean(),
        p95_abs=np.percentile(a, 95),
        p95_ext=np.percentile(r, 95),
        max=r.max(),
        min=r.min(),
    )


def farthest(p, n):
    """Indices of n points of p (k, 3) by farthest-point sampling."""
    chosen, d = [0], np.linalg.norm(p - p[0], axis=1)
    while len(chosen) < min(n, len(p)):
        chosen.append(int(d.argmax()))
        d = np.minimum(d, np.linalg.norm(p - p[chosen[-1]], axis=1))
    return chosen


def inside(px, z, cam):
    """Which projections lie in the picture."""
    return (px >= -0.5).all(1) & (px[:, 0] <= cam.width - 0.5) & (px[:, 1] <= cam.height - 0.5) & (z > 0)


def rows(path, which, points, px, seen):
    """Correspondences as CSV: face (0-based), barycentrics, noise-free pixel, visible."""
    face, bary = points
    with open(path, "w") as out:
        out.write("point_id,face,b1,b2,b3,x,y,visible\n")
        out.writelines("%d,%d,%.7f,%.7f,%.7f,%.4f,%.4f,%d\n" % (k, face[k], *bary[k], *px[k], seen[k]) for k in which)


def at(v, f, points):
    """World positions of surface points (face, barycentrics)."""
    return (v[f[points[0]]] * points[1][:, :, None]).sum(1)


def write(out, spec, organ, cam, explore, still, shape, held, frames, stage, rng):
    """Render and write everything; `shape` (frames, n, 3) and `held` (tools) come from the solid."""
    truth = out / "ground_truth"
    for d in ("exploration_depth", "deformed_depth", "deformed_meshes_cam", "deformed_meshes_world", "correspondences"):
        (truth / d).mkdir(parents=True, exist_ok=True)
    for d in ("exploration", "deformed", "masks/exploration", "masks/deformed"):
        (out / d).mkdir(parents=True, exist_ok=True)
    (out / "camera.json").write_text(json.dumps(camera_json(spec, cam), indent=1))
    write_obj(truth / "rest_world.obj", organ)
    write_ply(truth / "rest_world.ply", organ.v, organ.f)
    Image.fromarray(organ.albedo).save(truth / "albedo.png")
    rest = stage(organ.v, [])
    _, _, mask, _ = rest.depths(cam, still[0])
    exposure = 0.72 / np.percentile(rest.render(cam, still[0], spec.light, 999).max(-1)[mask], 93)

    def frame(kind, i, now, pose):
        image = now.render(cam, pose, spec.light, i + 1 + 500 * (kind == "deformed")) * exposure
        z, alone, organ_mask, tool = now.depths(cam, pose)
        depth = dict(depth=z) if kind == "exploration" else dict(depth=z, organ_depth_unoccluded=alone)
        np.savez_compressed(truth / f"{kind}_depth/frame_{i:03d}.npz", **depth)
        Image.fromarray((organ_mask * 255).astype(np.uint8)).save(out / f"masks/{kind}/organ_{i:03d}.png")
        if kind == "deformed":
            Image.fromarray((tool * 255).astype(np.uint8)).save(out / f"deformed/instrument_mask_{i:03d}.png")
        d = z[organ_mask]
        return dict(
            frame=i,
            image=picture(out / kind / f"frame_{i:03d}", image, spec, rng),
            R=pose[0].tolist(),
            t=pose[1].tolist(),
            organ_fraction=round(float(organ_mask.mean()), 4),
            instrument_fraction=round(float(tool.mean()), 4),
            organ_depth_min=round(float(d.min()), 2),
            organ_depth_median=round(float(np.median(d)), 2),
            saturated_fraction=round(float((image[organ_mask].max(-1) > 1).mean()), 5),
        )

    f, centre = organ.f, organ.v[organ.f].mean(1)
    face_normals = np.array(trimesh.Trimesh(organ.v, f, process=False).face_normals)
    seen_f, seen_v = np.zeros(len(f), int), np.zeros(len(organ.v), int)
    poses = dict(
        convention="X_cam = R*X_world + t (mm, OpenCV axes)",
        K=[[cam.f[0], 0, cam.c[0]], [0, cam.f[1], cam.c[1]], [0, 0, 1]],
        exploration=[],
        deformed=[],
    )
    for i, pose in enumerate(explore):
        poses["exploration"].append(frame("exploration", i, rest, pose))
        seen_f += rest.visible(centre, face_normals, pose) & inside(*cam.project(centre, pose), cam)
        seen_v += rest.visible(organ.v, organ.normals, pose) & inside(*cam.project(organ.v, pose), cam)
    np.save(truth / "rest_vertex_seen_count.npy", seen_v.astype(np.int16))
    area = np.linalg.norm(np.cross(organ.v[f[:, 1]] - organ.v[f[:, 0]], organ.v[f[:, 2]] - organ.v[f[:, 0]]), axis=1)
    area = area * (
        (seen_f >= 3) & rest.visible(centre, face_normals, still[0]) & inside(*cam.project(centre, still[0]), cam)
    )
    u = rng.random((500, 2))
    root = np.sqrt(u[:, 0])
    points = (
        rng.choice(len(f), 500, p=area / area.sum()),
        np.stack([1 - root, root * (1 - u[:, 1]), root * u[:, 1]], -1),
    )
    table = []
    for i, pose in enumerate(still):
        v, now = shape[i], stage(shape[i], held[i])
        record = frame("deformed", i, now, pose)
        mesh = trimesh.Trimesh(v, f, process=False)
        write_ply(truth / f"deformed_meshes_cam/frame_{i:03d}.ply", v @ pose[0].T + pose[1], f)
        write_ply(truth / f"deformed_meshes_world/frame_{i:03d}.ply", v, f)
        p = at(v, f, points)
        px, z = cam.project(p, pose)
        seen = now.visible(p, mesh.face_normals[points[0]], pose) & inside(px, z, cam)
        rows(truth / f"correspondences/frame_{i:03d}.csv", range(500), points, px, seen)
        moved, which = np.linalg.norm(p - at(organ.v, f, points), axis=1), np.where(seen)[0]
        quiet = which[moved[which] <= max(0.5 * moved[which].max(), 1e-9)]
        if len(quiet) < 25:
            quiet = which[np.argsort(moved[which])[:25]]
        rows(truth / f"correspondences/frame_{i:03d}_sparse25.csv", quiet[farthest(p[quiet], 25)], points, px, seen)
        displacement = np.linalg.norm(v - organ.v, axis=1)
        px, z = cam.project(v, pose)
        visible = now.visible(v, mesh.vertex_normals, pose) & inside(px, z, cam)
        np.savez_compressed(
            truth / f"deformed_meshes_cam/frame_{i:03d}_vertices.npz",
            visible=visible,
            displacement=displacement.astype(np.float32),
            pixel=px.astype(np.float32),
        )
        record.update(
            n_visible_correspondences=int(seen.sum()),
            max_displacement_mm=round(float(displacement.max()), 3),
            mean_displacement_mm=round(float(displacement.mean()), 3),
            extension_percent={k: round(float(x), 3) for k, x in extension(organ.v, v, f).items()},
            acts=[f"{k}{s + 1}:{mm:g}" for k, s, mm in frames[i]],
            instruments=[t["kind"] for t in held[i]],
            body_force=False,
        )
        poses["deformed"].append(record)
        e = record["extension_percent"]
        table.append(
            [
                i,
                *e.values(),
                record["max_displacement_mm"],
                record["mean_displacement_mm"],
                record["instrument_fraction"],
                "+".join(record["instruments"]) or "none",
                0,
            ]
        )
    (truth / "poses.json").write_text(json.dumps(poses, indent=1))
    with open(truth / "extension.csv", "w", newline="") as out_csv:
        w = csv.writer(out_csv)
        w.writerow(
            "frame,ext_mean_abs_pct,ext_mean_signed_pct,ext_p95_abs_pct,ext_p95_pct,ext_max_pct,ext_min_pct,max_disp_mm,mean_disp_mm,instrument_pixel_fraction,instruments,body_force".split(
                ","
            )
        )
        w.writerows(table)
