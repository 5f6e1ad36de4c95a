#!/usr/bin/env bash
# relevo build against GDAL's COG writer, on the same DEM in the same run.
#
#   bench/compare.sh DEM.tif [RUNS]
#
# Prints a Markdown table: median wall time, peak memory, output size, samples a second, and how relevo compares.
# Both write every level of a pyramid, losslessly, with zstd and two threads; relevo computes its errors besides.
# Times come from hyperfine where it is installed, memory from /usr/bin/time. The DEM is read once before, so that
# both find it in the page cache; the outputs go to a temporary folder beside it (TMPDIR overrides).
set -euo pipefail

die() { printf 'compare.sh: %s\n' "$*" >&2; exit 2; }
(($# == 1 || $# == 2)) || die "usage: bench/compare.sh DEM.tif [RUNS]"
dem=$1
runs=${2:-3}
[ -r "$dem" ] || die "$dem: cannot be read"
[[ $runs =~ ^[1-9][0-9]*$ ]] || die "RUNS must be a whole number above 0, not $runs"
for tool in gdal_translate gdalinfo python3 /usr/bin/time; do
    command -v "$tool" >/dev/null || die "$tool is missing (Debian: gdal-bin, python3, time)"
done

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
relevo=${RELEVO:-$target/release/relevo}
if [ -z "${RELEVO:-}" ]; then
    cargo build --quiet --release --locked --manifest-path "$root/Cargo.toml" --bin relevo >&2
fi
work=$(mktemp -d "${TMPDIR:-$(dirname "$dem")}/relevo-compare.XXXXXX")
trap 'rm -rf "$work"' EXIT

samples=$(gdalinfo -json "$dem" | python3 -c 'import json, sys; w, h = json.load(sys.stdin)["size"]; print(w * h)')
ours=("$relevo" build "$dem" -o "$work/out.rlv" --force --jobs 2)
theirs=(gdal_translate -q -of COG -co COMPRESS=ZSTD -co PREDICTOR=YES -co NUM_THREADS=2
    -co OVERVIEW_RESAMPLING=NEAREST -co BIGTIFF=IF_SAFER "$dem" "$work/out.tif")

# Median of the numbers on stdin.
median() { sort -g | awk '{ v[NR] = $1 } END { print NR % 2 ? v[(NR + 1) / 2] : (v[NR / 2] + v[NR / 2 + 1]) / 2 }'; }

# seconds COMMAND...: median wall time of the runs.
seconds() {
    if command -v hyperfine >/dev/null; then
        hyperfine -N --style none --warmup 0 --runs "$runs" --export-json "$work/times.json" \
            "$(printf '%q ' "$@")" >&2
        python3 -c 'import json, sys; print(json.load(open(sys.argv[1]))["results"][0]["median"])' "$work/times.json"
        return
    fi
    local start
    for ((i = 0; i < runs; i++)); do
        start=$(date +%s%N)
        "$@" >/dev/null 2>"$work/errors" || { cat "$work/errors" >&2; return 1; }
        awk -v ns=$(($(date +%s%N) - start)) 'BEGIN { print ns / 1e9 }'
    done | median
}

# memory COMMAND...: peak resident MB of one run, which also stands for the first, uncounted one.
memory() {
    /usr/bin/time -f %M -o "$work/memory" "$@" >/dev/null 2>"$work/errors" || { cat "$work/errors" >&2; return 1; }
    awk 'END { print $1 / 1024 }' "$work/memory"
}

cat "$dem" >/dev/null
our_memory=$(memory "${ours[@]}")
their_memory=$(memory "${theirs[@]}")
our_seconds=$(seconds "${ours[@]}")
their_seconds=$(seconds "${theirs[@]}")
our_bytes=$(stat -c %s "$work/out.rlv")
their_bytes=$(stat -c %s "$work/out.tif")

printf '%s: %s samples, median of %s runs, %s processors, %s, %s\n\n' "$(basename "$dem")" "$samples" "$runs" \
    "$(nproc)" "$("$relevo" --version)" "$(gdalinfo --version | cut -d, -f1)"
awk -v n="$samples" -v as="$our_seconds" -v bs="$their_seconds" -v am="$our_memory" -v bm="$their_memory" \
    -v ab="$our_bytes" -v bb="$their_bytes" 'BEGIN {
    print "| | relevo build | gdal_translate -of COG | relevo : GDAL |"
    print "|---|--:|--:|--:|"
    printf "| wall time, s | %.2f | %.2f | %.2f |\n", as, bs, as / bs
    printf "| samples a second, millions | %.1f | %.1f | %.2f |\n", n / as / 1e6, n / bs / 1e6, bs / as
    printf "| peak memory, MiB | %.0f | %.0f | %.2f |\n", am, bm, am / bm
    printf "| output, MB | %.2f | %.2f | %.2f |\n", ab / 1e6, bb / 1e6, ab / bb
    printf "| output, bits a sample | %.2f | %.2f | %.2f |\n", 8 * ab / n, 8 * bb / n, ab / bb
}'
