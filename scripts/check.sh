#!/usr/bin/env bash
# Everything that must hold before a change lands. Stops at the first failure.
set -eu
cd "$(dirname "$0")/.."
if ! command -v cargo >/dev/null && [ -f "$HOME/.cargo/env" ]; then . "$HOME/.cargo/env"; fi
step() { printf '\n== %s\n' "$*"; }

# Files that a macro declares (commands, effects) are not among those that `cargo fmt` sees.
step "format";            find build.rs src tests benches examples -name '*.rs' -exec rustfmt --check --edition 2024 {} +
step "licences";          python3 scripts/licences.py
step "lints, all parts";  cargo clippy --locked --release --all-targets -- -D warnings
step "lints, no OpenCV";  cargo clippy --locked --release --no-default-features --all-targets -- -D warnings
step "documentation";     RUSTDOCFLAGS="-D warnings" cargo doc --locked --release --no-deps --quiet
step "build, no OpenCV";  cargo build --locked --release --no-default-features --target-dir target/no-vision
step "tests";             cargo test --locked --release
