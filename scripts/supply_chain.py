#!/usr/bin/env python3
"""What the program is made of besides our own code: a bill of materials, the licences, and the unsafe code.

    python3 scripts/supply_chain.py sbom > dsfms.cdx.json             # CycloneDX 1.5
    python3 scripts/supply_chain.py licences > THIRD_PARTY_LICENCES.txt
    python3 scripts/supply_chain.py unsafe                            # tables of docs/supply_chain.md
    python3 scripts/supply_chain.py check docs/supply_chain.md

*Linked* is a crate that `cargo tree` names for the program's normal dependencies on the target; a crate that only runs
while compiling (procedural macros, build scripts) is in the bill with scope `excluded`. Everything comes from
Cargo.lock and the sources in cargo's registry, nothing from the network, and the same input gives the same bytes; the
time in the bill is SOURCE_DATE_EPOCH or that of the commit.

`unsafe` is counted in the files beneath the crate's root file, comments, strings and letters left out: blocks,
functions, implementations, traits, foreign blocks. Code for other systems, for tests in the same files and unused
functions count too; what macros write does not.

`check` ends with 1 unless: every crate has a licence, a text of it and a checksum, and comes from crates.io; the bill
is the same bytes twice and its graph whole; our own crates have no `unsafe` and forbid it (the Python module, where
macros of PyO3 write it, cannot forbid it); and the tables of the given page are those of Cargo.lock. Needs cargo and
Python 3.11.
"""
import argparse
import html
import json
import os
import re
import subprocess
import sys
import tomllib
import uuid
from datetime import datetime, timezone
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TARGET = "x86_64-unknown-linux-gnu"
PROGRAM = "dsfms-cli"
REGISTRY = "registry+https://github.com/rust-lang/crates.io-index"
KINDS = ["block", "fn", "impl", "trait", "extern"]
# A licence file beside Cargo.toml.
LICENCE = re.compile(r"(?i)^(licen[cs]e|copying|copyright|notice|unlicense)")
# What the programs carry that is no crate: name, version, licence, purl, file of the licence.
CARRIED = [
    ("three", "0.187.0", "MIT", "pkg:npm/three@0.187.0", "crates/dsfms-cli/assets/three.LICENSE"),
    ("Arimo", "1.33", "OFL-1.1", None, "crates/dsfms-cli/data/font/OFL.txt"),
]
# Of Debian and Ubuntu, which the archive is built on.
C_LIBRARY = ["/usr/share/doc/libc6/copyright", "/usr/share/common-licenses/LGPL-2.1"]


def cargo(*words):
    return subprocess.run(["cargo", *words], cwd=ROOT, check=True, capture_output=True, text=True).stdout


def tree(package, edges):
    """(name, version) of every crate that cargo would use."""
    said = cargo("tree", "--locked", "--offline", "-p", package, "-e", edges, "--target", TARGET, "--prefix", "none",
                 "--format", "{p}")
    return {(w[0], w[1].removeprefix("v")) for w in (line.split() for line in said.splitlines()) if w}


class Chain:
    """Crates of a package of the workspace, linked or used while compiling."""

    def __init__(self, package=PROGRAM):
        words = ["--locked", "--offline", "--format-version", "1", "--filter-platform", TARGET]
        said = json.loads(cargo("metadata", *words))
        found = {(p["name"], p["version"]): p for p in said["packages"]}
        self.linked = tree(package, "normal,no-proc-macro")
        self.all = {key: found[key] for key in sorted(self.linked | tree(package, "normal,build"))}
        ids = {p["id"]: key for key, p in self.all.items()}
        self.needs = {
            ids[n["id"]]: sorted({ids[d["pkg"]] for d in n["deps"] if d["pkg"] in ids and kept(d)})
            for n in said["resolve"]["nodes"] if n["id"] in ids
        }
        locked = tomllib.loads((ROOT / "Cargo.lock").read_text())["package"]
        self.checksums = {(p["name"], p["version"]): p.get("checksum") for p in locked}
        self.root = next(key for key in self.all if key[0] == package)

    def foreign(self):
        """Linked crates that are not ours, by name."""
        return {key: p for key, p in self.all.items() if key in self.linked and p["source"]}


def kept(dependency):
    return any(k["kind"] in (None, "build") for k in dependency["dep_kinds"])


def expression(package):
    """SPDX; the slash of older crates means `or`."""
    return re.sub(r"\s*/\s*", " OR ", package["license"] or "")


def purl(key):
    return f"pkg:cargo/{key[0]}@{key[1].replace('+', '%2B')}"


def component(key, chain):
    package = chain.all[key]
    own = package["source"] is None
    found = {
        "type": "application" if key[0] == PROGRAM else "library",
        "bom-ref": purl(key),
        "name": key[0],
        "version": key[1],
        "scope": "required" if key in chain.linked else "excluded",
        "licenses": [{"expression": expression(package)}],
        "purl": purl(key),
    }
    if not own:
        found["hashes"] = [{"alg": "SHA-256", "content": chain.checksums[key]}]
    if package["repository"]:
        found["externalReferences"] = [{"type": "vcs", "url": package["repository"]}]
    return found


def when():
    seconds = os.environ.get("SOURCE_DATE_EPOCH") or subprocess.run(
        ["git", "log", "-1", "--format=%ct"], cwd=ROOT, capture_output=True, text=True
    ).stdout.strip()
    return datetime.fromtimestamp(int(seconds or 0), timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")


def sbom(chain):
    components = [component(key, chain) for key in chain.all if key != chain.root]
    for name, version, licence, link, _ in CARRIED:
        found = {"type": "library", "bom-ref": link or name, "name": name, "version": version, "scope": "required"}
        components.append(found | {"licenses": [{"expression": licence}]} | ({"purl": link} if link else {}))
    graph = [{"ref": purl(key), "dependsOn": [purl(k) for k in needs]} for key, needs in sorted(chain.needs.items())]
    subject = component(chain.root, chain)
    del subject["scope"]
    bill = {
        "$schema": "http://cyclonedx.org/schema/bom-1.5.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {
            "timestamp": when(),
            "tools": {"components": [{"type": "application", "name": "scripts/supply_chain.py"}]},
            "component": subject,
            "properties": [{"name": "cargo:target", "value": TARGET}],
        },
        "components": components,
        "dependencies": graph,
    }
    bill["serialNumber"] = f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, json.dumps(bill, sort_keys=True))}"
    return json.dumps(bill, indent=1, ensure_ascii=False) + "\n"


def folder(package):
    return Path(package["manifest_path"]).parent


def texts(package):
    """Licence files of a crate and their text, line ends and outer blank lines left out."""
    named = package["license_file"]
    paths = {p for p in folder(package).iterdir() if p.is_file() and LICENCE.match(p.name)}
    paths |= {folder(package) / named} if named else set()
    for path in sorted(paths):
        text = path.read_text(errors="replace").replace("\r\n", "\n").strip("\n")
        yield path.name, "\n".join(line.rstrip() for line in text.splitlines())


def standard(package):
    """For a crate without a file: its authors and the text of the licence it names."""
    name = "LICENSE-APACHE" if "MIT" not in expression(package) else "LICENSE-MIT"
    text = (ROOT / name).read_text().strip("\n")
    authors = ", ".join(re.sub(r"\s*<>", "", a) for a in package["authors"]) or f"the authors of {package['name']}"
    notice = f"Copyright (c) {authors}"
    return f"no file in {package['name']}: text of the licence that its Cargo.toml names", re.sub(
        r"(?m)^Copyright.*$", lambda _: notice, text, count=1
    )


def system_texts():
    """What rustc links besides crates: its standard library and, in the archive's programs, the C library."""
    sysroot = subprocess.run(["rustc", "--print", "sysroot"], capture_output=True, text=True, check=True).stdout.strip()
    page = Path(sysroot, "share/doc/rust/COPYRIGHT-library.html").read_text()
    plain = html.unescape(re.sub(r"<[^>]+>", "", re.sub(r"(?s)<(script|style|title).*?</\1>", "", page)))
    lines = "\n".join(line.strip() for line in plain.splitlines())
    yield "Rust standard library", re.sub(r"\n\n\n+", "\n\n", lines).strip()
    for path in C_LIBRARY:
        yield f"GNU C Library ({Path(path).name})", Path(path).read_text(errors="replace").strip("\n")


def licences(chain, system=False):
    """Every text once, under the crates that have it."""
    where = {}
    for key, package in chain.foreign().items():
        files = list(texts(package)) or [standard(package)]
        for file, text in files:
            where.setdefault(text, []).append(f"{key[0]} {key[1]} ({file})")
    for name, version, _, _, path in CARRIED:
        where.setdefault((ROOT / path).read_text().strip("\n"), []).append(f"{name} {version}")
    if system:
        for name, text in system_texts():
            where.setdefault(text, []).append(name)
    rule = "=" * 100
    listed = "".join(f"  {k[0]} {k[1]}: {expression(p)}\n" for k, p in chain.foreign().items())
    parts = [f"What dsfms is linked with, and under which licences.\n\n{listed}"]
    for text, users in where.items():
        parts.append(f"{rule}\n" + "".join(f"{u}\n" for u in users) + f"{rule}\n\n{text}\n")
    if system:
        parts.append(f"{rule}\nThe C library is linked statically. dsfms (MIT or Apache-2.0) and its crates can be had "
                     f"as sources, from\nwhich the program can be linked with another version of it.\n{rule}\n")
    return "\n".join(parts)


# Comments, strings, letters; in this order, as a slash may stand in a string.
RAW = re.compile(r'(?s)\b[bc]?r(#*)".*?"\1|"(?:\\.|[^"\\])*"|\'(?:\\.[^\']{0,8}|[^\'\\])\'|//[^\n]*|/\*')


def stripped(text):
    """Rust without comments, strings and letters."""
    out, at = [], 0
    while match := RAW.search(text, at):
        out.append(text[at : match.start()])
        at = match.end()
        if match[0] == "/*":
            depth = 1
            for mark in re.finditer(r"/\*|\*/", text[at:]):
                depth += 1 if mark[0] == "/*" else -1
                if depth == 0:
                    at += mark.end()
                    break
            else:
                at = len(text)
        out.append(" ")
    return "".join(out) + text[at:]


UNSAFE = re.compile(r"\bunsafe\s*(\{|fn\b|impl\b|trait\b|extern\b(?:\s*fn\b)?)")


def unsafe_in(text):
    """How often each kind occurs; `unsafe extern "C" fn` is a function."""
    count = dict.fromkeys(KINDS, 0)
    for word in UNSAFE.findall(stripped(text)):
        kind = "block" if word == "{" else "fn" if word.endswith("fn") else word
        count[kind] += 1
    return count


def sources(package):
    """Rust files beneath the root file of the library or program."""
    built = (t for t in package["targets"] if set(t["kind"]) & {"lib", "rlib", "cdylib", "bin"})
    roots = {Path(t["src_path"]).parent for t in built}
    roots = {r for r in roots if not any(o != r and o in r.parents for o in roots)}
    for root in sorted(roots):
        for path in sorted(root.rglob("*.rs")):
            if not {"tests", "benches", "examples", "target"} & set(path.relative_to(root).parts[:-1]):
                yield path


def unsafe_of(package):
    total, lines, forbidden = dict.fromkeys(KINDS, 0), 0, False
    for path in sources(package):
        text = path.read_text(errors="replace")
        lines += text.count("\n")
        forbidden |= bool(re.search(r"#!\[(?:cfg_attr\([^\]]*)?(?:forbid|deny)\([^)]*unsafe_code", text))
        for kind, n in unsafe_in(text).items():
            total[kind] += n
    return total, lines, forbidden


def tables(chain):
    """Markdown: licences, then unsafe code, of the linked crates."""
    foreign = chain.foreign()
    by = {}
    for package in foreign.values():
        by[expression(package)] = by.get(expression(package), 0) + 1
    compiling = len(chain.all) - len(chain.linked)
    out = [f"{len(foreign)} crates of others are linked; {compiling} more run while compiling.\n",
           "| licence | crates |", "| --- | --- |"]
    out += [f"| {name} | {n} |" for name, n in sorted(by.items(), key=lambda p: (-p[1], p[0]))]
    rows = {key: unsafe_of(p) for key, p in foreign.items()}
    some = {key: r for key, r in rows.items() if any(r[0].values())}
    forbidding = [key for key in rows if key not in some and rows[key][2]]
    out += ["", f"{len(some)} of {len(rows)} have `unsafe` code; of the others {len(forbidding)} forbid or deny it.\n",
            "| crate | lines | blocks | functions | impls | traits | foreign blocks |", "| --- " * 7 + "|"]
    for key, (count, lines, _) in sorted(some.items(), key=lambda r: (-sum(r[1][0].values()), r[0])):
        out.append(f"| {key[0]} {key[1]} | {lines} | " + " | ".join(str(count[k]) for k in KINDS) + " |")
    total = [sum(r[0][k] for r in some.values()) for k in KINDS]
    out.append(f"| together | {sum(r[1] for r in some.values())} | " + " | ".join(map(str, total)) + " |")
    out += ["", "None: " + ", ".join(f"{n} {v}" for n, v in rows if (n, v) not in some) + "."]
    return "\n".join(out) + "\n"


BEGIN, END = "<!-- supply_chain.py unsafe -->\n", "<!-- end -->\n"


def own_unsafe():
    """Crates of the workspace with `unsafe` code, or that do not forbid it."""
    wrong = []
    lints = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["lints"]["rust"]
    if lints.get("unsafe_code") != "forbid":
        wrong.append("Cargo.toml does not forbid unsafe code")
    for manifest in sorted(ROOT.glob("crates/*/Cargo.toml")):
        inherits = tomllib.loads(manifest.read_text()).get("lints", {}).get("workspace")
        if not inherits and manifest.parent.name != "dsfms-python":
            wrong.append(f"{manifest.parent.name} has lints of its own")
        for path in sorted(manifest.parent.rglob("*.rs")):
            if "target" not in path.parts and re.search(r"\bunsafe\b", stripped(path.read_text())):
                wrong.append(f"{path.relative_to(ROOT)} has unsafe code")
    return wrong


def check(chain, page):
    wrong = own_unsafe()
    bill = sbom(chain)
    if bill != sbom(Chain()):
        wrong.append("two bills of materials differ")
    told = json.loads(bill)
    refs = {c["bom-ref"] for c in told["components"]} | {told["metadata"]["component"]["bom-ref"]}
    graph = told["dependencies"]
    wrong += [f"{d['ref']} needs what is not in the bill" for d in graph if not {d["ref"], *d["dependsOn"]} <= refs]
    reached, todo = set(), [told["metadata"]["component"]["bom-ref"]]
    needs = {d["ref"]: d["dependsOn"] for d in graph}
    while todo:
        ref = todo.pop()
        if ref not in reached:
            reached.add(ref)
            todo += needs.get(ref, [])
    wrong += [f"nothing needs {c['bom-ref']}" for c in told["components"]
              if c["bom-ref"].startswith("pkg:cargo/") and c["bom-ref"] not in reached]
    for key, package in chain.all.items():
        if package["source"] not in (None, REGISTRY):
            wrong.append(f"{key[0]} comes from {package['source']}")
        if package["source"] and not chain.checksums.get(key):
            wrong.append(f"{key[0]} {key[1]} has no checksum")
        if not package["license"]:
            wrong.append(f"{key[0]} {key[1]} names no licence")
    listed = licences(chain)
    wrong += [f"{k[0]} {k[1]} has no text of a licence" for k in chain.foreign() if f"\n{k[0]} {k[1]} (" not in listed]
    if page:
        text = Path(page).read_text()
        inside = text.split(BEGIN)[1].split(END)[0] if BEGIN in text else None
        if inside != tables(chain):
            wrong.append(f"{page} has other tables: python3 scripts/supply_chain.py write {page}")
    for line in wrong:
        print(line, file=sys.stderr)
    compiling = len(chain.all) - len(chain.linked)
    print(f"{len(chain.foreign())} linked crates, {compiling} while compiling, {len(wrong)} findings")
    return 1 if wrong else 0


def write(chain, page):
    """Renew the tables of a page."""
    text = Path(page).read_text()
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    Path(page).write_text(before + BEGIN + tables(chain) + END + after)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["sbom", "licences", "unsafe", "check", "write"])
    parser.add_argument("page", nargs="?", help="page with tables, of check and write")
    parser.add_argument("--system", action="store_true", help="licences: of Rust's and C's libraries too")
    options = parser.parse_args()
    chain = Chain()
    if options.what == "check":
        sys.exit(check(chain, options.page))
    if options.what == "write":
        write(chain, options.page)
    else:
        made = {"sbom": sbom, "unsafe": tables}.get(options.what) or (lambda c: licences(c, options.system))
        sys.stdout.write(made(chain))


if __name__ == "__main__":
    main()
