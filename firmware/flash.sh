#!/bin/sh
# The runner behind `cargo run` in this folder: ravedude, which nothing else needs, is
# installed when it is first asked for. Cargo calls this with the image and what follows `--`.
set -e
if ! command -v ravedude > /dev/null; then
    # Cargo has set the board's compiler for us; the set-up is for the computer's.
    (cd "$(dirname "$0")/.." && env -u RUSTUP_TOOLCHAIN -u RUSTC -u RUSTDOC -u RUSTC_BOOTSTRAP \
        -u CARGO -u CARGO_TARGET_DIR cargo xtask setup --for cargo-run)
fi
exec ravedude "$@"
