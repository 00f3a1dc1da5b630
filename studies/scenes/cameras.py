"""Camera and its seeded paths: an exploration around the organ at rest, a nearly still look at the deformed one."""

import numpy as np

from render import Camera


def look_at(eye, target, roll):
    """Pose (R, t), X_cam = R X_world + t, x right, y down, z forward; roll in radians."""
    z = (target - eye) / np.linalg.norm(target - eye)
    x = np.cross(z, [0.0, 1.0, 0.0])
    x /= np.linalg.norm(x)
    c, s = np.cos(roll), np.sin(roll)
    r = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ np.stack([x, np.cross(z, x), z])
    return r, -r @ eye


def direction(ax, ay):
    """Unit vector from the organ to the camera at angles (degrees) about y and x."""
    ax, ay = np.deg2rad([ax, ay])
    return np.array([np.sin(ax) * np.cos(ay), np.sin(ay), np.cos(ax) * np.cos(ay)])


def camera(spec, rng):
    """640 x 480 with a seeded focal length and principal point."""
    f = rng.uniform(520, 600)
    return Camera(
        640,
        480,
        (round(f, 1), round(f * rng.uniform(0.998, 1.003), 1)),
        (round(319.5 + rng.uniform(-9, 9), 1), round(239.5 + rng.uniform(-7, 7), 1)),
        spec.distortion,
    )


def paths(spec, count, deformed, rng):
    """Poses of `count` exploration frames and of `deformed` frames."""
    look, d = np.array([0.0, 0.0, 3.0]), spec.distance
    wide, high, phase, lift = rng.uniform(32, 40), rng.uniform(24, 30), rng.uniform(0, 2 * np.pi), rng.uniform(-8, 4)
    explore, still = [], []
    for i in range(count):
        u = 2 * np.pi * i / count
        w = direction(wide * np.sin(u + phase), high * np.sin(2 * u + 0.9) + lift)
        target = look + np.array([4 * np.sin(1.3 * u), 4 * np.cos(1.9 * u), 0]) + rng.normal(0, 0.5, 3)
        eye = look + (d + 7 * np.sin(1.7 * u + phase)) * w + rng.normal(0, 0.4, 3)
        explore.append(look_at(eye, target, np.deg2rad(7 * np.sin(1.1 * u) + rng.normal(0, 0.7))))
    ax, ay, sway = rng.uniform(-10, 10), rng.uniform(-14, 6), rng.uniform(1.5, 4.5)
    for i in range(deformed):
        u = 2 * np.pi * i / deformed
        w = direction(ax + sway * np.sin(u), ay + 0.7 * sway * np.cos(1.6 * u))
        eye = look + (d - 3 + np.sin(2 * u + 1)) * w
        still.append(look_at(eye, look + rng.normal(0, 0.25, 3), np.deg2rad(2 * np.sin(u))))
    return explore, still
