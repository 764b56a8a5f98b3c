#!/bin/sh
# The runner behind `cargo run --release` in this folder: `cargo xtask flash`, with what follows `--`.
# Cargo calls this with the image and has chosen the board's compiler, where the task takes the computer's.
set -e
shift
cd "$(dirname "$0")/.."
exec env -u RUSTUP_TOOLCHAIN -u RUSTC -u RUSTDOC -u RUSTC_BOOTSTRAP -u CARGO cargo xtask flash "$@"
