#!/usr/bin/env python3
"""Compare `dsfms calibrate` with OpenCV and with published corners and intrinsics.

    pip install opencv-python-headless numpy
    dsfms calibrate IMAGES --board 14x10 --square 3mm -o camera.json
    python3 scripts/peer_calibration.py IMAGES camera.calibration/report.json \
        [--published K.txt distortion.txt]

Corners are compared with cv2.findChessboardCorners + cornerSubPix, with findChessboardCornersSB
and, where IMAGE.png.points.txt exists, with the published ones. cv2.calibrateCamera is then run on
each set of corners, k3 fixed.
"""

import argparse
import json
import pathlib

import cv2
import numpy as np


def corners_of(grey, size, sector):
    if sector:
        flags = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE
        ok, found = cv2.findChessboardCornersSB(grey, size, flags=flags)
        return found.reshape(size[1], size[0], 2) if ok else None
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    ok, found = cv2.findChessboardCorners(grey, size, flags=flags)
    if not ok:
        return None
    end = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    return cv2.cornerSubPix(grey, found, (11, 11), (-1, -1), end).reshape(size[1], size[0], 2)


def aligned(other, ours):
    """The board may be numbered from any of its corners."""
    ways = [other, other[::-1, ::-1], other[::-1], other[:, ::-1]]
    return min(ways, key=lambda w: np.nanmedian(np.linalg.norm(w - ours, axis=2)))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("images", type=pathlib.Path)
    parser.add_argument("report", type=pathlib.Path)
    parser.add_argument("--published", nargs=2, type=pathlib.Path)
    args = parser.parse_args()
    report = json.loads(args.report.read_text())
    columns, rows = report["board"]["corners"]
    size, square = (columns, rows), report["board"]["square"]
    board = np.array([[c, r, 0] for r in range(rows) for c in range(columns)], np.float32) * square
    sets = {"dsfms": [], "cornerSubPix": [], "SB": [], "published": []}
    for image in report["images"]:
        path = next(args.images.glob(image["image"] + ".*g"))
        grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        ours = np.full((rows, columns, 2), np.nan)
        for corner in image["corners"]:
            ours[corner["grid"][1], corner["grid"][0]] = corner["pixel"]
        found = {"cornerSubPix": corners_of(grey, size, False), "SB": corners_of(grey, size, True)}
        points = pathlib.Path(str(path) + ".points.txt")
        if points.exists():
            found["published"] = np.loadtxt(points)[:, -2:].reshape(rows, columns, 2)
        sets["dsfms"].append(ours)
        for name, other in found.items():
            if other is None:
                print(f"{image['image']}: {name} finds no board")
                continue
            other = aligned(other, ours)
            sets[name].append(other)
            off = other - ours
            d = np.linalg.norm(off, axis=2)
            mean = np.nanmean(off, axis=(0, 1))
            print(f"{image['image']}: {name} - dsfms: median {np.nanmedian(d):.3f} px, "
                  f"largest {np.nanmax(d):.3f}, mean ({mean[0]:+.3f}, {mean[1]:+.3f})")
    published = [np.loadtxt(p) for p in args.published] if args.published else None
    for name, views in sets.items():
        if len(views) < 3:
            continue
        keep = [~np.isnan(v[..., 0]).ravel() for v in views]
        objects = [board[k] for k in keep]
        pixels = [v.reshape(-1, 1, 2)[k].astype(np.float32) for v, k in zip(views, keep)]
        end = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 500, 1e-12)
        rms, k, d, _, _ = cv2.calibrateCamera(
            objects, pixels, tuple(report["size"]), None, None,
            flags=cv2.CALIB_FIX_K3, criteria=end)
        print(f"cv2.calibrateCamera on {name:12}: rms {rms:.4f} px  fx {k[0, 0]:.2f} fy {k[1, 1]:.2f} "
              f"cx {k[0, 2]:.2f} cy {k[1, 2]:.2f}  k1 k2 p1 p2 {np.round(d.ravel()[:4], 5)}")
        if published:
            sum_, count = 0.0, 0
            for o, p in zip(objects, pixels):
                _, r, t = cv2.solvePnP(o, p.astype(np.float64), *published)
                e = cv2.projectPoints(o, r, t, *published)[0].reshape(-1, 2) - p.reshape(-1, 2)
                sum_, count = sum_ + (e ** 2).sum(), count + len(e)
            print(f"    published intrinsics, poses free: rms {np.sqrt(sum_ / count):.4f} px")
    own = {e["name"]: e for e in report["intrinsics"]}
    words = [f"{n} {e['value']:.5g} +- {e['deviation']:.2g}" for n, e in own.items()]
    print(f"dsfms calibrate: rms {report['rms_px']:.4f} px ", ", ".join(words))


if __name__ == "__main__":
    main()
