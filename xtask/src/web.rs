//! The page for a browser: program, worker, style and text in one HTML file.
//!
//! Where Rust's library for WebAssembly is installed, stock Rust builds it. Elsewhere the compiler
//! that builds the board's image does, with the standard library from its source and LLVM's linker.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    time::Duration,
};

use crate::{
    avr, setup,
    shell::{
        self, INCREMENTAL, Outcome, cargo, find_program, has_program, read, root, run, run_quietly,
        target_dir,
    },
};

/// The crate of the page.
pub const PACKAGE: &str = "softrig-web";

/// What it is compiled to.
pub const TARGET: &str = "wasm32-unknown-unknown";

/// What the page may have at most: it goes by mail.
const MOST_BYTES: usize = 6_000_000;

/// How long rustup may look for a library that it perhaps does not reach.
const DOWNLOAD_LIMIT: Duration = Duration::from_secs(90);

/// LLVM's linker for WebAssembly, which Debian calls by its version.
fn linker() -> Option<PathBuf> {
    let versions = (15..=30).rev().map(|version| format!("wasm-ld-{version}"));
    ["wasm-ld".to_owned()]
        .into_iter()
        .chain(versions)
        .find_map(find_program)
}

/// Whether stock Rust has the library for WebAssembly.
fn has_library() -> bool {
    read(
        Command::new("rustc")
            .args(["--print", "sysroot"])
            .current_dir(root()),
    )
    .is_ok_and(|sysroot| {
        Path::new(&sysroot)
            .join("lib/rustlib")
            .join(TARGET)
            .join("lib")
            .is_dir()
    })
}

/// Whether the page can be built, given the board's compiler.
pub fn is_ready() -> bool {
    has_library() || linker().is_some()
}

/// Where the page is, once it was built.
pub fn page() -> PathBuf {
    root().join("web/dist/softrig.html")
}

/// Builds the page, and returns where it is.
pub fn web() -> Outcome<PathBuf> {
    let module = module()?;
    let page = assembled(&module, firmware()?.as_deref())?;
    if page.len() > MOST_BYTES {
        return Err(format!(
            "the page has {:.1} MB, and is to have {:.1} at most",
            page.len() as f64 / 1e6,
            MOST_BYTES as f64 / 1e6
        )
        .into());
    }
    let path = self::page();
    let cannot = |error| format!("cannot write {}: {error}", path.display());
    fs::create_dir_all(path.parent().unwrap_or(&path)).map_err(cannot)?;
    fs::write(&path, &page).map_err(cannot)?;
    println!(
        "  {}: {:.2} MB, of which the program is {:.2}",
        path.display(),
        page.len() as f64 / 1e6,
        fs::metadata(&module).map_or(0.0, |about| about.len() as f64 / 1e6),
    );
    Ok(path)
}

/// Compiles the program.
fn module() -> Outcome<PathBuf> {
    if !is_ready() {
        let added = has_program("rustup")
            && run_quietly(
                Command::new("rustup")
                    .args(["target", "add", TARGET])
                    .env("RUSTUP_MAX_RETRIES", "1")
                    .current_dir(root()),
                DOWNLOAD_LIMIT,
            )
            .is_ok();
        if !added {
            setup::wasm_linker()?;
        }
    }
    let mut command = if has_library() {
        cargo()
    } else {
        let theirs = avr::toolchain_dir()?.join("bin/cargo");
        if !theirs.is_file() {
            return Err("there is neither Rust's library for WebAssembly (`rustup target add wasm32-unknown-unknown`) nor the board's compiler (`cargo xtask setup`)".into());
        }
        let mut command = Command::new(theirs);
        command
            .current_dir(root())
            .env("CARGO_TARGET_DIR", target_dir())
            .env(INCREMENTAL, "0");
        // They are stock Rust's, if that runs this program.
        for theirs in ["CARGO", "RUSTC", "RUSTDOC", "RUSTUP_TOOLCHAIN"] {
            command.env_remove(theirs);
        }
        command
    };
    command.args(["rustc", "--locked", "--profile", "web", "--target", TARGET]);
    if !has_library() {
        command.arg("-Zbuild-std=std,panic_abort");
        if let Some(linker) = linker() {
            command.env("CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_LINKER", linker);
        }
    }
    command
        .args(["-p", PACKAGE, "--lib", "--crate-type", "cdylib"])
        .env_remove("CARGO_ENCODED_RUSTFLAGS")
        .env("RUSTFLAGS", flags());
    run(&mut command)?;
    let module = target_dir().join(TARGET).join("web/softrig_web.wasm");
    if !module.is_file() {
        return Err(format!("the build left no {}", module.display()).into());
    }
    Ok(module)
}

/// Two numbers at once, which every browser that can unpack the page can compute with. Where the
/// sources are is nobody's business.
fn flags() -> String {
    let mut flags = format!(
        "-Ctarget-feature=+simd128 --remap-path-prefix={}=softrig",
        root().display()
    );
    let home = env::var_os("CARGO_HOME")
        .map(PathBuf::from)
        .or_else(|| Some(PathBuf::from(env::var_os("HOME")?).join(".cargo")));
    if let Some(home) = home {
        flags += &format!(" --remap-path-prefix={}=cargo", home.display());
    }
    flags
}

/// The image that the page flashes; none where the board's compiler is not installed.
fn firmware() -> Outcome<Option<PathBuf>> {
    if avr::is_linked() {
        return Ok(Some(avr::hex(&avr::build()?)));
    }
    println!("  without the firmware, which takes the board's compiler (`cargo xtask setup`)");
    Ok(None)
}

/// Puts the page together: each name in double braces is a file.
fn assembled(module: &Path, firmware: Option<&Path>) -> Outcome<String> {
    let text = |path: &str| {
        let path = root().join(path);
        fs::read_to_string(&path)
            .map_err(|error| format!("cannot read {}: {error}", path.display()))
    };
    let mut page = text("lab/web/page/page.html")?;
    for (name, part) in [
        (
            "report.css",
            text("host-tools/report/src/assets/style.css")?,
        ),
        ("page.css", text("lab/web/page/page.css")?),
        ("worker.js", text("lab/web/page/worker.js")?),
        ("page.js", text("lab/web/page/page.js")?),
        ("board.js", text("lab/web/page/board.js")?),
        ("wasm", packed(module)?),
        (
            "firmware",
            firmware.map_or_else(|| Ok(String::new()), packed)?,
        ),
    ] {
        if part.contains("</script") || part.contains("</style") {
            return Err(format!("{name} would end its element of the page").into());
        }
        let place = format!("{{{{{name}}}}}");
        if !page.contains(&place) {
            return Err(format!("lab/web/page/page.html has no place {place}").into());
        }
        page = page.replacen(&place, part.trim_end(), 1);
    }
    Ok(page)
}

/// A file packed with gzip, as text.
fn packed(path: &Path) -> Outcome<String> {
    let mut gzip = Command::new("gzip");
    gzip.args(["-9", "-n", "-c"]).arg(path);
    let mut packing = gzip
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|error| format!("cannot start {}: {error}", shell::text(&gzip)))?;
    let mut base64 = Command::new("base64");
    let text = base64
        .stdin(packing.stdout.take().map_or_else(Stdio::null, Stdio::from))
        .output()
        .map_err(|error| format!("cannot start base64: {error}"))?;
    let status = packing
        .wait()
        .map_err(|error| format!("cannot wait for gzip: {error}"))?;
    if !status.success() || !text.status.success() {
        return Err(format!(
            "{} could not be packed with gzip and base64",
            path.display()
        )
        .into());
    }
    Ok(String::from_utf8_lossy(&text.stdout).into_owned())
}
