#!/usr/bin/env bash
# Builds the image of the Dockerfile without a registry and without a daemon, and runs it as an ordinary user.
#   scripts/check_image.sh target/release/dsfms      (as root; Debian: apt install debootstrap buildah)
# Debian's base comes from its packages. The base with Rust is that one with a stand-in for cargo that takes its
# command and puts PROGRAM where the compilation would: the compilation itself is not part of the check.
set -euo pipefail
program=$(readlink -f "$1")
cd "$(dirname "$0")/.."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export STORAGE_DRIVER=vfs BUILDAH_ISOLATION=chroot
buildah() { command buildah --root "$work/store" --runroot "$work/run" "$@"; }
rust=$(sed -n 's/^FROM \(rust:[^ ]*\) AS build$/\1/p' Dockerfile)
debian=$(sed -n 's/^FROM \(debian:[^ ]*\)$/\1/p' Dockerfile)
suite=${debian#debian:}
debootstrap --variant=minbase "${suite%-slim}" "$work/base" > "$work/log" || { tail "$work/log" >&2; exit 1; }
cat > "$work/cargo" << 'STAND_IN'
#!/bin/sh
test "$*" = "build --release --locked -p dsfms-cli" || { echo "unknown: cargo $*" >&2; exit 64; }
test -n "$RUSTFLAGS" && test -n "$DSFMS_BUILD_COMMIT" && test -s Cargo.lock && test -s crates/dsfms-cli/src/main.rs || exit 65
test ! -e target && test ! -e .git || { echo "target or .git is in the context" >&2; exit 66; }
mkdir -p target/release && cp /program target/release/dsfms
STAND_IN
chmod +x "$work/cargo"
base=$(buildah from scratch)
buildah copy -q "$base" "$work/base" / > /dev/null
buildah config --env PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "$base"
buildah commit -q "$base" "docker.io/library/$debian" > /dev/null
buildah copy -q "$base" "$program" /program > /dev/null
buildah copy -q "$base" "$work/cargo" /usr/local/bin/cargo > /dev/null
buildah commit -q "$base" "docker.io/library/$rust" > /dev/null
buildah build --pull-never --build-arg COMMIT=0123456789ab -t dsfms . > "$work/log" 2>&1 || { tail -20 "$work/log" >&2; exit 1; }
image=$(buildah from --pull-never localhost/dsfms)
inside() { buildah run -v "$work/data:/data" "$image" -- "$@"; }
mkdir -m 777 "$work/data"
test "$(inside id -u)" != 0 || { echo "it runs as root" >&2; exit 1; }
inside ffmpeg -version > /dev/null
inside dsfms synth --chessboard 7x5 --square 3mm -q -o board > /dev/null
test -n "$(ls "$work/data/board")"
for file in LICENSE-MIT LICENSE-APACHE OFL.txt three.LICENSE README.md; do
  inside test -s "/usr/share/doc/dsfms/$file" || { echo "missing: $file" >&2; exit 1; }
done
echo "$(inside dsfms --version): the image is made and runs as user $(inside id -u), with ffmpeg; the compilation within it is NOT tried"
