"""Eight lines to a first surface: an exploration, a deformed frame, a camera."""

import sys
from pathlib import Path

import dsfms

scene = sys.argv[1] if len(sys.argv) > 1 else "dsfms-demo/scene"
camera = dsfms.read_camera(f"{scene}/camera.json")
template = dsfms.build_template(
    f"{scene}/exploration", camera, organ_masks=f"{scene}/exploration_masks", vertices=300
)
frame = sorted(Path(scene, "deformed").iterdir())[0]
surface = dsfms.reconstruct(template, frame, camera)
print(surface.status, *surface.reasons)
print(surface.vertices.shape, surface.pose)
