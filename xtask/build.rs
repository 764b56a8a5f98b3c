//! Which target this is compiled for: cargo's settings for it have its name.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    if let Ok(target) = std::env::var("TARGET") {
        println!("cargo:rustc-env=SOFTRIG_HOST={target}");
    }
}
