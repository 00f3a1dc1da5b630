"""The acts of a spec as forces on the solid, one equilibrium per frame, and the tools that cause them."""

import numpy as np

from solid import Solid

TIP = (2.8, 3.8)  # radius of a probe's tip, mm


def unit(v):
    return v / np.linalg.norm(v)


def seen_sites(v, normals, eye, rng, count, apart):
    """Vertices that face the camera at `eye`, near the middle of what it sees, at least `apart` mm from each other."""
    facing = (normals * (eye - v)).sum(1) / np.linalg.norm(eye - v, axis=1)
    good = np.where(facing > 0.7)[0]
    middle = np.median(v[good], axis=0)
    far = np.linalg.norm((v - middle)[:, :2], axis=1)
    good = good[far[good] < np.quantile(far[good], 0.7)]
    sites = []
    for k in rng.permutation(good):
        if all(np.linalg.norm(v[k] - v[s]) > apart for s in sites):
            sites.append(int(k))
        if len(sites) == count:
            return sites
    return sites + [sites[0]] * (count - len(sites))


def attachment(solid, bent):
    """Stiffness per volume of what holds the organ: its underside, or for bending a patch under its middle."""
    z = solid.q[:, 2]
    low, high = z.min(), z.max()
    if bent:
        middle = np.median(solid.q, axis=0)
        patch = np.hypot(*(solid.q - middle)[:, :2].T) < 0.16 * np.ptp(solid.q, axis=0).max()
        return 0.5 * (patch & (z < low + 0.45 * (high - low)))
    return 0.5 * np.clip((low + 0.3 * (high - low) - z) / 3.0, 0, 1)


def curved(solid, kind, mm):
    """Where bending (upwards) or twisting about the long axis by `mm` at the ends takes the quadrature points."""
    centre = solid.q.mean(0)
    p = solid.q - centre
    axis = np.linalg.svd(p[:, :2], full_matrices=False)[2][0]
    a, n = np.array([axis[0], axis[1], 0.0]), np.array([0.0, 0.0, 1.0])
    s, h, c = p @ a, p @ n, p @ np.cross(n, a)
    half = abs(s).max()
    if kind == "bend":
        k = 2 * mm / half**2
        s, h = (1 / k - h) * np.sin(k * s), 1 / k - (1 / k - h) * np.cos(k * s)
    else:
        angle = s / half * mm / np.quantile(np.hypot(c, h), 0.97)
        c, h = c * np.cos(angle) - h * np.sin(angle), c * np.sin(angle) + h * np.cos(angle)
    return centre + s[:, None] * a + h[:, None] * n + c[:, None] * np.cross(n, a)


def trocar(site, normal, rng):
    """Where a tool enters, mm: oblique from above, roughly on the side of the surface normal."""
    angle = (
        np.arctan2(normal[1], normal[0]) + rng.uniform(-0.6, 0.6)
        if np.hypot(*normal[:2]) > 0.2
        else rng.uniform(-1.2, 1.2)
    )
    rise = np.deg2rad(rng.uniform(26, 38))
    return site + 110 * np.array([np.cos(angle) * np.cos(rise), np.sin(angle) * np.cos(rise), np.sin(rise)])


def handle(solid, site, move, reach):
    """Springs that take the tissue within `reach` mm of a surface point along `move` mm."""
    near = np.clip(1 - ((solid.q - site) ** 2).sum(1) / reach**2, 0, 1)
    return solid.springs(solid.q + move, 3.0 * near**2)


def run(frames, sdf, v, normals, eye, rng, voxel):
    """Deformed vertices (frames, n, 3) and the tools of every frame (dicts in world axes, mm)."""
    solid = Solid(sdf, v, voxel)
    bent = any(k in ("bend", "twist") for acts in frames for k, _, _ in acts)
    held = solid.springs(solid.q.copy(), attachment(solid, bent))
    sites = seen_sites(v, normals, eye, rng, 6, 0.2 * np.ptp(v, axis=0).max())
    entry = [trocar(v[k], normals[k], rng) for k in sites]
    radius = rng.uniform(*TIP)
    touched = sorted({a[:2] for acts in frames for a in acts if a[0] in ("push", "pull")}, key=lambda a: (a[1], a[0]))
    place = {a: i % len(sites) for i, a in enumerate(touched)}
    shapes, tools, u = [], [], np.zeros((solid.n, 3))
    for i, acts in enumerate(frames):
        if i and [a[:2] for a in acts] != [a[:2] for a in frames[i - 1]]:
            u = np.zeros((solid.n, 3))
        forces, shown = [held], []
        for kind, site, mm in acts:
            if kind in ("bend", "twist"):
                forces.append(solid.springs(curved(solid, kind, mm), np.full(len(solid.q), 0.03)))
                continue
            k = sites[place[kind, site]]
            n, tr = normals[k], entry[place[kind, site]]
            side = unit(tr - v[k])
            move = unit(0.75 * n + 0.35 * side) * mm if kind == "pull" else unit(-0.8 * n - 0.2 * side) * mm
            forces.append(handle(solid, v[k], move, 7.0 if kind == "pull" else radius + 3.0))
            shown.append(
                dict(
                    kind="grasper" if kind == "pull" else "probe",
                    vertex=k,
                    trocar=tr.tolist(),
                    normal=n.tolist(),
                    radius=radius,
                )
            )
        rounds, j = 0, 1.0
        if acts:
            u, rounds, j = solid.solve(u, forces)
        x = solid.vertices(u) if acts else v.copy()
        for t in shown:
            t["tip"] = (x[t["vertex"]] + (t["kind"] == "probe") * 0.85 * radius * np.array(t["normal"])).tolist()
        move = np.linalg.norm(x - v, axis=1)
        print(
            f"  frame {i} {acts} rounds {rounds} least J {j:.2f} moved {move.max():.1f} max {move.mean():.2f} mean mm",
            flush=True,
        )
        shapes.append(x)
        tools.append(shown)
    return np.array(shapes), tools
