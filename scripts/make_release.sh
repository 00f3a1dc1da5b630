#!/usr/bin/env bash
# A release archive: the program for any x86-64 CPU, which hands over to the one for AVX2 and FMA beside it
# where the CPU has them (crates/dsfms-cli/src/cpu.rs), manual pages, shell completions, licences, bill of materials.
#   scripts/make_release.sh [-o FOLDER] [--from FAST PORTABLE]
# --from packs two binaries that are built already instead of building them.
set -euo pipefail
cd "$(dirname "$0")/.."
out=target/release-archive
fast= portable=
while [ $# -gt 0 ]; do
  case $1 in
    -o) out=$2; shift 2 ;;
    --from) fast=$2 portable=$3; shift 3 ;;
    *) echo "usage: $0 [-o FOLDER] [--from FAST PORTABLE]" >&2; exit 64 ;;
  esac
done
build() { # TARGET_CPU: no library of the system is needed but the kernel
  CARGO_TARGET_DIR=target/archive-$1 RUSTFLAGS="-C target-cpu=$1 -C target-feature=+crt-static" \
    cargo build --release --locked -p dsfms-cli --target x86_64-unknown-linux-gnu
}
if [ -z "$fast" ]; then
  build x86-64-v3
  build x86-64
  fast=target/archive-x86-64-v3/x86_64-unknown-linux-gnu/release/dsfms
  portable=target/archive-x86-64/x86_64-unknown-linux-gnu/release/dsfms
fi
version=$("$portable" --version | cut -d' ' -f2)
name=dsfms-$version-x86_64-linux
rm -rf "${out:?}/$name"
mkdir -p "$out/$name"/{bin,lib/dsfms,share/man/man1,share/bash-completion/completions,share/zsh/site-functions,share/fish/vendor_completions.d}
cd_to=$out/$name
install -m 755 "$fast" "$cd_to/lib/dsfms/dsfms-x86-64-v3"
install -m 755 "$portable" "$cd_to/bin/dsfms"
dsfms=$cd_to/bin/dsfms
"$dsfms" man "$cd_to/share/man/man1" > /dev/null
"$dsfms" completions bash > "$cd_to/share/bash-completion/completions/dsfms"
"$dsfms" completions zsh > "$cd_to/share/zsh/site-functions/_dsfms"
"$dsfms" completions fish > "$cd_to/share/fish/vendor_completions.d/dsfms.fish"
cp README.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE "$cd_to/"
# What the programs carry of others: the font of figures, three.js, the organs of the synthetic cases.
mkdir "$cd_to/licences"
cp crates/dsfms-cli/data/font/OFL.txt "$cd_to/licences/Arimo-OFL.txt"
cp crates/dsfms-cli/assets/three.LICENSE "$cd_to/licences/three.js.txt"
cp crates/dsfms/data/organs/README.md "$cd_to/licences/organs.md"
# Of crates, Rust's and C's libraries: every text of a licence, and the list of what is in the programs.
python3 scripts/supply_chain.py licences --system > "$cd_to/THIRD_PARTY_LICENCES.txt"
python3 scripts/supply_chain.py sbom > "$cd_to/dsfms.cdx.json"
# The same input gives the same archive.
tar --sort=name --owner=0 --group=0 --numeric-owner --mtime="@${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}" \
  -C "$out" -cf - "$name" | gzip -n > "$out/$name.tar.gz"
(cd "$out" && sha256sum "$name.tar.gz" > "$name.tar.gz.sha256")
scripts/check_release.sh "$out/$name.tar.gz"
echo "$out/$name.tar.gz"
