#!/usr/bin/env python3
"""Check an exported COLMAP model with pycolmap.

    pip install pycolmap
    dsfms export organ.template --colmap model --binary
    python3 scripts/peer_colmap.py model

Reads the model, projects every point into every image of its track with pycolmap's own camera and
compares with the stored observation: a wrong pixel convention would show as a mean of half a pixel.
"""

import sys

import numpy as np
import pycolmap


def main():
    model = pycolmap.Reconstruction(sys.argv[1])
    print(model.summary())
    off = []
    for point in model.points3D.values():
        for element in point.track.elements:
            image = model.images[element.image_id]
            seen = image.project_point(point.xyz)
            if seen is None:
                sys.exit(f"point behind image {image.name}")
            off.append(seen - image.points2D[element.point2D_idx].xy)
    off = np.array(off)
    d = np.linalg.norm(off, axis=1)
    print(f"{len(d)} observations: mean {d.mean():.3f} px, median {np.median(d):.3f} px, "
          f"mean offset ({off[:, 0].mean():+.3f}, {off[:, 1].mean():+.3f}) px")


if __name__ == "__main__":
    main()
