"""Instruments as triangle meshes: a probe with a round tip, a grasper with two jaws. World mm."""

import numpy as np
import trimesh


def cone(a, b, ra, rb, n=48):
    """Closed cone frustum from a (radius ra) to b (radius rb)."""
    z = (b - a) / np.linalg.norm(b - a)
    x = np.cross(z, [0.3, 0.7, 0.2])
    x /= np.linalg.norm(x)
    t = np.arange(n) * 2 * np.pi / n
    ring = np.cos(t)[:, None] * x + np.sin(t)[:, None] * np.cross(z, x)
    v = np.vstack([a + ra * ring, b + rb * ring, [a], [b]])
    i = np.arange(n)
    j = (i + 1) % n
    f = np.vstack(
        [np.c_[i, j, n + j], np.c_[i, n + j, n + i], np.c_[j, i, i * 0 + 2 * n], np.c_[n + i, n + j, i * 0 + 2 * n + 1]]
    )
    return trimesh.Trimesh(v, f, process=False)


def ball(centre, radius):
    """Icosphere."""
    s = trimesh.creation.icosphere(3, radius=radius)
    s.apply_translation(centre)
    return s


def build(tools):
    """Vertices, faces, normals and dummy uv of all tools of a frame; a speck far away where there is none."""
    parts = [ball(np.array([0.0, 0.0, -900.0]), 0.1)]
    for t in tools:
        tip = np.array(t["tip"])
        u = np.array(t["trocar"]) - tip
        u /= np.linalg.norm(u)
        if t["kind"] == "probe":
            r = 0.95 * t["radius"]
            parts += [
                ball(tip, r),
                cone(tip, tip + u * 150, r * 0.985, r * 0.985),
                cone(tip + u * 24, tip + u * 25.5, r * 1.08, r * 1.08),
            ]
            continue
        side = np.cross(u, t["normal"])
        side /= np.linalg.norm(side)
        base = tip + u * 13
        parts += [cone(base + u * 3, tip + u * 150, 2.5, 2.5), cone(base, base + u * 3.2, 2.0, 2.5)]
        for s in (-1, 1):
            end = tip + side * s * 1.3 - u * 1.5
            parts += [cone(end, base + side * s, 0.75, 1.35), ball(end, 0.78)]
    m = trimesh.util.concatenate(parts)
    v = m.vertices[m.faces].reshape(-1, 3)  # flat shading: every face has its own vertices
    flat = np.repeat(m.face_normals, 3, axis=0)
    soft = m.vertex_normals[m.faces].reshape(-1, 3)
    n = np.where((soft * flat).sum(1, keepdims=True) > 0.8, soft, flat)
    return v, np.arange(len(v)).reshape(-1, 3), n, np.zeros((len(v), 2))
