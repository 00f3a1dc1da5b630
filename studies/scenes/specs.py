"""The sixteen scenes. Even indices are for choosing defaults ("choose"), odd ones stay untouched ("held")."""

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


def name(index):
    """Folder of a scene: its index, its half and its organ."""
    return f"{index:02d}-{'held' if index % 2 else 'choose'}-{SPECS[index].organ}"


def acts(spec):
    """Frames as lists of (kind, site, mm); the first frame has none."""
    frames = []
    for frame in spec.frames.split(";"):
        words = [w.split(":") for w in frame.split() if w != "rest"]
        frames.append(
            [(k.rstrip("0123456789"), int(k[-1]) - 1 if k[-1].isdigit() else 0, float(mm)) for k, mm in words]
        )
    return frames
