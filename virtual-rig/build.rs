// SPDX-License-Identifier: GPL-3.0-or-later
//! Finds simavr and compiles the shim between its structures and Rust.

fn main() {
    println!("cargo::rerun-if-changed=src/shim.c");
    let simavr = match pkg_config::Config::new()
        .atleast_version("1.6")
        .probe("simavr")
    {
        Ok(library) => library,
        Err(error) => {
            // cargo shows this line and stops; a panic would bury it in a backtrace.
            println!(
                "cargo::error=the virtual rig needs the simavr library with its headers: \
                 run `cargo xtask setup` ({error})"
            );
            return;
        }
    };
    cc::Build::new()
        .file("src/shim.c")
        .includes(&simavr.include_paths)
        .warnings(true)
        .extra_warnings(true)
        .warnings_into_errors(false)
        .flag_if_supported("-std=gnu11")
        .compile("softrig_simavr_shim");
}
