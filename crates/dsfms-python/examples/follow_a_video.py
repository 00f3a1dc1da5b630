"""Follow a video: one surface a frame, lost and found again."""

import sys

import numpy as np

import dsfms

template = dsfms.Template.load(sys.argv[1])
tracker = dsfms.Tracker(template, sys.argv[3] if len(sys.argv) > 3 else None)
for number, surface in enumerate(tracker.track(sys.argv[2])):
    if surface.status is dsfms.Status.LOST:
        print(number, "lost:", *surface.reasons)
        continue
    depth = float(np.median(surface.vertices[surface.visible, 2]))
    print(number, surface.status, f"median depth {depth:.1f} {template.unit}")
