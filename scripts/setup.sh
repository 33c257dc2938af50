#!/usr/bin/env bash
# Sets up a Debian 12 machine for sweetspot: what is there is left alone, what is missing is named and installed.
#   scripts/setup.sh build   what the program needs
#   scripts/setup.sh test    that, and what the tests need: real checkerboard pictures, Python readers of our exports
set -eu
cd "$(dirname "$0")/.."
goal=${1:-build}

say() { printf 'set-up: %s\n' "$*" >&2; }
die() { say "$*"; exit 1; }

as_root() {
  if [ "$(id -u)" = 0 ]; then "$@"; elif command -v sudo >/dev/null; then sudo "$@"; else die "'$*' needs root; become root or install sudo"; fi
}

if ! command -v cargo >/dev/null && [ -f "$HOME/.cargo/env" ]; then . "$HOME/.cargo/env"; fi
command -v cargo >/dev/null || die "cargo is missing. Get Rust 1.90 or newer with rustup (https://rustup.rs), open a new shell, and run this again. Debian 12's own rustc is too old."
minor=$(rustc --version | sed -E 's/^rustc 1\.([0-9]+)\..*/\1/')
[ "$minor" -ge 90 ] 2>/dev/null || die "$(rustc --version) is too old; this project needs 1.90 or newer: run 'rustup update stable'"

refreshed=
refresh() { [ -n "$refreshed" ] || { say "apt-get update"; as_root apt-get update -qq || die "apt-get update failed; is the network there?"; refreshed=1; }; }
installed() { dpkg-query -W -f '${Status}' "$1" 2>/dev/null | grep -q '^install ok installed'; }

# opencv: Debian's 4.6 with headers; clang and libclang: the binding is generated from those headers; g++ compiles it.
want="g++ pkg-config clang libclang-dev libopencv-dev"
[ "$goal" = test ] && want="$want python3 python3-venv git"
missing=
for package in $want; do installed "$package" || missing="$missing $package"; done
if [ -n "$missing" ]; then
  command -v apt-get >/dev/null || die "this machine has no apt-get; install by hand:$missing"
  say "installing with apt:$missing"
  refresh
  as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing >/dev/null || die "apt-get could not install:$missing"
fi

[ "$goal" = test ] || exit 0

pictures=calib/bouguet/calib
if [ "$(ls $pictures/left/left*.jpg $pictures/right/right*.jpg 2>/dev/null | wc -l)" != 26 ]; then
  say "fetching the 13 real checkerboard pairs from Debian's opencv-doc package (96 MB; unpacked, not installed)"
  box=$(mktemp -d); trap 'rm -rf "$box"' EXIT
  if ! (cd "$box" && apt-get download -qq opencv-doc >/dev/null 2>&1); then
    refresh
    (cd "$box" && apt-get download -qq opencv-doc >/dev/null 2>&1) || die "apt-get download opencv-doc failed; is the network there?"
  fi
  dpkg-deb -x "$box"/opencv-doc_*.deb "$box/unpacked"
  data=$box/unpacked/usr/share/doc/opencv-doc/examples/data
  for side in left right; do
    mkdir -p $pictures/$side
    for n in 01 02 03 04 05 06 07 08 09 11 12 13 14; do cp "$data/$side$n.jpg" $pictures/$side/; done
  done
fi

# A virtual environment of the project's own; nothing is installed system-wide.
if ! .venv/bin/python -c 'import c3d, numpy' 2>/dev/null; then
  say "making .venv with the Python packages that read our exports back: c3d, numpy"
  python3 -m venv .venv && .venv/bin/pip install -q --disable-pip-version-check 'c3d==0.6.0' 'numpy<3' || die "c3d 0.6.0 and numpy could not be installed from PyPI (pip's own words stand above); is the network there, or a mirror set in pip.conf? The program does not need them: only the tests that read its exports back do"
fi
