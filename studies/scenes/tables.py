#!/usr/bin/env python3
"""Print the rows of docs/results/scenes.md from what score.py wrote with --json.

    tables.py SCORES.json --name held
"""
import argparse
import json
from pathlib import Path

PLACES = ("zone", "visible", "hidden")


def number(value):
    return "-" if value is None else f"{value:.2f}"


def joined(values):
    return " / ".join(map(number, values))


def ratio(scene, place):
    joint, rigid = scene["joint"][place], scene["rigid"][place]
    return None if joint is None or not rigid else joint / rigid


def figures(scene, places):
    """Columns of a row, as numbers: joint by place, joint / rigid by place, at rest, states, seconds."""
    joint = scene["joint"]
    rest = [joint["rest_seen"]] + ([joint["rest_hidden"]] if "hidden" in places else [])
    states = [joint["states"][s] for s in ("ok", "degraded", "failed")]
    return [joint[p] for p in places], [ratio(scene, p) for p in places], rest, states, joint["seconds"]


def row(name, rigid, columns):
    errors, ratios, rest, states, seconds = columns
    cells = [name, rigid, joined(errors), *map(number, ratios), joined(rest), " / ".join(map(str, states)), f"{seconds:.1f}"]
    return "| " + " | ".join(cells) + " |"


def over(scenes, of, places):
    """The row of all scenes: `of` over each column, but for the states, which are counted."""
    rows = [figures(scene, places) for scene in scenes]

    def each(k):
        columns = zip(*(r[k] for r in rows))
        return [of([v for v in column if v is not None]) for column in columns]

    states = [sum(column) for column in zip(*(r[3] for r in rows))]
    return each(0), each(1), each(2), states, of([r[4] for r in rows])


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("scores", type=Path, help="what score.py wrote with --json, of methods rigid and joint")
    ap.add_argument("--name", default="all", help="name of the scenes in the rows of mean and worst")
    a = ap.parse_args()
    for road, scenes in json.loads(a.scores.read_text()).items():
        places = PLACES[:2] if road == "frames" else PLACES
        print(f"\n== {road}\n")
        scenes = {name: scene for name, scene in scenes.items() if name[0].isdigit()}
        for name, scene in sorted(scenes.items()):
            print(row(name, joined(scene["rigid"][p] for p in places), figures(scene, places)))
        for word, of in (("mean", lambda v: sum(v) / len(v)), ("worst", max)):
            print(row(f"**{a.name}: {word}**", "", over(list(scenes.values()), of, places)))


if __name__ == "__main__":
    main()
