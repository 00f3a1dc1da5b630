"""Make development scenes. usage: make.py OUT [INDEX ...] [--data DIR] [--force] [--without gloss bounced]

No index: all sixteen; an index from 300 on is a scene drawn with that seed. --without leaves an effect of light out, to see what it
costs; spec.json says so. Give such scenes a folder of their own.

OUT/NAME gets the layout of ../shared/data/rendered_scene; a finished scene holds a file DONE."""

import argparse
import dataclasses
import json
import time
from pathlib import Path

import numpy as np
import trimesh

import cameras
import deform
import shapes
import texture
import tools
import truth
from render import Stage
from render import texture as bitmap
from specs import SPECS, acts, name, spec_of

EXPLORE = 16
HERE = Path(__file__).resolve().parent


def subdivide(faces, count):
    """Each face in four: new faces (4 m, 3) and the vertex pairs (k, 2) whose midpoints are vertices count, count + 1, ..."""
    e = np.sort(np.stack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]], 1), -1)
    pairs, at = np.unique(e.reshape(-1, 2), axis=0, return_inverse=True)
    m = at.reshape(-1, 3) + count
    a, b, c = faces.T
    p, q, r = m.T
    return np.stack([np.c_[a, p, r], np.c_[b, q, p], np.c_[c, r, q], np.c_[p, q, r]], 1).reshape(-1, 3).astype(
        np.int32
    ), pairs


class Organ:
    """Rest mesh with atlas, textures and the solid's distance field."""

    def __init__(self, spec, data, rng):
        self.sdf = shapes.rotate_sdf(shapes.organ_sdf(spec, data, rng), rng)
        self.v, self.f, fine = shapes.surface(self.sdf, int(spec.vertices * (1.25 if spec.open else 1)))
        low = self.v[:, 2].min()
        self.low = low + 5.0 if spec.open else low
        if spec.open:
            self.v, self.f = shapes.cut_open(self.v, self.f, low + 5.0)
        self.size = 1536 if spec.size > 80 else 1024
        self.index, self.wedge, self.uv = texture.atlas(self.v, self.f, self.size)
        ok, at = texture.texels(self.v, self.f, self.wedge, self.uv, self.size)
        colour = texture.albedo(at, trimesh.Trimesh(self.v, self.f, process=False), spec.hue, spec.texture, rng)
        self.albedo = np.round(texture.fill(ok, colour) * 255).astype(np.uint8)
        self.film = texture.fill(ok, texture.film(at, int(rng.integers(1 << 30))))
        if fine:
            self.refine()
        mesh = trimesh.Trimesh(self.v, self.f, process=False)
        self.normals, self.area = np.array(mesh.vertex_normals), mesh.area

    def refine(self):
        """Halve every edge and move the new vertices onto the organ; the texture coordinates follow."""
        faces, pairs = subdivide(self.f, len(self.v))
        wedge, ends = subdivide(self.wedge, len(self.uv))
        self.v = np.vstack([self.v, shapes.onto(self.sdf, self.v[pairs].mean(1))])
        self.uv = np.vstack([self.uv, self.uv[ends].mean(1)])
        self.index = np.zeros(len(self.uv), np.int32)
        self.index[wedge] = faces
        self.f, self.wedge = faces, wedge

    def part(self, v):
        """Vertices, faces, normals and uv for rendering the organ at vertices v."""
        n = np.array(trimesh.Trimesh(v, self.f, process=False).vertex_normals)
        return v[self.index], self.wedge, n[self.index], self.uv


def make(index, out, data, without=()):
    """Write scene `index` under `out`, `without` some effects of light (`render.Stage`)."""
    spec, begin = spec_of(index), time.process_time()
    rng = np.random.default_rng(spec.seed)
    organ = Organ(spec, data, rng)
    wv, wf, wuv, wall, film = texture.wall(spec, organ.low, rng)
    wn = np.array(trimesh.Trimesh(wv, wf, process=False).vertex_normals)
    textures = [bitmap(organ.albedo, organ.film), bitmap(np.round(wall * 255), film)]
    frames = acts(spec)
    cam = cameras.camera(spec, rng)
    explore, still = cameras.paths(spec, EXPLORE, len(frames), rng)
    print(
        name(index), len(organ.v), "vertices", len(organ.f), "faces", f"{time.process_time() - begin:.0f} s", flush=True
    )
    eye = -still[0][0].T @ still[0][1]
    shape, held = deform.run(frames, organ.sdf, organ.v, organ.normals, eye, rng, shapes.VOXEL)
    print(f"  deformed after {time.process_time() - begin:.0f} s", flush=True)

    def stage(v, tool):
        return Stage([organ.part(v), (wv, wf, wn, wuv), tools.build(tool)], textures, spec.alpha, 0.05, without)

    truth.write(out / name(index), spec, organ, cam, explore, still, shape, held, frames, stage, rng)
    said = dict(without=sorted(without)) if without else {}
    (out / name(index) / "spec.json").write_text(json.dumps(dataclasses.asdict(spec) | said, indent=1))
    (out / name(index) / "DONE").write_text(f"{time.process_time() - begin:.0f} s of processor time\n")
    print(f"  done after {time.process_time() - begin:.0f} s", flush=True)


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("out", type=Path)
    ap.add_argument("index", type=int, nargs="*")
    ap.add_argument(
        "--data", type=Path, default=HERE.parents[2] / "shared/data", help="folder of organs_hra and organs_ucl"
    )
    ap.add_argument("--force", action="store_true", help="make finished scenes again")
    ap.add_argument("--without", nargs="+", choices=["gloss", "bounced"], default=[], help="effects of light to leave out")
    a = ap.parse_args()
    for i in a.index or range(len(SPECS)):
        if a.force or not (a.out / name(i) / "DONE").exists():
            make(i, a.out, a.data, a.without)


if __name__ == "__main__":
    main()
