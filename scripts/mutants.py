#!/usr/bin/env python3
"""Which mistakes would the tests not notice? A sample of the mutants that cargo-mutants lists, each judged by the tests.

    cargo install cargo-mutants --locked
    pip install tree-sitter tree-sitter-rust
    python3 scripts/mutants.py --work /tmp/mutants                # 12 of each folder, an hour or two on two cores
    python3 scripts/mutants.py --work /tmp/mutants --only light --sample 50

cargo-mutants builds the library anew for every mutant. Here all mutants of the sample are built into one set of test
programs, and `DSFMS_MUTANT=7` chooses the seventh, so that a mutant costs no more than its tests: the unit tests of
its folder, then all unit tests, then the integration tests of the library, the quickest first, until one fails. A test
that takes six times as long as without mutant, and a minute, counts as failed. Mutants that do not compile, of
constants and of single fields are not in the sample. The copy of the repository, its build and `mutants.json`, to
which each result is added, lie in `--work`; a second run goes on from there, `--again` with what was not caught. Prints a table as Markdown.
"""
import argparse
import json
import os
import pathlib
import random
import re
import shutil
import subprocess
import time

import tree_sitter
import tree_sitter_rust

ROOMS = ["camera", "energy", "light", "refine", "register", "sfm", "solver"]
# What they test is text, files and layers, or they start programs of their own.
LEFT_OUT = {"camera_file", "examples", "file_properties", "fuzz_regressions", "layers", "requirements", "structure", "video"}
SWITCH = """
/// Whether the mutant of this number is in force.
#[allow(missing_docs, dead_code)]
pub(crate) fn mutant(number: u32) -> bool {
    static CHOSEN: std::sync::OnceLock<u32> = std::sync::OnceLock::new();
    *CHOSEN.get_or_init(|| std::env::var("DSFMS_MUTANT").map_or(0, |n| n.parse().unwrap())) == number
}
"""
UNVIABLE = "does not compile"
PARSER = tree_sitter.Parser(tree_sitter.Language(tree_sitter_rust.language()))


def listed(tree, room):
    """The mutants of one folder as cargo-mutants has them, without those of tests."""
    patterns = [f"crates/dsfms/src/{room}/**/*.rs", f"crates/dsfms/src/{room}.rs"]
    command = ["cargo", "mutants", "--list", "--json"] + [x for p in patterns for x in ("--file", p)]
    found = subprocess.run(command, cwd=tree, stdout=subprocess.PIPE, check=True).stdout
    return [m | {"room": room} for m in json.loads(found)]


def offset(text, place):
    """Byte offset of a line and a column, both from 1, the column in characters."""
    lines = text.split("\n")
    before = "\n".join(lines[: place["line"] - 1]) + ("\n" if place["line"] > 1 else "")
    return len((before + lines[place["line"] - 1][: place["column"] - 1]).encode())


def is_const(node):
    """Whether a node must be computed by the compiler."""
    while node is not None:
        if node.type in ("const_item", "static_item", "array_type", "macro_invocation"):
            return True
        if node.type == "function_item":
            return any(c.type == "function_modifiers" and b"const" in c.text for c in node.children)
        node = node.parent
    return False


def edit(source, root, mutant):
    """(start, end, text) of a mutant's edit, `{n}` in the text being its number; None where there is none."""
    start, end = (offset(source.decode(), mutant["span"][k]) for k in ("start", "end"))
    node = root.descendant_for_byte_range(start, max(start, end - 1))
    if node is None or is_const(node):
        return None
    of = lambda n: source[n.start_byte : n.end_byte].decode()
    kind, new = mutant["genre"], mutant["replacement"]
    if kind == "FnValue":
        while node is not None and node.type != "block":
            node = node.parent
        if node is None or node.parent.type != "function_item":
            return None
        return node.start_byte, node.end_byte, f"{{ if crate::mutant({{n}}) {{ {new} }} else {of(node)} }}"
    if kind in ("BinaryOperator", "UnaryOperator"):
        expression = node.parent
        if expression is None or not expression.type.endswith(("binary_expression", "unary_expression", "assignment_expr")):
            return None
        if kind == "UnaryOperator":
            changed = of(expression.children[-1])
        else:
            left, _, right = expression.children
            changed = f"{of(left)} {new} {of(right)}" if "assign" in expression.type else f"({of(left)}) {new} ({of(right)})"
        return expression.start_byte, expression.end_byte, f"(if crate::mutant({{n}}) {{ {changed} }} else {{ {of(expression)} }})"
    if kind == "MatchArmGuard":
        return start, end, f"(if crate::mutant({{n}}) {{ {new} }} else {{ {source[start:end].decode()} }})"
    return None


def sample(tree, rooms, count, seed):
    """`count` mutants of each folder that can be chosen while the program runs, none within another."""
    chosen = []
    for room in rooms:
        every = listed(tree, room)
        random.Random(f"{seed} {room}").shuffle(every)
        taken = []
        for mutant in every:
            if len(taken) == 2 * count:
                break
            path = tree / mutant["file"]
            source = path.read_bytes()
            change = edit(source, PARSER.parse(source).root_node, mutant)
            same = [t for t in taken if t["file"] == mutant["file"]]
            if change and all(change[1] <= t["edit"][0] or t["edit"][1] <= change[0] for t in same):
                taken.append(mutant | {"edit": change, "listed": len(every)})
        chosen += taken
    return [m | {"number": n} for n, m in enumerate(chosen, 1)]


def write(tree, origin, mutants):
    """The library with the given mutants in it; returns where each lies, by file."""
    places = {}
    for name in {m["file"] for m in mutants}:
        source, at = (origin / name).read_bytes(), 0
        pieces = []
        for m in sorted((m for m in mutants if m["file"] == name), key=lambda m: m["edit"][0]):
            start, end, text = m["edit"]
            text = text.replace("{n}", str(m["number"])).encode()
            pieces += [source[at:start], text]
            begin = sum(map(len, pieces)) - len(text)
            places.setdefault(name, []).append((begin, begin + len(text), m["number"]))
            at = end
        (tree / name).write_bytes(b"".join(pieces) + source[at:])
    library = "crates/dsfms/src/lib.rs"
    (tree / library).write_bytes((origin / library).read_bytes() + SWITCH.encode())
    return places


def viable(tree, origin, mutants, env):
    """The mutants that compile: what an error lies in goes, until there is none."""
    while True:
        for file in {m["file"] for m in mutants}:
            shutil.copy(origin / file, tree / file)
        places = write(tree, origin, mutants)
        command = ["cargo", "check", "-p", "dsfms", "--message-format", "json"]
        run = subprocess.run(command, cwd=tree, env=env, capture_output=True, text=True)
        bad = set()
        for line in run.stdout.splitlines():
            message = json.loads(line).get("message")
            if isinstance(message, dict) and message.get("level") == "error":
                for span in message["spans"]:
                    for begin, end, number in places.get(span["file_name"], []):
                        if begin <= span["byte_start"] < end:
                            bad.add(number)
        if run.returncode == 0:
            return mutants
        if not bad:
            raise SystemExit("errors outside of every mutant:\n" + run.stderr[-3000:])
        print(f"{len(bad)} do not compile", flush=True)
        for m in mutants:
            if m["number"] in bad:  # back to what it was, for files without a mutant left
                shutil.copy(origin / m["file"], tree / m["file"])
        mutants = [m for m in mutants if m["number"] not in bad]


def programs(tree, env, unit):
    """(name, path) of every test program of the library, unit tests first, or of these alone."""
    command = ["cargo", "test", "-p", "dsfms", "--no-run", "--message-format", "json"] + ["--lib"] * unit
    out = subprocess.run(command, cwd=tree, env=env, stdout=subprocess.PIPE, check=True, text=True).stdout
    found = {}
    for line in out.splitlines():
        message = json.loads(line)
        if message.get("executable") and message["profile"]["test"]:
            found[message["target"]["name"]] = message["executable"]
    return [("dsfms", found.pop("dsfms"))] + sorted((n, p) for n, p in found.items() if n not in LEFT_OUT)


def run_tests(path, words, number, tree, env, limit):
    """(whether all passed, seconds, first failed test)."""
    start = time.monotonic()
    try:
        run = subprocess.run([path, *words], cwd=tree / "crates/dsfms", env=env | {"DSFMS_MUTANT": str(number)},
                             capture_output=True, text=True, timeout=limit)
    except subprocess.TimeoutExpired:
        return False, time.monotonic() - start, "timeout"
    failed = re.search(r"^test (\S+) \.\.\. FAILED", run.stdout, re.M)
    return run.returncode == 0, time.monotonic() - start, failed and failed[1]


def judge(mutant, tests, tree, env, usual):
    """The test that catches a mutant, or None."""
    rooms = [("dsfms", tests[0][1], [f"{mutant['room']}::"])]
    for name, path, words in rooms + [(n, p, []) for n, p in tests]:
        key = name if not words else f"{name} {words[0]}"
        passed, _, failed = run_tests(path, words, mutant["number"], tree, env, max(60, 6 * usual[key]))
        if not passed:
            return f"{name}: {failed or 'abort'}"
    return None


def table(results):
    """One line a folder, then the mutants that were not caught."""
    print("\n| folder | mutants of cargo-mutants | sample | caught | share |\n| --- | --- | --- | --- | --- |")
    for room in sorted({m["room"] for m in results}) + ["all"]:
        mine = [m for m in results if room in (m["room"], "all")]
        caught = sum(m["caught"] is not None for m in mine)
        every = sum({m["room"]: m["listed"] for m in mine}.values())
        print(f"| `{room}` | {every} | {len(mine)} | {caught} | {100 * caught / len(mine):.0f} % |")
    print("\nNot caught:\n")
    for m in (m for m in results if m["caught"] is None):
        print(f"- `{m['name']}`")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=pathlib.Path, required=True, help="folder of the copy, its build and the results")
    parser.add_argument("--sample", type=int, default=12, help="mutants a folder [12]")
    parser.add_argument("--only", help="folders, parted by commas [all]")
    parser.add_argument("--seed", default="1", help="of the sample [1]")
    parser.add_argument("--unit", action="store_true", help="by unit tests alone; what they leave goes on with --again")
    parser.add_argument("--again", action="store_true", help="judge what was not caught once more, by today's tests")
    options = parser.parse_args()
    rooms = options.only.split(",") if options.only else ROOMS
    root, work = pathlib.Path(__file__).resolve().parent.parent, options.work.resolve()
    origin, tree, kept = work / "origin", work / "tree", work / "mutants.json"
    env = os.environ | {"CARGO_TARGET_DIR": str(work / "target"), "CARGO_INCREMENTAL": "1"}

    for folder in (origin, tree):
        shutil.rmtree(folder, ignore_errors=True)
        subprocess.run(["git", "clone", "-q", root, folder], check=True)
    done = json.loads(kept.read_text()) if kept.exists() else {}
    mutants = [m for m in sample(origin, rooms, options.sample, options.seed) if done.get(m["name"]) != UNVIABLE]
    able = viable(tree, origin, mutants, env)
    done |= {m["name"]: UNVIABLE for m in mutants if m not in able}
    chosen = [m for room in rooms for m in [m for m in able if m["room"] == room][: options.sample]]

    tests = programs(tree, env, options.unit)
    usual = {}
    for key, path, words in [(f"dsfms {r}::", tests[0][1], [f"{r}::"]) for r in rooms] + [(n, p, []) for n, p in tests]:
        passed, usual[key], failed = run_tests(path, words, 0, tree, env, 1800)
        if not passed:
            raise SystemExit(f"{key} fails without any mutant: {failed}")
    tests = tests[:1] + sorted(tests[1:], key=lambda t: usual[t[0]])
    for m in chosen:
        if m["name"] not in done or options.again and done[m["name"]] is None:
            start = time.monotonic()
            done[m["name"]] = judge(m, tests, tree, env, usual)
            print(f"{time.monotonic() - start:5.0f} s  {done[m['name']] or 'NOT CAUGHT'}  {m['name']}", flush=True)
            kept.write_text(json.dumps(done, indent=1))
    table([m | {"caught": done[m["name"]]} for m in chosen])


if __name__ == "__main__":
    main()
