#!/usr/bin/env bash
# All figures of BENCHMARKS.md by one command: relevo against GDAL's COG writer, decoding alone, and reading back.
#
#   bench/run.sh [--data DIR] [--sizes N,N,...] [--float-sizes N,N,...] [--tiles DIR] [--runs N] [--report-only]
#
#   --data DIR         where rasters, outputs and results go (target/bench-data); 65537 needs some 30 GB there
#   --sizes LIST       sides of the synthetic int16 rasters (4097,16385,32769,65537)
#   --float-sizes LIST sides of the synthetic float32 rasters (8193,16385)
#   --tiles DIR        a folder of real int16 elevation tiles (SRTM); adds a mosaic of them
#   --mosaic-size N    its side (16385)
#   --runs N           runs of each command, in turn (3; of rasters above 2^31 samples 1)
#   --report-only      write BENCHMARKS.md and docs/scaling.svg from the results that are there
#
# What has been made or measured stays in DIR and is not made again: a run that was interrupted goes on where it stopped.
# Measure on a machine that does nothing else.
set -euo pipefail

die() { printf 'run.sh: %s\n' "$*" >&2; exit 2; }
say() { printf '%s %s\n' "$(date +%H:%M:%S)" "$*" >&2; }

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
data=$root/target/bench-data
sizes=4097,16385,32769,65537
float_sizes=8193,16385
tiles=
mosaic_size=16385
runs=3
report_only=
while (($#)); do
    case $1 in
        --report-only) report_only=1; shift; continue ;;
        --data | --sizes | --float-sizes | --tiles | --mosaic-size | --runs) (($# > 1)) || die "$1 needs a value" ;;
        -h | --help) sed -n '2,/^set/{/^#/s/^# \{0,1\}//p}' "${BASH_SOURCE[0]}"; exit 0 ;;
        *) die "what is $1? See bench/run.sh --help" ;;
    esac
    case $1 in
        --data) data=$2 ;;
        --sizes) sizes=$2 ;;
        --float-sizes) float_sizes=$2 ;;
        --tiles) tiles=$2 ;;
        --mosaic-size) mosaic_size=$2 ;;
        --runs) runs=$2 ;;
    esac
    shift 2
done
[[ $runs =~ ^[1-9][0-9]*$ ]] || die "--runs must be a whole number above 0, not $runs"
command -v python3 >/dev/null || die "python3 is missing"
mkdir -p "$data/results"
data=$(cd "$data" && pwd)
report() { python3 "$root/bench/report.py" "$root" "$data"; }
if [ -n "$report_only" ]; then
    report
    exit
fi

for tool in gdal_translate gdalinfo /usr/bin/time; do
    command -v "$tool" >/dev/null || die "$tool is missing (Debian: gdal-bin, time)"
done
say "building"
cargo build --quiet --release --locked --manifest-path "$root/Cargo.toml" --bin relevo \
    --example synth --example decode_only --example read_bench
programs=$target/release

# make FILE COMMAND...: runs COMMAND with a name for its output, unless FILE is there already.
make() {
    local file=$1
    shift
    [ -e "$file" ] && return
    say "making $(basename "$file")"
    "$@" "$data/unfinished.tif" >&2
    mv "$data/unfinished.tif" "$file"
}
# synth_to SIDE TYPE OUT
synth_to() { "$programs/examples/synth" "$1" "$3" --type "$2" --compress none --force; }
# The output comes last in `make`.
tiled() { gdal_translate -q -co TILED=YES -co "COMPRESS=$2" -co PREDICTOR=2 -co BIGTIFF=IF_SAFER "$1" "$3"; }
mosaic() { python3 "$root/bench/mosaic.py" "$tiles" "$mosaic_size" "$1"; }

cases=()
variant_of=
for side in ${sizes//,/ }; do
    make "$data/int16-$side.tif" synth_to "$side" int16
    cases+=("int16-$side")
    if ((side <= 16385)); then variant_of=$side; fi
done
for side in ${float_sizes//,/ }; do
    make "$data/float32-$side.tif" synth_to "$side" float32
    cases+=("float32-$side")
done
if [ -n "$variant_of" ]; then
    for compression in DEFLATE ZSTD; do
        name=int16-$variant_of-${compression,,}
        make "$data/$name.tif" tiled "$data/int16-$variant_of.tif" "$compression"
        cases+=("$name")
    done
fi
if [ -n "$tiles" ]; then
    make "$data/mosaic-$mosaic_size.tif" mosaic
    cases+=("mosaic-$mosaic_size")
fi

for case in "${cases[@]}"; do
    python3 "$root/bench/measure.py" "$data" "$case" "$runs" "$programs"
done
report
