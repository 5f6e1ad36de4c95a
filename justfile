# Shortcuts; `just` lists them. Everything that must pass is in test.sh.
_list:
    @just --list

# All checks, as continuous integration runs them.
test:
    ./test.sh

# Lints and tests, quickly.
check:
    cargo fmt --all --check
    cargo clippy --workspace --all-targets -- -D warnings
    cargo nextest run --workspace

# Synthetic terrain: just synth 4097 out.tif --voids
synth *args:
    cargo run --release --example synth -- {{args}}

# relevo build against GDAL's COG writer: just compare dem.tif
compare *args:
    bench/compare.sh {{args}}

# Micro-benchmarks.
bench *args:
    cargo bench {{args}}
