#!/usr/bin/env bash
# One target for so many seconds on one core: fuzz/run.sh TARGET SECONDS. Findings lie in fuzz/artifacts/TARGET, and
# the exit status is that of libFuzzer: 0 where nothing was found. `fuzz/run.sh all SECONDS` runs every target.
#
# Stable Rust does: the flags are those that `cargo fuzz run --sanitizer none` gives.
set -euo pipefail
cd "$(dirname "$0")"
target=${1:?"usage: fuzz/run.sh TARGET|all SECONDS"}
seconds=${2:?"usage: fuzz/run.sh TARGET|all SECONDS"}
all=$(sed -n 's/^name = "\([a-z0-9]*\)"$/\1/p' Cargo.toml)

host=$(rustc -vV | sed -n 's/^host: //p')
flags="--cfg fuzzing -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4"
flags+=" -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table"
flags+=" -Cllvm-args=-sanitizer-coverage-trace-compares -Cllvm-args=-simplifycfg-branch-fold-threshold=0"
if [ "${host%%-*}" = x86_64 ]; then flags+=" -Ctarget-cpu=x86-64-v3"; fi
# `--target` keeps the flags away from build scripts and procedural macros.
RUSTFLAGS="$flags" cargo build --release --bins --target "$host" --quiet

# Files that readers want by path go to memory.
scratch=$(mktemp -d -p "$(test -d /dev/shm && echo /dev/shm || echo /tmp)")
trap 'rm -rf "$scratch"' EXIT
export TMPDIR="$scratch"

# A fuzzer that cannot fail finds nothing.
if DSFMS_FUZZ_CANARY=1 "target/$host/release/options" -runs=1 -artifact_prefix="$scratch/" >/dev/null 2>&1; then
    echo "a panic does not end a target" >&2
    exit 1
fi

one() {
    local name=$1 places
    mkdir -p "corpus/$name" "artifacts/$name" "$scratch/$name"
    places=("corpus/$name" "$scratch/$name")
    for seeds in "seeds/$name" "../crates/dsfms/tests/corpus/$name"; do
        # Large files make every mutant of them slow.
        if [ -d "$seeds" ]; then find "$seeds" -type f -size -17k -exec cp {} "$scratch/$name" \;; fi
    done
    local words=()
    if [ -f "dictionaries/$name.dict" ]; then words=("-dict=dictionaries/$name.dict"); fi
    # The bounds of docs/robustness.md; a reader takes milliseconds.
    RAYON_NUM_THREADS=1 "target/$host/release/$name" "${places[@]}" "${words[@]}" \
        -max_total_time="$seconds" -timeout="${DSFMS_FUZZ_TIMEOUT:-10}" -rss_limit_mb=2048 -max_len=65536 \
        -artifact_prefix="artifacts/$name/" -print_final_stats=1
}

if [ "$target" = all ]; then
    status=0
    for name in $all; do
        echo "== $name"
        one "$name" || status=$?
    done
    exit "$status"
fi
one "$target"
