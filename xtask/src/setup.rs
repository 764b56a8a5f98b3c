//! Finding what is missing and installing it.
//!
//! Beyond stable Rust the firmware and the virtual rig take a C compiler, a compiler with
//! the library source that avr-none is built from, avr-gcc as its linker, and simavr. The tests
//! add avrdude, which the virtual rig has to understand, Python, which runs exported models and the
//! package, a linker for WebAssembly, which makes the page, Chromium, which looks at reports and the
//! page, and mdBook, which makes the book.
//! Each is looked for first, so that a second run does nothing.

use std::{
    env, fs,
    io::IsTerminal,
    path::{Path, PathBuf},
    process::Command,
    time::{Duration, Instant},
};

use crate::{
    avr::{self, Version},
    shell::{self, Outcome, find_program, has_program, read, run_quietly, seconds},
    web,
};

/// How long a download may take before the next source is tried.
const DOWNLOAD_LIMIT: Duration = Duration::from_secs(90);
const INSTALL_LIMIT: Duration = Duration::from_secs(600);

/// What `setup` may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Install what is missing.
    Install,
    /// Only say what would be installed.
    DryRun,
}

/// What things are installed for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// The firmware on the virtual rig, which is all that the demo takes.
    Demo,
    /// All tests, which include the demo's loop.
    Tests,
}

impl Purpose {
    fn parse(word: &str) -> Option<Self> {
        match word {
            "demo" => Some(Self::Demo),
            "tests" => Some(Self::Tests),
            _ => None,
        }
    }
}

/// Reads the options of the set-up.
///
/// # Errors
///
/// Says what makes no sense.
pub fn parse(words: &[&str]) -> Result<(Purpose, Mode), String> {
    let (mut purpose, mut mode) = (Purpose::Tests, Mode::Install);
    let mut words = words.iter();
    while let Some(&word) = words.next() {
        match word {
            "--dry-run" => mode = Mode::DryRun,
            "--for" => {
                purpose = words
                    .next()
                    .and_then(|word| Purpose::parse(word))
                    .ok_or("setup: --for takes demo or tests")?;
            }
            _ => return Err(format!("setup: there is no option {word}")),
        }
    }
    Ok((purpose, mode))
}

/// Something that a task needs.
struct Need {
    what: &'static str,
    purposes: &'static [Purpose],
    present: fn() -> bool,
    /// Debian packages that bring it.
    debian: &'static [&'static str],
}

const NEEDS: &[Need] = &[
    Need {
        what: "a C compiler",
        purposes: &[Purpose::Demo, Purpose::Tests],
        present: || has_program("cc"),
        debian: &["gcc", "libc6-dev"],
    },
    Need {
        what: "Python 3 with virtual environments, for exported models and the package",
        purposes: &[Purpose::Tests],
        present: has_python,
        debian: PYTHON,
    },
    Need {
        what: "pkg-config",
        purposes: &[Purpose::Demo, Purpose::Tests],
        present: || has_program("pkg-config"),
        debian: &["pkg-config"],
    },
    Need {
        what: "avr-gcc with binutils",
        purposes: &[Purpose::Demo, Purpose::Tests],
        present: || has_program("avr-gcc") && has_program("avr-nm") && has_program("avr-size"),
        debian: &["gcc-avr", "binutils-avr"],
    },
    Need {
        what: "avr-libc",
        purposes: &[Purpose::Demo, Purpose::Tests],
        // Without the library avr-gcc answers with the bare name.
        present: || {
            read(Command::new("avr-gcc").args(["-mmcu=atmega2560", "-print-file-name=libm.a"]))
                .is_ok_and(|path| Path::new(&path).is_absolute())
        },
        debian: &["avr-libc"],
    },
    Need {
        what: "simavr with headers",
        purposes: &[Purpose::Demo, Purpose::Tests],
        present: || read(Command::new("pkg-config").args(["--exists", "simavr >= 1.6"])).is_ok(),
        debian: &["libsimavr-dev", "libelf-dev"],
    },
    Need {
        what: "avrdude",
        purposes: &[Purpose::Tests],
        present: || has_program("avrdude"),
        debian: &["avrdude"],
    },
    Need {
        what: "a linker for WebAssembly, or Rust's library for it, for the page",
        purposes: &[Purpose::Tests],
        present: web::is_ready,
        debian: WASM_LINKER,
    },
    Need {
        what: "Chromium, to look at reports and the page",
        purposes: &[Purpose::Tests],
        present: || chromium().is_some(),
        debian: &["chromium"],
    },
];

/// Where Chromium is, under one of the names that systems give it.
pub fn chromium() -> Option<PathBuf> {
    ["chromium", "chromium-browser", "google-chrome"]
        .into_iter()
        .find_map(find_program)
}

/// Debian packages of Python with what makes virtual environments.
const PYTHON: &[&str] = &["python3", "python3-venv"];

fn has_python() -> bool {
    read(Command::new("python3").args(["-c", "import ensurepip, venv"])).is_ok()
}

/// Finds Python with its virtual environments, or installs both: for tasks that need nothing
/// else of the [`NEEDS`].
pub fn python() -> Outcome {
    find_or_install("Python 3 with its module venv", PYTHON, has_python)
}

/// Finds the C compiler for static programs of a processor, or installs Debian's, which is for
/// this machine's processor.
pub fn musl_gcc(program: &str) -> Outcome {
    find_or_install(program, &["musl-tools"], || has_program(program))
}

/// Debian packages of LLVM's linker, which knows WebAssembly.
const WASM_LINKER: &[&str] = &["lld-19"];

/// Finds LLVM's linker for WebAssembly, or installs it.
pub fn wasm_linker() -> Outcome {
    find_or_install("a linker for WebAssembly", WASM_LINKER, web::is_ready)
}

/// Finds what one task needs, or installs its Debian packages.
fn find_or_install(what: &str, debian: &[&str], present: impl Fn() -> bool) -> Outcome {
    if present() {
        return Ok(());
    }
    if has_program("apt-get") && as_root().is_some() {
        Apt::new(Mode::Install).install(debian)?;
    }
    if present() {
        return Ok(());
    }
    Err(format!(
        "this needs {what}.\n\
         On Debian: sudo apt-get install --no-install-recommends {}",
        debian.join(" ")
    )
    .into())
}

/// The version of mdBook that was tried.
const MDBOOK: &str = "0.5.4";

/// Where mdBook is: on the search path, or where [`setup`] puts it.
pub fn mdbook() -> Option<PathBuf> {
    let ours = tools().join("bin/mdbook");
    find_program("mdbook").or_else(|| ours.is_file().then_some(ours))
}

/// Where programs are installed that only these tasks need.
fn tools() -> PathBuf {
    shell::target_dir().join("tools")
}

/// Debian packages with a compiler, its cargo and the library source. The first
/// set is what Debian 12 keeps current for browsers.
const DEBIAN_RUST: [[&str; 3]; 2] = [
    ["rustc-web", "cargo-web", "rust-web-src"],
    ["rustc", "cargo", "rust-src"],
];

/// Installs what is missing for a purpose, or says what would be.
pub fn setup(purpose: Purpose, mode: Mode) -> Outcome {
    let started = Instant::now();
    let missing: Vec<&Need> = missing(purpose).collect();
    let linked = avr::is_linked();
    let book = purpose == Purpose::Tests && mdbook().is_none();
    if missing.is_empty() && linked && !book {
        println!("setup: nothing to do ({})", seconds(started.elapsed()));
        return Ok(());
    }

    let mut apt = Apt::new(mode);
    if !missing.is_empty() {
        let what: Vec<&str> = missing.iter().map(|need| need.what).collect();
        let packages: Vec<&str> = missing
            .iter()
            .flat_map(|need| need.debian)
            .copied()
            .collect();
        println!("setup: missing {}", what.join(", "));
        if !has_program("apt-get") {
            return Err(format!(
                "no apt-get here: install {} with this system's package manager, then run \
                 `cargo xtask setup` again. On Debian and Ubuntu the packages are: {}",
                what.join(", "),
                packages.join(" ")
            )
            .into());
        }
        if mode == Mode::Install && as_root().is_none() {
            return Err(ask_for_root(&packages, linked).into());
        }
        apt.install(&packages)?;
    }
    if !linked {
        match compiler(&mut apt)? {
            Some(bin) => {
                let began = Instant::now();
                if mode == Mode::Install {
                    avr::link(&bin)?;
                }
                report(
                    mode,
                    &format!("link toolchain {} to {}", avr::TOOLCHAIN, bin.display()),
                    began,
                );
            }
            None => report(
                mode,
                &format!("link toolchain {} to what was installed", avr::TOOLCHAIN),
                Instant::now(),
            ),
        }
    }
    if book {
        build_mdbook(mode)?;
    }
    if mode == Mode::DryRun {
        println!("setup: dry run, nothing was changed");
        return Ok(());
    }
    if let Some(need) = self::missing(purpose).next() {
        return Err(format!(
            "{} is still missing after its packages ({}) were installed",
            need.what,
            need.debian.join(" ")
        )
        .into());
    }
    if !avr::is_linked() {
        return Err(format!("toolchain {} was linked but does not work", avr::TOOLCHAIN).into());
    }
    println!("setup: done in {}", seconds(started.elapsed()));
    Ok(())
}

/// What a purpose takes and this machine has not.
fn missing(purpose: Purpose) -> impl Iterator<Item = &'static Need> {
    NEEDS
        .iter()
        .filter(move |need| need.purposes.contains(&purpose) && !(need.present)())
}

/// Builds mdBook without its web server and without optimisation, which takes about a minute of
/// one core; the book then takes a second.
fn build_mdbook(mode: Mode) -> Outcome {
    let began = Instant::now();
    let mut command = shell::cargo();
    command
        .args(["install", "mdbook", "--version", MDBOOK, "--locked"])
        .args(["--debug", "--no-default-features", "--features", "search"])
        .arg("--root")
        .arg(tools())
        .env("CARGO_PROFILE_DEV_DEBUG", "0");
    if mode == Mode::Install {
        run_quietly(&mut command, INSTALL_LIMIT)?;
    }
    report(mode, &shell::text(&command), began);
    Ok(())
}

/// The commands that someone who may has to run, all in one message.
fn ask_for_root(packages: &[&str], linked: bool) -> String {
    let mut packages = packages.to_vec();
    let mut last = String::new();
    if !linked && installed_compiler().is_none() {
        if has_program("rustup") {
            last = format!(
                "  rustup toolchain install {} --profile minimal --component rust-src\n",
                avr::TESTED
            );
        } else if let Some(rust) = debian_rust() {
            packages.extend(rust);
        }
    }
    format!(
        "installing needs root, and there is no sudo without a password here. Run\n  \
         sudo apt-get update\n  \
         sudo apt-get install --no-install-recommends {}\n{last}\
         then `cargo xtask setup` again",
        packages.join(" ")
    )
}

fn report(mode: Mode, what: &str, began: Instant) {
    match mode {
        Mode::Install => println!("setup: {what}: {}", seconds(began.elapsed())),
        Mode::DryRun => println!("setup: would {what}"),
    }
}

/// Finds or installs a compiler for the board and returns its folder; nothing in
/// a dry run that would install one.
fn compiler(apt: &mut Apt) -> Outcome<Option<PathBuf>> {
    if let Some(bin) = installed_compiler() {
        return Ok(Some(bin));
    }
    // Someone who switched rustup's downloads off is asked last.
    let reluctant = env::var("RUSTUP_AUTO_INSTALL").is_ok_and(|value| value == "0");
    let mut failures = Vec::new();
    let sources: [fn(&mut Apt) -> Outcome; 2] = if reluctant {
        [rust_from_debian, rust_from_rustup]
    } else {
        [rust_from_rustup, rust_from_debian]
    };
    for source in sources {
        match source(apt) {
            Ok(()) if apt.mode == Mode::DryRun => return Ok(None),
            Ok(()) => match installed_compiler() {
                Some(bin) => return Ok(Some(bin)),
                None => failures.push("it was installed but cannot be found".to_owned()),
            },
            Err(failure) => {
                println!("setup: {failure}");
                failures.push(failure.0);
            }
        }
    }
    Err(format!(
        "no compiler for the board: it takes Rust {}.{} or newer with its library source.\n\
         Try one of\n  rustup toolchain install {} --profile minimal --component rust-src\n  \
         apt-get install --no-install-recommends {}\nthen `cargo xtask setup` again",
        avr::OLDEST.0,
        avr::OLDEST.1,
        avr::TESTED,
        DEBIAN_RUST[0].join(" "),
    )
    .into())
}

/// The folder of the best compiler that is already here: the tested version if
/// there is one, else the oldest that will do.
fn installed_compiler() -> Option<PathBuf> {
    let tested = Version::parse(avr::TESTED);
    let mut found: Vec<(bool, Version, PathBuf)> = rustup_toolchains()
        .into_iter()
        .map(|folder| folder.join("bin"))
        .chain([PathBuf::from("/usr/bin")])
        .filter(|bin| bin.join("cargo").is_file() && bin.join("rustdoc").is_file())
        .filter_map(|bin| {
            let version = avr::is_usable(&bin.join("rustc"))?;
            Some((Some(version) != tested, version, bin))
        })
        .collect();
    found.sort();
    found.into_iter().next().map(|(_, _, bin)| bin)
}

fn rustup_toolchains() -> Vec<PathBuf> {
    let home = env::var_os("RUSTUP_HOME")
        .map(PathBuf::from)
        .or_else(|| Some(PathBuf::from(env::var_os("HOME")?).join(".rustup")));
    home.and_then(|home| fs::read_dir(home.join("toolchains")).ok())
        .into_iter()
        .flatten()
        .flatten()
        .filter(|entry| entry.file_name() != avr::TOOLCHAIN)
        .map(|entry| entry.path())
        .collect()
}

fn rust_from_rustup(apt: &mut Apt) -> Outcome {
    if !has_program("rustup") {
        return Err("no rustup here".into());
    }
    let began = Instant::now();
    let mut command = Command::new("rustup");
    command
        .args(["toolchain", "install", avr::TESTED, "--profile", "minimal"])
        .args(["--component", "rust-src", "--no-self-update"])
        .env("RUSTUP_MAX_RETRIES", "1");
    if apt.mode == Mode::Install {
        run_quietly(&mut command, DOWNLOAD_LIMIT)
            .map_err(|failure| format!("rustup cannot download Rust {}: {failure}", avr::TESTED))?;
    }
    report(apt.mode, &shell::text(&command), began);
    Ok(())
}

fn rust_from_debian(apt: &mut Apt) -> Outcome {
    if !has_program("apt-get") {
        return Err("no apt-get here".into());
    }
    if apt.mode == Mode::Install && as_root().is_none() {
        return Err("installing packages needs root".into());
    }
    apt.update()?;
    match debian_rust() {
        Some(packages) => apt.install(&packages),
        None => Err(format!(
            "this system's packages have no Rust {}.{} with library source",
            avr::OLDEST.0,
            avr::OLDEST.1
        )
        .into()),
    }
}

/// The packages of a compiler that is new enough, if this system has one.
fn debian_rust() -> Option<[&'static str; 3]> {
    DEBIAN_RUST.into_iter().find(|packages| {
        packages
            .map(candidate)
            .iter()
            .all(|version| version.is_some_and(|version| version >= avr::OLDEST))
    })
}

fn candidate(package: &str) -> Option<Version> {
    let policy = read(
        Command::new("apt-cache")
            .args(["policy", package])
            .env("LC_ALL", "C"),
    )
    .ok()?;
    let line = policy
        .lines()
        .find_map(|line| line.trim().strip_prefix("Candidate: "))?;
    Version::parse(line)
}

/// Debian's installer, as root.
struct Apt {
    mode: Mode,
    updated: bool,
}

impl Apt {
    fn new(mode: Mode) -> Self {
        Self {
            mode,
            updated: false,
        }
    }

    /// Refreshes the package lists, once: an old list names versions that are
    /// gone.
    fn update(&mut self) -> Outcome {
        if self.updated {
            return Ok(());
        }
        self.apt(&["update"])?;
        self.updated = true;
        Ok(())
    }

    fn install(&mut self, packages: &[&str]) -> Outcome {
        self.update()?;
        let mut words = vec!["install", "-y", "--no-install-recommends"];
        words.extend(packages);
        self.apt(&words)
    }

    fn apt(&self, words: &[&str]) -> Outcome {
        let began = Instant::now();
        let line = format!("apt-get {}", words.join(" "));
        if self.mode == Mode::Install {
            let mut command = as_root().ok_or("installing packages needs root")?;
            // Another installer may be at work for a while.
            command
                .args(["apt-get", "-q", "-o", "DPkg::Lock::Timeout=120"])
                .args(words);
            run_quietly(&mut command, INSTALL_LIMIT)?;
        }
        report(self.mode, &line, began);
        Ok(())
    }
}

/// A command that runs its arguments as root, if that is possible here.
fn as_root() -> Option<Command> {
    let user = read(Command::new("id").arg("-u")).ok()?;
    let mut command = if user == "0" {
        Command::new("env")
    } else if has_program("sudo") {
        let asks = read(Command::new("sudo").args(["-n", "true"])).is_err();
        if asks
            && !(std::io::stdin().is_terminal()
                // Ask now: the installer's own output is kept back.
                && shell::run(Command::new("sudo").arg("-v")).is_ok())
        {
            return None;
        }
        let mut sudo = Command::new("sudo");
        sudo.arg("env");
        sudo
    } else {
        return None;
    };
    command.arg("DEBIAN_FRONTEND=noninteractive");
    Some(command)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_choose_what_for_and_whether() {
        assert_eq!(parse(&[]), Ok((Purpose::Tests, Mode::Install)));
        assert_eq!(
            parse(&["--for", "demo", "--dry-run"]),
            Ok((Purpose::Demo, Mode::DryRun))
        );
        for words in [&["--for"][..], &["--for", "fun"], &["--dry"]] {
            assert!(parse(words).is_err(), "{words:?}");
        }
    }
}
