"""The sixteen scenes. Even indices are for choosing defaults ("choose"), odd ones stay untouched ("held").

Any number from 300 on is a scene too ("drawn"): its spec is drawn with that seed, so that scenes nobody looked at never run out."""

import random
from dataclasses import dataclass

# A deformed frame is a list of acts "KIND SITE:MM": push and pull go to a seeded place of the seen surface (1, 2, ...),
# `bend` curves the whole organ along its long axis so that its ends move by MM, `twist` likewise about it.
PUSH = "rest; push1:3; push1:6; push1:9; push2:4; push2:8; push3:6; push1:5 push2:5; push3:10"
PULL = "rest; pull1:3; pull1:6; pull1:10; pull2:4; pull2:8; pull3:7; pull1:5 pull2:5; pull3:12"
BEND = "rest; bend:3; bend:6; bend:9; bend:12; bend:-4; bend:-8; twist:6; bend:6 twist:4"
BOTH = "rest; push1:4; push1:8; pull1:4; pull1:9; bend:5; bend:10; bend:6 push1:6; bend:-5 pull1:7; pull2:12"
ALL = "rest; push1:5; push1:10; pull1:5; pull1:10; bend:5; bend:11; twist:7; push2:8 pull1:6; bend:6 pull2:6"


@dataclass(frozen=True)
class Spec:
    """One scene; lengths in mm. `texture` scales the contrast of the albedo (1 rich, 0.2 faint)."""

    seed: int
    organ: str
    size: float
    vertices: int
    frames: str
    texture: float = 1.0
    light: str = "colocated"
    open: bool = False
    distortion: tuple = (0.0, 0.0, 0.0, 0.0)
    noisy: bool = False
    alpha: float = 0.10
    distance: float = 80.0
    hue: str = "pink"


SPECS = [
    Spec(101, "pear", 52, 9000, BOTH, 1.0, "offset", hue="pink"),
    Spec(102, "bean", 58, 10000, BOTH, 0.9, "colocated", hue="liver"),
    Spec(103, "uterus", 72, 10000, BOTH, 0.6, "colocated", distortion=(-0.18, 0.04, 0.001, -0.0005), noisy=True),
    Spec(
        104,
        "lobe",
        84,
        12000,
        PUSH,
        0.7,
        "ring",
        open=True,
        distortion=(-0.12, 0.02, 0.0, 0.0),
        hue="liver",
        distance=88,
    ),
    Spec(105, "kidney", 66, 9000, ALL, 0.35, "ring", alpha=0.07, hue="liver"),
    Spec(106, "gallbladder", 58, 6000, PULL, 0.8, "offset", noisy=True, hue="green"),
    Spec(107, "sac", 66, 3000, BEND, 0.8, "offset", distortion=(-0.22, 0.05, -0.0008, 0.0006), hue="green"),
    Spec(108, "pear", 56, 18000, ALL, 0.3, "ring", distortion=(0.08, -0.02, 0.0, 0.0), alpha=0.07),
    Spec(109, "liver-ucl", 90, 24000, PUSH, 0.7, "colocated", open=True, hue="liver", distance=88),
    Spec(110, "spleen", 72, 3000, BOTH, 0.5, "colocated", noisy=True, hue="purple"),
    Spec(111, "blob", 56, 6000, PULL, 0.2, "offset", noisy=True, alpha=0.13),
    Spec(112, "uterus", 70, 48000, BEND, 0.9, "offset", distortion=(-0.15, 0.03, 0.001, 0.0), alpha=0.12),
    Spec(113, "spleen", 70, 48000, ALL, 0.9, "ring", distortion=(-0.1, 0.01, 0.0, 0.001), hue="purple"),
    Spec(114, "blob", 54, 10000, PUSH, 0.2, "colocated", alpha=0.08),
    Spec(115, "bladder", 56, 4000, BEND, 0.4, "colocated", open=True, noisy=True),
    Spec(116, "sac", 64, 5000, BOTH, 0.6, "ring", open=True, distortion=(-0.2, 0.05, 0.0, 0.0), noisy=True),
]


# Organs a scene is drawn from, with the range of their size in mm; the flat ones lie further away, as in SPECS.
SIZES = {
    "pear": (50, 58),
    "bean": (54, 62),
    "lobe": (80, 90),
    "sac": (62, 68),
    "blob": (52, 58),
    "uterus": (68, 74),
    "gallbladder": (56, 60),
    "kidney": (62, 68),
    "spleen": (68, 74),
    "bladder": (54, 58),
    "liver-ucl": (84, 92),
}
FIRST_DRAWN = 300


def drawn(seed):
    """The spec of a seed: every choice uniform over about the range of SPECS (vertices in their logarithm), nine frames of one or two acts."""
    rng = random.Random(seed)
    organ = rng.choice(sorted(SIZES))
    flat = organ in ("lobe", "liver-ucl")

    def act():
        kind = rng.choice(["push", "pull", "bend", "twist"])
        far = {"push": 10, "pull": 12, "bend": 12, "twist": 7}[kind]
        mm = rng.uniform(0.3, 1.0) * far * (rng.choice([1, -1]) if kind == "bend" else 1)
        return f"{kind}{rng.randint(1, 3) if kind in ('push', 'pull') else ''}:{mm:.0f}"

    def frame():
        first, second = act(), act()
        return f"{first} {second}" if rng.random() < 0.3 and first.split(":")[0] != second.split(":")[0] else first

    return Spec(
        seed=seed,
        organ=organ,
        size=round(rng.uniform(*SIZES[organ])),
        vertices=1000 * round(3 * 16 ** rng.random()),
        frames="; ".join(["rest"] + [frame() for _ in range(9)]),
        texture=round(rng.uniform(0.2, 1.0), 2),
        light=rng.choice(["colocated", "offset", "ring"]),
        open=flat or rng.random() < 0.2,
        distortion=rng.choice([(0.0, 0.0, 0.0, 0.0), (round(rng.uniform(-0.22, 0.08), 3), 0.03, 0.0005, -0.0005)]),
        noisy=rng.random() < 0.4,
        alpha=round(rng.uniform(0.07, 0.13), 3),
        distance=88.0 if flat else 80.0,
        hue=rng.choice(["pink", "liver", "green", "purple"]),
    )


def spec_of(index):
    """The spec of an index of SPECS, or of a seed from FIRST_DRAWN on."""
    return SPECS[index] if index < FIRST_DRAWN else drawn(index)


def name(index):
    """Folder of a scene: its index, its half (or "drawn") and its organ."""
    half = "drawn" if index >= FIRST_DRAWN else "held" if index % 2 else "choose"
    return f"{index:02d}-{half}-{spec_of(index).organ}"


def acts(spec):
    """Frames as lists of (kind, site, mm); the first frame has none."""
    frames = []
    for frame in spec.frames.split(";"):
        words = [w.split(":") for w in frame.split() if w != "rest"]
        frames.append(
            [(k.rstrip("0123456789"), int(k[-1]) - 1 if k[-1].isdigit() else 0, float(mm)) for k, mm in words]
        )
    return frames
