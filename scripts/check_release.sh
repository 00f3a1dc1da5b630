#!/usr/bin/env bash
# What an archive of scripts/make_release.sh must be: whole, started by any CPU, the same bits by both programs.
#   scripts/check_release.sh ARCHIVE.tar.gz
set -euo pipefail
archive=$(readlink -f "$1")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
tar -xzf "$archive"
root=$(ls)
for file in bin/dsfms lib/dsfms/dsfms-x86-64-v3 share/man/man1/dsfms.1 share/man/man1/dsfms-template.1 \
  share/bash-completion/completions/dsfms share/zsh/site-functions/_dsfms \
  share/fish/vendor_completions.d/dsfms.fish README.md LICENSE-MIT LICENSE-APACHE; do
  test -s "$root/$file" || { echo "missing: $file" >&2; exit 1; }
done
bash -n "$root/share/bash-completion/completions/dsfms"
dsfms=$work/$root/bin/dsfms
"$dsfms" --version
# It starts by another name and through a link, too.
ln -s "$dsfms" "$work/link"
test "$("$work/link" --version)" = "$("$dsfms" --version)"
flags=$(grep -m1 '^flags' /proc/cpuinfo)
for flag in avx2 fma bmi1 bmi2 f16c abm movbe; do
  case " $flags " in *" $flag "*) ;; *) echo "this CPU lacks $flag: the fast program is NOT tested"; exit 0 ;; esac
done
# Which program runs: one that only says so stands in for the fast one.
cp -r "$root" stand-in
printf '#!/bin/sh\necho fast "$@"\n' > stand-in/lib/dsfms/dsfms-x86-64-v3
test "$(stand-in/bin/dsfms one two)" = "fast one two"
DSFMS_PORTABLE=1 stand-in/bin/dsfms --version | grep -q '^dsfms '
# The same bits: a rendered clip, its template, and two frames by the joint solve.
for way in fast portable; do
  if [ $way = portable ]; then export DSFMS_PORTABLE=1; fi
  "$dsfms" synth --video --frames 2 --size 320x180 --vertices 150 --seed 3 --quiet -o $way/clip
  "$dsfms" reconstruct $way/clip/organ.template $way/clip/frames --camera $way/clip/camera.json --method joint \
    --no-report --quiet -o $way/out || test $? = 2
done
differ=$(diff -rq fast/clip portable/clip || true)
for file in fast/out/*.ply; do
  cmp -s "$file" "portable/out/$(basename "$file")" || differ+=" $file"
done
test -z "$differ" || { echo "the two programs differ: $differ" >&2; exit 1; }
echo "$root: whole; both programs give the same bits ($(ls fast/out/*.ply | wc -l) surfaces)"
