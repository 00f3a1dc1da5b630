#!/usr/bin/env bash
# What an archive of scripts/make_release.sh must be: whole, started by any CPU, the same bits by both programs.
#   scripts/check_release.sh ARCHIVE.tar.gz
# With qemu-user (Debian: apt install qemu-user) the program for any CPU also runs on one without AVX. That one has no fused
# multiply-add, which the factorisation of the solvers (faer) takes where it is: there the last digits may differ.
set -euo pipefail
archive=$(readlink -f "$1")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
(cd "$(dirname "$archive")" && sha256sum --check --quiet "$(basename "$archive").sha256")
cd "$work"
tar -xzf "$archive"
root=$(ls)
for file in bin/dsfms lib/dsfms/dsfms-x86-64-v3 share/man/man1/dsfms.1 share/man/man1/dsfms-template.1 \
  share/bash-completion/completions/dsfms share/zsh/site-functions/_dsfms \
  share/fish/vendor_completions.d/dsfms.fish README.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE \
  licences/Arimo-OFL.txt licences/three.js.txt licences/organs.md THIRD_PARTY_LICENCES.txt dsfms.cdx.json; do
  test -s "$root/$file" || { echo "missing: $file" >&2; exit 1; }
done
# Every crate of the bill that is linked has its licence in the file, and some text under its name.
required=$(grep -B4 '^   "scope": "required"' "$root/dsfms.cdx.json" | sed -n 's/^   "bom-ref": "pkg:cargo\/\(.*\)",/\1/p' | sed 's/%2B/+/')
test "$(wc -w <<< "$required")" -gt 50
for crate in $required; do
  case $crate in dsfms@*) continue ;; esac
  grep -q "^  ${crate/@/ }: " "$root/THIRD_PARTY_LICENCES.txt" && grep -q "^${crate/@/ } (" "$root/THIRD_PARTY_LICENCES.txt" ||
    { echo "no licence of $crate" >&2; exit 1; }
done
grep -q '^Rust standard library$' "$root/THIRD_PARTY_LICENCES.txt"
grep -q '^GNU C Library' "$root/THIRD_PARTY_LICENCES.txt"
bash -n "$root/share/bash-completion/completions/dsfms"
dsfms=$work/$root/bin/dsfms
# Both programs are of one commit, which they name.
version=$("$dsfms" --version)
[[ "$version" =~ ^dsfms\ [0-9.]+\ \([0-9a-f]{12}\)$ ]] || { echo "no version with a commit: $version" >&2; exit 1; }
test "$version" = "$(DSFMS_PORTABLE=1 "$dsfms" --version)"
echo "$version"
# Every command has its page.
for command in $("$dsfms" --help | sed -n '/^Commands:/,/^$/s/^  \([a-z-]\+\) .*/\1/p' | grep -v '^help$'); do
  test -s "$root/share/man/man1/dsfms-$command.1" || { echo "no manual page of $command" >&2; exit 1; }
done
# Nothing of the system is needed but the kernel.
if command -v ldd > /dev/null && ldd "$dsfms" 2>&1 | grep -q '=>'; then
  echo "bin/dsfms needs libraries of the system" >&2
  exit 1
fi
# It starts by another name and through a link, too.
ln -s "$dsfms" "$work/link"
test "$("$work/link" --version)" = "$version"
# A rendered clip, its template, and two frames by the joint solve.
made() { # FOLDER PROGRAM...
  local to=$1
  shift
  "$@" synth --video --frames 2 --size 320x180 --vertices 150 --seed 3 --quiet -o "$to/clip"
  "$@" reconstruct "$to/clip/organ.template" "$to/clip/frames" --camera "$to/clip/camera.json" --method joint \
    --no-report --quiet -o "$to/out" || test $? = 2
}
same() { # FOLDER FOLDER: clips to the byte, surfaces too
  local differ
  differ=$(diff -rq "$1/clip" "$2/clip" || true)
  for file in "$1"/out/*.ply; do
    cmp -s "$file" "$2/out/$(basename "$file")" || differ+=" $file"
  done
  test -z "$differ" || { echo "$1 and $2 differ: $differ" >&2; exit 1; }
}
DSFMS_PORTABLE=1 made portable "$dsfms"
# A small case for a CPU that is only pretended: template of a mesh, one frame by the joint solve.
small() { # FOLDER PROGRAM...
  local to=$1/ext10/case_0000
  "${@:2}" synth --vertices 100 --ext 10 --count 1 --seed 3 --quiet -o "$1"
  "${@:2}" template --mesh "$to/rest.obj" --albedo "$to/albedo.png" --quiet -o "$1/organ.template"
  "${@:2}" reconstruct "$1/organ.template" "$to/frame_000.png" --matches "$to/matches.csv" --camera "$to/camera.json" \
    --method joint --no-report --quiet -o "$1/out" || test $? = 2
}
if command -v qemu-x86_64 > /dev/null; then
  DSFMS_PORTABLE=1 small small "$dsfms"
  small old qemu-x86_64 -cpu Nehalem "$dsfms"
  for file in ext10/case_0000/frame_000.png ext10/case_0000/truth/frame_000.ply organ.template/template.ply; do
    cmp "small/$file" "old/$file" || { echo "a CPU without AVX gives other bits" >&2; exit 1; }
  done
  python3 - small/out/frame_000.ply old/out/frame_000.ply << 'END'
import re, struct, sys
rows = []
for path in sys.argv[1:]:
    head, body = open(path, "rb").read().split(b"end_header\n", 1)
    sizes = {b"float": "f", b"uchar": "B", b"int": "i"}
    properties = re.findall(rb"property (\w+) \w+\n", head.split(b"element face")[0])
    row = struct.Struct("<" + "".join(sizes[name] for name in properties))
    count = int(re.search(rb"element vertex (\d+)", head)[1])
    rows.append([row.unpack_from(body, k * row.size) for k in range(count)])
worst = max(abs(a - b) for p, q in zip(*rows, strict=True) for a, b in zip(p, q, strict=True))
print(f"a CPU without AVX (Nehalem by qemu): surface and expected error within {worst:.1g} mm")
sys.exit(worst > 1e-4)
END
else
  echo "no qemu-x86_64: a CPU without AVX is NOT tested"
fi
flags=$(grep -m1 '^flags' /proc/cpuinfo)
for flag in avx2 fma bmi1 bmi2 f16c abm movbe; do
  case " $flags " in *" $flag "*) ;; *) echo "this CPU lacks $flag: the fast program is NOT tested"; exit 0 ;; esac
done
# Which program runs: one that only says so stands in for the fast one.
cp -r "$root" stand-in
printf '#!/bin/sh\necho fast "$@"\n' > stand-in/lib/dsfms/dsfms-x86-64-v3
test "$(stand-in/bin/dsfms one two)" = "fast one two"
DSFMS_PORTABLE=1 stand-in/bin/dsfms --version | grep -q '^dsfms '
made fast "$dsfms"
same fast portable
echo "$root: whole; both programs give the same bits ($(ls fast/out/*.ply | wc -l) surfaces)"
