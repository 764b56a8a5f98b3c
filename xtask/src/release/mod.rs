//! A release: `softrig` that needs nothing installed, with the board's image, as one archive.
//!
//! The program is linked statically against musl, so that one file runs on every Linux of its
//! processor, old or new. As a test, the archive is unpacked and run in an otherwise empty folder.
//! The page for a browser is placed beside it, and the wheel of the Python package, for systems like
//! this one.
//!
//! The virtual rig is not in the archive, because it links simavr, which is GPL, and dynamic
//! libraries. It has to be built from source.

mod licences;
mod trial;

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
    time::{Duration, Instant},
};

use crate::{
    avr, python, setup,
    shell::{
        self, Outcome, Steps, cargo, has_program, read, read_within, root, run, seconds, target_dir,
    },
    web,
};

/// The default target of a release.
const DEFAULT_TARGET: &str = "x86_64-unknown-linux-musl";

/// Targets of a static build. Only the first was tried.
const TARGETS: [&str; 2] = [DEFAULT_TARGET, "aarch64-unknown-linux-musl"];

/// How long fetching a library of Rust may take: 30 MB.
const FETCH_LIMIT: Duration = Duration::from_secs(180);

/// Name of the board's image in the archive.
const IMAGE: &str = "softrig-mega2560";

/// Shells, and the file name under which each looks for completions.
const COMPLETIONS: [(&str, &str); 3] = [
    ("bash", "softrig"),
    ("zsh", "_softrig"),
    ("fish", "softrig.fish"),
];

/// Files of the repository that go along.
const TEXTS: [&str; 5] = [
    "README.md",
    "CHANGELOG.md",
    "Containerfile",
    "LICENSE-MIT",
    "LICENSE-APACHE",
];

/// Name of the list of checksums, in an archive and beside the archives.
const CHECKSUMS: &str = "SHA256SUMS";

/// The page that says which file is for what.
const INDEX: &str = "index.html";

/// Options of a release build.
#[allow(clippy::struct_excessive_bools)] // each is a flag of its own
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// Target triples.
    targets: Vec<String>,
    /// Files to put beside the archives, such as a wheel.
    with: Vec<PathBuf>,
    /// Whether the board's image goes along.
    firmware: bool,
    /// Whether the page for a browser is put beside the archives.
    web: bool,
    /// Whether the Python package is put beside the archives.
    wheel: bool,
    /// Whether to only say what would be done.
    dry_run: bool,
}

impl Options {
    /// Reads the words after `release`.
    ///
    /// # Errors
    ///
    /// Says what makes no sense.
    pub fn parse(words: &[&str]) -> Result<Self, String> {
        let mut options = Self {
            targets: Vec::new(),
            with: Vec::new(),
            firmware: true,
            web: true,
            wheel: true,
            dry_run: false,
        };
        let mut words = words.iter();
        while let Some(&word) = words.next() {
            let mut value = || {
                let next = words.next().filter(|next| !next.starts_with('-'));
                next.ok_or_else(|| format!("release: {word} needs a value"))
            };
            match word {
                "--dry-run" => options.dry_run = true,
                "--no-firmware" => options.firmware = false,
                "--no-web" => options.web = false,
                "--no-wheel" => options.wheel = false,
                "--with" => options.with.push(PathBuf::from(value()?)),
                "--target" => {
                    let target = *value()?;
                    if !TARGETS.contains(&target) {
                        return Err(format!(
                            "release: {target:?} is no target of a static build; there are {}",
                            TARGETS.join(", ")
                        ));
                    }
                    options.targets.push(target.into());
                }
                _ => return Err(format!("release: there is no option {word}")),
            }
        }
        if options.targets.is_empty() {
            options.targets.push(DEFAULT_TARGET.into());
        }
        Ok(options)
    }
}

/// Builds, packs and tries a release.
pub fn release(options: &Options) -> Outcome {
    for program in ["tar", "gzip", "sha256sum"] {
        if !has_program(program) {
            return Err(format!("packing needs {program}, which is not on the path").into());
        }
    }
    if options.dry_run {
        return plan(options);
    }
    let folder = target_dir().join("dist");
    let _ = fs::remove_dir_all(&folder);
    make(&folder)?;
    let mut steps = Steps::new(1 + 4 * options.targets.len() + 3);
    let mut image = None;
    if options.firmware {
        steps.step("the board's image", || {
            image = Some(board_image()?);
            Ok(())
        })?;
    } else {
        steps.skip("the board's image", "--no-firmware was given");
    }
    for asked in &options.targets {
        let (mut program, mut target) = (PathBuf::new(), String::new());
        steps.step("build softrig", || {
            target = available(asked)?;
            program = build(&target)?;
            Ok(())
        })?;
        let target = target.as_str();
        let stem = format!("softrig-{}-{target}", env!("CARGO_PKG_VERSION"));
        let staged = folder.join(&stem);
        steps.step("put the archive together", || {
            stage(&staged, &program, target, image.as_deref())
        })?;
        let archive = folder.join(format!("{stem}.tar.gz"));
        steps.step("pack", || pack(&folder, &stem, &archive))?;
        if runs_here(target) {
            steps.step("unpack and run it where there is nothing else", || {
                trial::of(&archive, &stem, options.firmware)
            })?;
        } else {
            steps.skip("run it", "it is built for another processor");
        }
        fs::remove_dir_all(&staged).map_err(|error| cannot("remove", &staged, &error))?;
    }
    let mut with = options.with.clone();
    if options.web {
        steps.step("the page for a browser", || {
            with.push(web::web()?);
            write(
                &folder.join("softrig.html.licences.txt"),
                &licences::of_page()?,
            )
        })?;
    } else {
        steps.skip("the page for a browser", "--no-web was given");
    }
    if options.wheel {
        steps.step("the Python package", || {
            with.push(python::wheel()?);
            Ok(())
        })?;
    } else {
        steps.skip("the Python package", "--no-wheel was given");
    }
    steps.step("which file is for what, and checksums", || {
        for file in &with {
            copy(file, &folder.join(file.file_name().unwrap_or_default()))?;
        }
        if let Some(image) = &image {
            copy(&avr::hex(image), &folder.join(format!("{IMAGE}.hex")))?;
        }
        write(&folder.join(INDEX), &index(&files(&folder, &folder)?))?;
        checksums(&folder)?;
        print!("{}", text_of(&folder.join(CHECKSUMS))?);
        Ok(())
    })?;
    steps.finish("cargo xtask release");
    println!("what to take for what: {}", folder.join(INDEX).display());
    Ok(())
}

/// The page that says which file of a release is for what.
fn index(files: &[PathBuf]) -> String {
    let mut files = files.to_vec();
    files.sort();
    let rows = files.iter().filter_map(|file| {
        let name = file.to_str()?;
        let wish = match file.extension()?.to_str()? {
            "html" => "Flash a board, record and diagnose, with a browser and nothing else: open it with a double click (a board takes Chromium, Chrome or Edge)",
            "gz" if name.contains("aarch64") => "Use the command on Linux, 64-bit ARM: unpack it and run <code>softrig</code>",
            "gz" => "Use the command on Linux, 64-bit Intel or AMD: unpack it and run <code>softrig</code>; the image is in it",
            "whl" => "Use it from Python: <code>pip install</code> this file",
            "hex" => "Flash the board with a tool of your own; page and archive have it already",
            _ => return None,
        };
        Some(format!(
            "<tr><td>{wish}</td><td><a href=\"{name}\"><code>{name}</code></a></td></tr>"
        ))
    });
    include_str!("index.html")
        .replace("{{version}}", env!("CARGO_PKG_VERSION"))
        .replace("{{rows}}", &rows.collect::<Vec<_>>().join("\n"))
        .replace("{{checksums}}", CHECKSUMS)
}

/// Says what would be done.
fn plan(options: &Options) -> Outcome {
    for target in &options.targets {
        if !has_library(target)? {
            println!("release: would run rustup target add {target}");
            if runs_here(target) {
                let own = of_this_computer();
                println!("release: would build for {own}, static too, if that fails");
            }
        }
        let compiler = c_compiler(target);
        if !has_program(&compiler) {
            println!("release: would look for {compiler} in Debian's package musl-tools");
        }
        println!("release: would run {}", shell::text(&build_command(target)));
        println!(
            "release: would pack target/dist/softrig-{}-{target}.tar.gz: softrig, {}, completions for {}, manual pages{}, licences, {CHECKSUMS}",
            env!("CARGO_PKG_VERSION"),
            TEXTS.join(", "),
            COMPLETIONS.map(|(shell, _)| shell).join(", "),
            if options.firmware {
                format!(", {IMAGE}.elf and .hex")
            } else {
                String::new()
            }
        );
        println!(
            "release: {}",
            if runs_here(target) {
                format!("would try it {}", trial::Place::here().words())
            } else {
                "would not try it: it is for another processor".into()
            }
        );
    }
    if options.web {
        println!("release: would build the page for a browser, as cargo xtask web does");
    }
    if options.wheel {
        println!("release: would build the wheel of the Python package, as cargo xtask wheel does");
    }
    for file in &options.with {
        println!("release: would put {} beside it", file.display());
    }
    println!("release: dry run, nothing was changed");
    Ok(())
}

/// Whether a program for a target runs on this machine.
fn runs_here(target: &str) -> bool {
    env::consts::OS == "linux" && target.starts_with(&format!("{}-", env::consts::ARCH))
}

fn sysroot() -> Outcome<PathBuf> {
    read(
        Command::new("rustc")
            .args(["--print", "sysroot"])
            .current_dir(root()),
    )
    .map(PathBuf::from)
}

/// Whether the standard library for a target is installed.
fn has_library(target: &str) -> Outcome<bool> {
    Ok(sysroot()?
        .join("lib/rustlib")
        .join(target)
        .join("lib")
        .is_dir())
}

/// The C compiler that finds the headers of musl: glibc's would leave calls in its programs
/// that musl does not have.
fn c_compiler(target: &str) -> String {
    let processor = target.split('-').next().unwrap_or(target);
    format!("{processor}-linux-musl-gcc")
}

/// The target of this computer's own C library.
fn of_this_computer() -> String {
    format!("{}-unknown-linux-gnu", env::consts::ARCH)
}

/// Whether a target's C library is musl.
fn is_of_musl(target: &str) -> bool {
    target.ends_with("musl")
}

/// The target itself, if Rust's library for it is here or can be fetched. Otherwise that of this
/// computer, where its programs run too.
///
/// The C library of this computer is linked statically too.
fn available(target: &str) -> Outcome<String> {
    if has_library(target)? {
        return Ok(target.into());
    }
    let mut fetch = Command::new("rustup");
    match read_within(fetch.args(["target", "add", target]), FETCH_LIMIT) {
        Ok(_) => Ok(target.into()),
        Err(failure) if runs_here(target) => {
            let own = of_this_computer();
            println!(
                "  Rust's library for {target} cannot be fetched ({failure}): built for {own}, with the C library of this computer, static too"
            );
            Ok(own)
        }
        Err(failure) => Err(format!(
            "{failure}\n  Rust's library for {target} is missing: `rustup target add {target}`, with access to Rust's servers"
        )
        .into()),
    }
}

/// `cargo build` of a static program for a target.
///
/// Rust's own linker does that, with the musl of Rust's standard library; the only C libraries, zstd
/// and SQLite, are compiled against the headers of musl.
fn build_command(target: &str) -> Command {
    let name = target.replace('-', "_");
    // Where the sources are is nobody's business, and differs from build to build.
    let mut flags = format!("--remap-path-prefix={}=softrig", root().display());
    let mut command = cargo();
    command
        .args(["build", "--release", "--locked", "-p", "softrig-cli"])
        .args(["--features", "lab", "--target", target]);
    if is_of_musl(target) {
        let linker = format!("CARGO_TARGET_{}_LINKER", name.to_uppercase());
        command
            .env(linker, "rust-lld")
            .env(format!("CC_{name}"), c_compiler(target));
    } else {
        flags += " -Ctarget-feature=+crt-static";
    }
    command.env("RUSTFLAGS", flags);
    command
}

/// Builds `softrig` for a target and checks that it is static.
fn build(target: &str) -> Outcome<PathBuf> {
    if is_of_musl(target) {
        setup::musl_gcc(&c_compiler(target))?;
    }
    run(&mut build_command(target))?;
    let program = target_dir().join(target).join("release/softrig");
    let bytes = fs::read(&program).map_err(|error| cannot("read", &program, &error))?;
    match asks_for_loader(&bytes) {
        Some(false) => {}
        Some(true) => {
            return Err(format!(
                "{} asks for a dynamic loader: a dependency links a shared library",
                program.display()
            )
            .into());
        }
        None => return Err(format!("{} is no 64-bit ELF", program.display()).into()),
    }
    println!(
        "  {}: static, {:.1} MB",
        program.display(),
        bytes.len() as f64 / 1e6
    );
    Ok(program)
}

/// Whether an ELF program names a dynamic loader (a header `PT_INTERP`), without which it
/// can load nothing. None if it is not a little-endian 64-bit ELF.
fn asks_for_loader(bytes: &[u8]) -> Option<bool> {
    /// Class 64, little-endian, version 1.
    const KIND: &[u8] = b"\x7fELF\x02\x01\x01";
    const PT_INTERP: u64 = 3;
    let number = |at: usize, size: usize| -> Option<u64> {
        let field = bytes.get(at..at.checked_add(size)?)?;
        Some(
            field
                .iter()
                .rev()
                .fold(0, |sum, byte| sum << 8 | u64::from(*byte)),
        )
    };
    let place = |at, size| number(at, size).and_then(|value| usize::try_from(value).ok());
    if !bytes.starts_with(KIND) {
        return None;
    }
    let (table, size, count) = (place(0x20, 8)?, place(0x36, 2)?, place(0x38, 2)?);
    (0..count)
        .map(|index| number(table.checked_add(index * size)?, 4))
        .try_fold(false, |found, kind| Some(found || kind? == PT_INTERP))
}

/// The board's image, checked, as ELF and in Intel's format.
fn board_image() -> Outcome<PathBuf> {
    let image = avr::build()?;
    avr::gates(&image)?;
    avr::print_size(&image)?;
    Ok(image)
}

/// Puts together what goes into an archive.
fn stage(folder: &Path, program: &Path, target: &str, image: Option<&Path>) -> Outcome {
    make(folder)?;
    copy(program, &folder.join("softrig"))?;
    for text in TEXTS {
        copy(&root().join(text), &folder.join(text))?;
    }
    // Everything that the README links to.
    let docs = root().join("docs");
    for page in files(&docs, &docs)? {
        if page.extension().is_some_and(|kind| kind != "py") {
            let copied = folder.join("docs").join(&page);
            make(copied.parent().unwrap_or(folder))?;
            copy(&docs.join(&page), &copied)?;
        }
    }
    let completions = folder.join("completions");
    // A program for another processor cannot say them.
    let speaker = if runs_here(target) {
        program.to_owned()
    } else {
        run(cargo().args([
            "build",
            "-q",
            "--release",
            "--locked",
            "-p",
            "softrig-cli",
            "--features",
            "lab",
        ]))?;
        target_dir().join("release/softrig")
    };
    for (shell, file) in COMPLETIONS {
        let script = read(Command::new(&speaker).args(["completions", shell]))?;
        write(&completions.join(shell).join(file), &(script + "\n"))?;
    }
    run(Command::new(&speaker)
        .arg("man")
        .arg("-o")
        .arg(folder.join("man/man1")))?;
    if let Some(image) = image {
        let firmware = folder.join("firmware");
        make(&firmware)?;
        copy(image, &firmware.join(format!("{IMAGE}.elf")))?;
        copy(&avr::hex(image), &firmware.join(format!("{IMAGE}.hex")))?;
    }
    licences::write(&folder.join("licences"), target, image.is_some())?;
    checksums(folder)
}

/// Packs a folder so that the same sources give the same bytes.
fn pack(folder: &Path, stem: &str, archive: &Path) -> Outcome {
    let began = Instant::now();
    let date = read(
        Command::new("git")
            .args(["log", "-1", "--format=%ct"])
            .current_dir(root()),
    )
    .unwrap_or_else(|_| "0".into());
    let tar = archive.with_extension("");
    run(Command::new("tar")
        .args(["--sort=name", "--owner=0", "--group=0", "--numeric-owner"])
        .arg("--mode=u+rw,go+r,go-w")
        .arg(format!("--mtime=@{date}"))
        .arg("-cf")
        .arg(&tar)
        .arg("-C")
        .arg(folder)
        .arg(stem))?;
    run(Command::new("gzip").args(["-9", "-n", "-f"]).arg(&tar))?;
    let bytes = fs::metadata(archive)
        .map_err(|error| cannot("read", archive, &error))?
        .len();
    println!(
        "  {}: {:.1} MB, {}",
        archive.display(),
        bytes as f64 / 1e6,
        seconds(began.elapsed())
    );
    Ok(())
}

/// Lists the checksums of all files in a folder, by their paths in it.
fn checksums(folder: &Path) -> Outcome {
    let mut files = files(folder, folder)?;
    files.retain(|file| file != Path::new(CHECKSUMS));
    files.sort();
    let list = read(Command::new("sha256sum").args(&files).current_dir(folder))?;
    write(&folder.join(CHECKSUMS), &(list + "\n"))
}

/// All files in a folder and those in it, relative to `from`.
fn files(folder: &Path, from: &Path) -> Outcome<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(|error| cannot("list", folder, &error))? {
        let path = entry
            .map_err(|error| cannot("list", folder, &error))?
            .path();
        if path.is_dir() {
            found.extend(files(&path, from)?);
        } else {
            found.push(path.strip_prefix(from).unwrap_or(&path).to_owned());
        }
    }
    Ok(found)
}

fn make(folder: &Path) -> Outcome {
    Ok(fs::create_dir_all(folder).map_err(|error| cannot("make", folder, &error))?)
}

fn copy(from: &Path, to: &Path) -> Outcome {
    fs::copy(from, to).map_err(|error| cannot("copy", from, &error))?;
    Ok(())
}

fn write(path: &Path, text: &str) -> Outcome {
    if let Some(folder) = path.parent() {
        make(folder)?;
    }
    Ok(fs::write(path, text).map_err(|error| cannot("write", path, &error))?)
}

fn text_of(path: &Path) -> Outcome<String> {
    Ok(fs::read_to_string(path).map_err(|error| cannot("read", path, &error))?)
}

fn cannot(what: &str, path: &Path, error: &std::io::Error) -> String {
    format!("cannot {what} {}: {error}", path.display())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_file_that_somebody_takes_has_a_row_and_the_others_have_none() {
        let names = [
            "softrig.html",
            "softrig-mega2560.hex",
            "softrig-0.1.0-x86_64-unknown-linux-musl.tar.gz",
            "softrig-0.1.0-cp310-abi3-linux_x86_64.whl",
        ];
        let others = ["SHA256SUMS", "softrig.html.licences.txt"];
        let all: Vec<PathBuf> = names.iter().chain(&others).map(PathBuf::from).collect();
        let page = index(&all);
        for name in names {
            assert_eq!(
                page.matches(&format!("href=\"{name}\"")).count(),
                1,
                "{name}"
            );
        }
        assert_eq!(page.matches("<tr><td>").count(), names.len());
        assert!(!page.contains("{{"));
    }

    #[test]
    fn options_are_read_or_refused() {
        let options = Options::parse(&[]).unwrap();
        assert_eq!(options.targets, [DEFAULT_TARGET]);
        assert!(options.firmware && options.wheel && !options.dry_run);
        let options = Options::parse(&[
            "--target",
            "aarch64-unknown-linux-musl",
            "--no-firmware",
            "--no-web",
            "--no-wheel",
            "--with",
            "a.whl",
            "--dry-run",
        ])
        .unwrap();
        assert_eq!(options.targets, ["aarch64-unknown-linux-musl"]);
        assert_eq!(options.with, [Path::new("a.whl")]);
        assert!(!options.firmware && !options.web && !options.wheel && options.dry_run);
        for wrong in [
            &["--target"][..],
            &["--target", "--dry-run"],
            &["--target", "x86_64-unknown-linux-gnu"],
            &["--fast"],
        ] {
            assert!(Options::parse(wrong).unwrap_err().starts_with("release: "));
        }
    }

    /// An ELF header with one program header of a kind.
    fn elf(kind: u8) -> Vec<u8> {
        let mut bytes = vec![0; 0x78];
        bytes[..7].copy_from_slice(b"\x7fELF\x02\x01\x01");
        (bytes[0x20], bytes[0x36], bytes[0x38]) = (0x40, 0x38, 1);
        bytes[0x40] = kind;
        bytes
    }

    #[test]
    fn a_program_that_asks_for_a_loader_is_told_from_a_static_one() {
        assert_eq!(asks_for_loader(&elf(1)), Some(false));
        assert_eq!(asks_for_loader(&elf(3)), Some(true));
        assert_eq!(asks_for_loader(&elf(3)[..0x40]), None);
        assert_eq!(asks_for_loader(b"#!/bin/sh\n"), None);
        // Tests are linked against the machine's own library.
        if cfg!(all(target_os = "linux", target_env = "gnu")) {
            let own = fs::read(env::current_exe().unwrap()).unwrap();
            assert_eq!(asks_for_loader(&own), Some(true));
        }
    }
}
