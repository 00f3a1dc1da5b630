"""Contact sheet of a scene. usage: sheet.py SCENE OUT.png"""

import sys
from pathlib import Path

from PIL import Image


def main():
    scene, out = Path(sys.argv[1]), sys.argv[2]
    explore = sorted((scene / "exploration").iterdir())[::3]
    deformed = sorted(p for p in (scene / "deformed").iterdir() if p.name.startswith("frame_"))
    pictures = explore + deformed
    sheet = Image.new("RGB", (4 * 320, (len(pictures) + 3) // 4 * 240))
    for k, path in enumerate(pictures):
        sheet.paste(Image.open(path).resize((320, 240)), (k % 4 * 320, k // 4 * 240))
    sheet.save(out)


if __name__ == "__main__":
    main()
