"""Eight lines to a first surface: an exploration, a deformed frame, a camera."""

import sys

import dsfms

scene = sys.argv[1] if len(sys.argv) > 1 else "dsfms-demo/scene"
camera = dsfms.read_camera(f"{scene}/camera.json")
template = dsfms.build_template(
    f"{scene}/exploration", camera, organ_masks=f"{scene}/exploration_masks", vertices=300
)
surface = dsfms.reconstruct(template, f"{scene}/deformed/frame_000.jpg", camera)
print(surface.status, *surface.reasons)
print(surface.vertices.shape, surface.pose)
