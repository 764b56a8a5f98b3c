//! The board's image: its compiler, its build, and its checks.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

use crate::image::{self, stamp::FLASH_BYTES};
use crate::shell::{self, Outcome, read, root, run, target_dir};
use crate::stack;

/// The toolchain name that `firmware/rust-toolchain.toml` asks for.
pub const TOOLCHAIN: &str = "softrig-avr";

/// The oldest compiler with the fixes to the AVR backend that we rely on.
pub const OLDEST: Version = Version(1, 96);

/// The compiler that the figures in the documentation come from.
pub const TESTED: &str = "1.96.0";

/// A compiler's version, as far as it matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version(pub u32, pub u32);

impl Version {
    /// Reads the first `MAJOR.MINOR` in a text like `rustc 1.96.0 (…)` or
    /// `1:1.96.0+dfsg1-1`.
    pub fn parse(text: &str) -> Option<Self> {
        text.split([' ', ':', '\n']).find_map(|word| {
            let mut parts = word.split('.');
            let major = parts.next()?.parse().ok()?;
            let minor = parts.next()?.parse().ok()?;
            parts.next()?;
            Some(Self(major, minor))
        })
    }
}

/// The folder that the toolchain's name is linked to.
pub fn toolchain_dir() -> Outcome<PathBuf> {
    let data = env::var_os("XDG_DATA_HOME")
        .map(PathBuf::from)
        .filter(|path| path.is_absolute())
        .or_else(|| Some(PathBuf::from(env::var_os("HOME")?).join(".local/share")))
        .ok_or("neither XDG_DATA_HOME nor HOME is set: nowhere to put the toolchain's link")?;
    Ok(data.join("softrig/avr-toolchain"))
}

/// Whether a compiler can build the board's core library: new enough, with the
/// library's source.
pub fn is_usable(rustc: &Path) -> Option<Version> {
    let version = Version::parse(&read(Command::new(rustc).arg("--version")).ok()?)?;
    let sysroot = read(Command::new(rustc).args(["--print", "sysroot"])).ok()?;
    let source = Path::new(&sysroot).join("lib/rustlib/src/rust/library/core/Cargo.toml");
    (version >= OLDEST && source.is_file()).then_some(version)
}

/// Links the toolchain's name to the compiler in `bin`.
///
/// The folder holds scripts, not links: the compiler must be told that it may
/// build the core library, cargo must not take another compiler off the path, and
/// the warning that old avr-gcc has no `-no-pie` is for nobody.
pub fn link(bin: &Path) -> Outcome {
    let folder = toolchain_dir()?;
    let scripts = folder.join("bin");
    let explain = |error| format!("cannot write {}: {error}", folder.display());
    fs::create_dir_all(&scripts).map_err(explain)?;
    // rustup takes a folder for a toolchain only if it has a lib.
    fs::create_dir_all(folder.join("lib")).map_err(explain)?;
    for tool in ["cargo", "rustc", "rustdoc"] {
        let script = format!(
            "#!/bin/sh\n\
             export RUSTC_BOOTSTRAP=1 RUSTC_LOG=error RUSTC={} RUSTDOC={}\n\
             exec {} \"$@\"\n",
            quoted(&bin.join("rustc")),
            quoted(&bin.join("rustdoc")),
            quoted(&bin.join(tool)),
        );
        let path = scripts.join(tool);
        fs::write(&path, script).map_err(explain)?;
        make_executable(&path)?;
    }
    if shell::has_program("rustup") {
        let folder = folder.display().to_string();
        shell::read(Command::new("rustup").args(["toolchain", "link", TOOLCHAIN, &folder]))?;
    }
    Ok(())
}

fn quoted(path: &Path) -> String {
    format!("'{}'", path.display().to_string().replace('\'', r"'\''"))
}

#[cfg(unix)]
fn make_executable(path: &Path) -> Outcome {
    use std::os::unix::fs::PermissionsExt;
    fs::set_permissions(path, fs::Permissions::from_mode(0o755))
        .map_err(|error| format!("cannot make {} executable: {error}", path.display()).into())
}

#[cfg(not(unix))]
fn make_executable(_: &Path) -> Outcome {
    Err("the AVR toolchain is linked by shell scripts: use Linux, macOS or WSL".into())
}

/// Whether the name is linked and what it leads to works.
pub fn is_linked() -> bool {
    let Ok(folder) = toolchain_dir() else {
        return false;
    };
    let known_to_rustup = !shell::has_program("rustup")
        || read(Command::new("rustup").args(["toolchain", "list"]))
            .is_ok_and(|list| list.lines().any(|line| line.starts_with(TOOLCHAIN)));
    known_to_rustup && is_usable(&folder.join("bin/rustc")).is_some()
}

/// Builds the image and returns its path.
pub fn build() -> Outcome<PathBuf> {
    let cargo = toolchain_dir()?.join("bin/cargo");
    if !cargo.is_file() {
        return Err("the AVR toolchain is not linked: run `cargo xtask setup`".into());
    }
    run(Command::new(cargo)
        .args(["build", "--release", "--locked"])
        .current_dir(root().join("firmware"))
        .env("CARGO_TARGET_DIR", target_dir())
        // They would replace the flag that names the processor.
        .env_remove("RUSTFLAGS")
        .env_remove("CARGO_ENCODED_RUSTFLAGS")
        .env_remove("CARGO_BUILD_RUSTFLAGS"))?;
    let image = target_dir().join("avr-none/release/firmware.elf");
    if !image.is_file() {
        return Err(format!("the build left no {}", image.display()).into());
    }
    image::stamp(&image)?;
    run(Command::new("avr-objcopy")
        .args(["-O", "ihex", "-R", ".eeprom"])
        .args([&image, &hex(&image)]))?;
    Ok(image)
}

/// The image in Intel's format, which [`build`] leaves beside it.
pub fn hex(image: &Path) -> PathBuf {
    image.with_extension("hex")
}

/// Bytes of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Flash: code, constants and initial values.
    pub flash: u64,
    /// RAM before the first call: variables and constants.
    pub static_ram: u64,
}

const RAM_BYTES: u64 = 8 * 1024;

/// Measures an image.
pub fn size(image: &Path) -> Outcome<Size> {
    let table = read(Command::new("avr-size").arg("-A").arg(image))?;
    let section = |name: &str| -> u64 {
        table
            .lines()
            .filter_map(|line| {
                let mut fields = line.split_whitespace();
                (fields.next()? == name).then(|| fields.next()?.parse::<u64>().ok())?
            })
            .sum()
    };
    let (text, data) = (section(".text"), section(".data"));
    if text == 0 {
        return Err(format!("{} has no code", image.display()).into());
    }
    Ok(Size {
        flash: text + data,
        static_ram: data + section(".bss") + section(".noinit"),
    })
}

/// The instructions of an image, as text.
pub fn disassembly(image: &Path) -> Outcome<String> {
    read(
        Command::new("avr-objdump")
            .args(["-d", "--no-show-raw-insn"])
            .arg(image),
    )
}

/// Prints the size of an image.
pub fn print_size(image: &Path) -> Outcome {
    let Size { flash, static_ram } = size(image)?;
    println!(
        "  image: {flash} of {FLASH_BYTES} bytes of flash, {static_ram} of {RAM_BYTES} bytes of RAM before the stack"
    );
    Ok(())
}

/// Checks what must be true of every image; says all that is not.
pub fn gates(image: &Path) -> Outcome {
    let symbols = read(Command::new("avr-nm").arg("--defined-only").arg(image))?;
    let bytes =
        fs::read(image).map_err(|error| format!("cannot read {}: {error}", image.display()))?;
    let mut broken = broken_gates(&symbols, &bytes);
    broken.extend(stack::nesting(&disassembly(image)?)?);
    if broken.is_empty() {
        println!(
            "  gates: avr-libc's float routines, no 64-bit floats, no core::fmt, no panics, no `!!!`, interrupts do not nest"
        );
        Ok(())
    } else {
        Err(broken.join("\n").into())
    }
}

fn broken_gates(symbols: &str, bytes: &[u8]) -> Vec<String> {
    let names = || {
        symbols
            .lines()
            .filter_map(|line| line.split_whitespace().last())
    };
    let mut broken = Vec::new();
    let doubles: Vec<&str> = names().filter(|name| is_f64_helper(name)).collect();
    if !doubles.is_empty() {
        broken.push(format!(
            "64-bit floats are in the image ({}): with avr-libc they bind to 32-bit functions; use f32",
            doubles.join(", ")
        ));
    }
    if names().any(|name| name.contains("core3fmt5float") || name.contains("flt2dec")) {
        broken.push(
            "core::fmt formats floats in the image, which costs 32 KiB: use wire::decimal".into(),
        );
    }
    if !names().any(|name| name == "__mulsf3x") {
        broken.push(
            "avr-libc's float routines are not in the image: the link order changed and the \
             control loop is five times slower; see firmware/build.rs"
                .into(),
        );
    }
    let panics: Vec<&str> = names().filter(|name| name.contains("9panicking")).collect();
    if !panics.is_empty() {
        broken.push(format!(
            "the image can panic ({}): a control loop must go on; find the caller with avr-objdump",
            panics.join(", ")
        ));
    }
    if names().any(|name| name.contains("4core3fmt")) {
        broken.push("core::fmt is in the image: write with ufmt".into());
    }
    if bytes.windows(3).any(|window| window == b"!!!") {
        broken.push("`!!!` is in the image: old bootloaders drop into their monitor on it".into());
    }
    broken
}

/// Whether a symbol is a helper for 64-bit floats: `__` + letters with `df`.
fn is_f64_helper(name: &str) -> bool {
    name.strip_prefix("__")
        .and_then(|rest| rest.split_once("df"))
        .is_some_and(|(before, after)| {
            before.bytes().all(|byte| byte.is_ascii_lowercase())
                && after
                    .bytes()
                    .all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit())
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_read_from_compilers_and_packages() {
        for text in [
            "rustc 1.96.0 (ac68faa20 2026-05-25) (built from a source tarball)",
            "1.96.0+dfsg1-1~deb12u2",
            "1:1.96.0~rc1",
        ] {
            assert_eq!(Version::parse(text), Some(Version(1, 96)), "{text}");
        }
        assert_eq!(Version::parse("(none)"), None);
        assert!(Version(1, 100) > OLDEST && Version(1, 95) < OLDEST);
    }

    #[test]
    fn helpers_for_64_bit_floats_are_told_from_the_others() {
        for name in ["__muldf3", "__fixdfsi", "__floatunsidf", "__extendsfdf2"] {
            assert!(is_f64_helper(name), "{name}");
        }
        for name in [
            "__mulsf3",
            "__mulsf3x",
            "__udivmodsi4",
            "_ZN2__df_17h0E",
            "df",
        ] {
            assert!(!is_f64_helper(name), "{name}");
        }
    }

    #[test]
    fn each_gate_can_fail() {
        let good = "00000100 T main\n00000200 T __mulsf3x\n";
        assert!(broken_gates(good, b"quiet").is_empty());
        assert_eq!(broken_gates(&format!("{good}1 T __adddf3\n"), b"").len(), 1);
        for (symbol, gates) in [
            ("_ZN4core3fmt5float17h0E", 2),
            ("_RNvNtNtCs7_4core3fmt5write", 1),
            ("_RNvNtCs7_4core9panicking9panic_fmt", 1),
        ] {
            let symbols = format!("{good}1 t {symbol}\n");
            assert_eq!(broken_gates(&symbols, b"").len(), gates, "{symbol}");
        }
        assert_eq!(broken_gates("00000100 T main\n", b"").len(), 1);
        assert_eq!(broken_gates(good, b"stop!!!").len(), 1);
    }

    #[test]
    fn quoting_survives_apostrophes() {
        assert_eq!(quoted(Path::new("/it's")), r"'/it'\''s'");
    }
}
