"""What a call from Python costs over the library: wall time of the call less the time of its stages.

    python scripts/python_overhead.py dsfms-demo/scene clip [calls]

SCENE is that of `dsfms demo`, CLIP one of `dsfms synth --video` (1280x720 by default). The difference is an
upper bound: checks of the library outside its stages count too.
"""

import sys
import time

import numpy as np

import dsfms

scene, clip = sys.argv[1:3]
calls = int(sys.argv[3]) if len(sys.argv) > 3 else 20


def row(name: str, walls: list[float], insides: list[float]) -> None:
    """Medians of a kind of call."""
    over = np.array(walls) - np.array(insides)
    wall, extra = np.median(walls), np.median(over)
    print(f"{name:<36}{1e3 * wall:10.2f} ms{1e3 * extra:10.3f} ms{100 * extra / wall:8.2f} %")


def measure(call: object) -> tuple[float, float]:
    """Wall time of a call and the time within its stages."""
    begin = time.perf_counter()
    surface = call()  # type: ignore[operator]
    wall = time.perf_counter() - begin
    return wall, sum(surface.seconds.values())


camera = dsfms.read_camera(f"{scene}/camera.json")
template = dsfms.build_template(f"{scene}/exploration", camera, organ_masks=f"{scene}/exploration_masks")
image = next(dsfms.Frames(f"{scene}/deformed"))
print(f"{'call':<36}{'wall':>13}{'overhead':>13}{'share':>10}")
for method in ("dsfm", "joint"):
    times = [measure(lambda m=method: dsfms.reconstruct(template, image, camera, method=m)) for _ in range(calls)]
    row(f"reconstruct {method} 640x480", *map(list, zip(*times, strict=True)))
organ = dsfms.Template.load(f"{clip}/organ.template")
frames = list(dsfms.Frames(f"{clip}/frames", 0, calls))
height, width = frames[0].shape[:2]
for realtime in (False, True):
    tracker = dsfms.Tracker(organ, f"{clip}/camera.json", realtime=realtime)
    times = [measure(lambda f=frame: tracker.push(f)) for frame in frames]
    name = f"Tracker.push {width}x{height}" + (" realtime" if realtime else "")
    row(name, *map(list, zip(*times, strict=True)))
# A black frame is refused at once: what is left is the way to the library and back.
black = np.zeros_like(frames[0])
times = [measure(lambda: tracker.push(black)) for _ in range(calls)]
row(f"Tracker.push {width}x{height} black", *map(list, zip(*times, strict=True)))
