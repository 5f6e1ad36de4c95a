#!/usr/bin/env bash
# Installs what the tests need, runs every check, and ends with one line: "N passed, N failed".
# A check other than a test (formatting, lints, documentation, dependencies) counts as one failure if it fails.
# Exit code 0 if nothing failed, 1 otherwise. RELEVO_INSTALL_DENY=1 installs cargo-deny where it is missing.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"

# Everything is compiled once here: what makes the next compilation quicker would only cost time.
export CARGO_INCREMENTAL=0

passed=0
failed=0
failures=()
log=$(mktemp)
trap 'rm -f "$log"' EXIT

# Adds up the summaries of cargo test ("test result: ok. 8 passed; 1 failed") and of nextest ("44 passed, 1 failed,
# 1 timed out"); prints both sums.
count() {
    awk '
        /^test result:/ || /^ *Summary \[/ {
            for (i = 1; i < NF; i++) {
                word = $(i + 1)
                if (word ~ /^passed/) good += $i
                if (word ~ /^failed/ || word ~ /^timed/ || word ~ /^exec/) bad += $i
            }
        }
        END { print good + 0, bad + 0 }' "$1"
}

# run NAME COMMAND...: runs a check or a test runner, counts its tests, goes on whatever comes of it.
run() {
    local name=$1 start=$SECONDS status=0 good bad
    shift
    printf '\n=== %s: %s\n' "$name" "$*"
    "$@" 2>&1 | tee "$log" || status=$?
    read -r good bad < <(count "$log")
    # A runner that never got to its tests, or a check: one failure.
    if ((status != 0 && bad == 0)); then bad=1; fi
    passed=$((passed + good))
    failed=$((failed + bad))
    if ((bad > 0)); then failures+=("$name"); fi
    printf '=== %s: %s (%d s)\n' "$name" "$( ((bad == 0)) && echo ok || echo FAILED)" $((SECONDS - start))
}

have() { command -v "$1" >/dev/null 2>&1; }

# apt PACKAGE...: installs Debian packages, as root or through sudo; quiet, and false if it cannot.
apt() {
    have apt-get || return 1
    local as=()
    if [ "$(id -u)" -ne 0 ]; then
        have sudo && sudo -n true 2>/dev/null || return 1
        as=(sudo -n)
    fi
    printf 'installing: %s\n' "$*"
    local options=(-qq -o DPkg::Lock::Timeout=120)
    "${as[@]}" env DEBIAN_FRONTEND=noninteractive apt-get "${options[@]}" update >/dev/null 2>&1 || true
    "${as[@]}" env DEBIAN_FRONTEND=noninteractive apt-get "${options[@]}" install -y --no-install-recommends "$@" \
        >/dev/null 2>&1
}

# python MODULE DEBIAN_PACKAGE PIP_PACKAGE: sees to a module of python3.
python() {
    python3 -c "import $1" 2>/dev/null && return
    apt "$2" && python3 -c "import $1" 2>/dev/null && return
    # A python3 that is not Debian's does not see Debian's packages.
    python3 -m pip install -q --break-system-packages "$3" >/dev/null 2>&1 ||
        python3 -m pip install -q "$3" >/dev/null 2>&1 ||
        printf 'MISSING, and could not be installed: the module %s of python3\n' "$1"
}

# library NAME: true if the loader finds it.
library() { [[ $(ldconfig -p 2>/dev/null || /sbin/ldconfig -p) == *"$1"* ]]; }

# GDAL's tools are the oracle of many tests; libgdal-dev and pkg-config are all that the gdal crate needs, whose
# bindings come with it. Python's zstandard and Pillow read containers in the test of the format description. The
# viewer's tests draw with Mesa's software Vulkan, and open a window on Xvfb.
install() {
    local packages=()
    have gdalinfo && have gdal_translate && have gdaldem || packages+=(gdal-bin)
    have pkg-config && pkg-config --exists gdal || packages+=(libgdal-dev pkg-config)
    have cc || packages+=(gcc libc6-dev)
    have python3 || packages+=(python3)
    have node || packages+=(nodejs)
    have npm || packages+=(npm)
    library libvulkan.so.1 || packages+=(libvulkan1)
    ls /usr/share/vulkan/icd.d/lvp_icd.*.json >/dev/null 2>&1 || packages+=(mesa-vulkan-drivers)
    have Xvfb || packages+=(xvfb)
    have xdotool || packages+=(xdotool)
    library libX11-xcb.so.1 || packages+=(libx11-6 libx11-xcb1)
    library libXcursor.so.1 || packages+=(libxcursor1)
    library libXi.so.6 || packages+=(libxi6)
    library libXrandr.so.2 || packages+=(libxrandr2)
    library libxkbcommon-x11.so.0 || packages+=(libxkbcommon0 libxkbcommon-x11-0)
    if ((${#packages[@]})); then
        apt "${packages[@]}" || printf 'MISSING, and could not be installed: %s\n' "${packages[*]}"
    fi
    python zstandard python3-zstandard zstandard
    python PIL python3-pil pillow
    # The Khronos validator of GLB files (tests/it/mesh_file/validator.rs).
    [ -d target/node/node_modules/gltf-validator ] ||
        npm install --silent --no-audit --no-fund --prefix target/node gltf-validator@2.0.0-dev.3.10 >/dev/null 2>&1 ||
        echo 'MISSING, and could not be installed: gltf-validator'
    # GDAL's bindings are Debian's, so they are those of Debian's python3, whichever comes first on the path.
    /usr/bin/python3 -c 'import numpy; from osgeo import gdal' 2>/dev/null ||
        python3 -c 'import numpy; from osgeo import gdal' 2>/dev/null || apt python3-gdal python3-numpy ||
        echo 'MISSING, and could not be installed: python3-gdal python3-numpy'
}

dependencies() {
    if [ "${RELEVO_INSTALL_DENY:-0}" = 1 ] && ! have cargo-deny; then
        cargo install --locked cargo-deny || true
    fi
    if have cargo-deny; then
        run deny cargo deny --all-features check
    elif have cargo-audit; then
        run audit cargo audit
    else
        echo 'not run: cargo deny check (not installed; RELEVO_INSTALL_DENY=1 installs it)'
    fi
}

install
runner=(cargo test --no-fail-fast --lib --bins --tests --examples)
# With the feature `gdal` only the binary is tested again, and of its tests only those that reach a source: what lies
# behind a source does not know of GDAL. No unit test does.
gdal=(cargo test --no-fail-fast --test it)
if cargo nextest --version >/dev/null 2>&1; then
    runner=(cargo nextest run --no-fail-fast)
    behind='comments|container|each|imagery|layers|reader_scale|spec|golden|vectors|verify|horizontal|half_steps|observed|select|real_data|memory|resume|pieces|mesh_file|mesh_cli|mesh_nested|mesh_save|verify_mesh'
    behind+='|state|sparse|export|hillshade|geotiff_write|imagery_pyramid|fuzz_corpus|cli_pages|cli_json|hostile_text'
    gdal=(cargo nextest run --no-fail-fast --test it -E "not test(/^($behind)::/)")
fi

run fmt cargo fmt --all --check
run clippy cargo clippy --locked --workspace --all-targets -- -D warnings
# Features are those of the two crates; the viewer has none.
run clippy-features cargo clippy --locked --package relevo --package relevo-core --all-targets --all-features -- -D warnings
# A reader without features, and without a C compiler.
run core cargo clippy --locked --package relevo-core --no-default-features --features ruzstd -- -D warnings
run test "${runner[@]}" --locked --workspace
run test-gdal "${gdal[@]}" --locked --package relevo --features gdal
run doctest cargo test --locked --workspace --doc --no-fail-fast
run doc env RUSTDOCFLAGS='-D warnings' cargo doc --locked --workspace --no-deps --document-private-items
dependencies

if ((${#failures[@]})); then printf '\nfailed: %s\n' "${failures[*]}"; else echo; fi
printf '%d passed, %d failed\n' "$passed" "$failed"
((failed == 0))
