//! The licences of everything that is linked into the archive's programs.
//!
//! Most licences require their text beside a binary. The texts are taken from the packages as
//! they were built; equal ones are printed once.

use std::{
    collections::{BTreeMap, BTreeSet},
    env, fs,
    path::{Path, PathBuf},
};

use super::{cannot, copy, is_of_musl, make, sysroot, write as write_text};
use crate::{
    shell::{Outcome, cargo, read, root},
    web,
};

/// Libraries in the board's image, and where Debian keeps their licences.
const OF_THE_IMAGE: [(&str, &str); 2] = [
    ("avr-libc", "/usr/share/doc/avr-libc/copyright"),
    ("libgcc", "/usr/share/doc/gcc-avr/copyright"),
];

/// The licence of glibc, where Debian keeps it. It asks that a program can be linked with another
/// version of it: the sources of this one are public, and build with one command.
const OF_GLIBC: &str = "/usr/share/doc/libc6/copyright";

/// The C library of a static program, which no package of Rust's names.
const MUSL: &str = "\
musl, the C library that rig is linked with (https://musl.libc.org)

Copyright © 2005-2020 Rich Felker, et al.

Permission is hereby granted, free of charge, to any person obtaining
a copy of this software and associated documentation files (the
\"Software\"), to deal in the Software without restriction, including
without limitation the rights to use, copy, modify, merge, publish,
distribute, sublicense, and/or sell copies of the Software, and to
permit persons to whom the Software is furnished to do so, subject to
the following conditions:

The above copyright notice and this permission notice shall be
included in all copies or substantial portions of the Software.

THE SOFTWARE IS PROVIDED \"AS IS\", WITHOUT WARRANTY OF ANY KIND,
EXPRESS OR IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF
MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT.
IN NO EVENT SHALL THE AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY
CLAIM, DAMAGES OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT,
TORT OR OTHERWISE, ARISING FROM, OUT OF OR IN CONNECTION WITH THE
SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.
";

/// The package of the program.
const PROGRAM: &str = "softrig-cli";

/// A package that is linked.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Package {
    name: String,
    version: String,
    licence: String,
    source: String,
    folder: PathBuf,
}

/// The licences of the page for a browser.
pub fn of_page() -> Outcome<String> {
    of("The page softrig.html", web::PACKAGE, web::TARGET)
}

/// The licences of what is linked into a package of ours.
fn of(what: &str, package: &str, target: &str) -> Outcome<String> {
    let packages = packages(package, target)?;
    let deny = root().join("deny.toml");
    let deny = fs::read_to_string(&deny).map_err(|error| cannot("read", &deny, &error))?;
    let is_barred = |it: &&Package| !is_allowed(&it.licence, &allowed(&deny, &it.name));
    if let Some(package) = packages.iter().find(is_barred) {
        return Err(format!(
            "{} is under {:?}, which deny.toml does not allow it",
            package.name, package.licence
        )
        .into());
    }
    let mut texts: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let mut table = String::new();
    for package in &packages {
        let Package {
            name,
            version,
            licence,
            source,
            ..
        } = package;
        table += &format!("{name} {version}, {licence}, {source}\n");
        for text in texts_of(&package.folder)? {
            texts
                .entry(text)
                .or_default()
                .insert(format!("{name} {version}"));
        }
    }
    let mut page = format!(
        "{what} contains these packages. Their sources are at https://crates.io under \
         their names and versions.\n\n{table}"
    );
    for (text, of) in texts {
        let of: Vec<String> = of.into_iter().collect();
        page += &format!(
            "\n{}\n{}\n\n{}\n",
            "-".repeat(72),
            of.join(", "),
            text.trim_end()
        );
    }
    println!("  licences of {} packages", packages.len());
    Ok(page)
}

/// Writes the licences into a folder.
pub fn write(folder: &Path, target: &str, firmware: bool) -> Outcome {
    make(folder)?;
    let page = of("The program softrig", PROGRAM, target)?;
    write_text(&folder.join("softrig.txt"), &page)?;
    if is_of_musl(target) {
        write_text(&folder.join("musl.txt"), MUSL)?;
    } else {
        copy(Path::new(OF_GLIBC), &folder.join("glibc.txt"))?;
    }
    // Rust's own library and what is in it.
    let library = sysroot()?.join("share/doc/rust/COPYRIGHT-library.html");
    if library.is_file() {
        copy(&library, &folder.join("rust-standard-library.html"))?;
    } else {
        println!(
            "  without {}, which this toolchain does not have",
            library.display()
        );
    }
    if firmware {
        for (name, path) in OF_THE_IMAGE {
            if Path::new(path).is_file() {
                copy(
                    Path::new(path),
                    &folder.join(format!("firmware-{name}.txt")),
                )?;
            } else {
                return Err(format!(
                    "{path} is missing: the licence of {name}, which the image contains, has to go along; or leave the image out with --no-firmware"
                )
                .into());
            }
        }
    }
    Ok(())
}

/// The licences that the text of deny.toml allows a package: those of all packages, and its own exception.
fn allowed<'a>(deny: &'a str, package: &str) -> Vec<&'a str> {
    let heads = [
        "\nallow = [".to_owned(),
        format!("crate = \"{package}\", allow = ["),
    ];
    let lists = heads.iter().filter_map(|head| {
        let (_, rest) = deny.split_once(head)?;
        rest.split(']').next()
    });
    lists
        .flat_map(|list| list.split('"').skip(1).step_by(2))
        .collect()
}

/// Whether at least one way through an expression like `(MIT OR Apache-2.0) AND Zlib` is
/// allowed: each part joined by AND has an allowed choice.
fn is_allowed(expression: &str, allowed: &[&str]) -> bool {
    let plain = expression.replace(['(', ')'], " ").replace('/', " OR ");
    plain.split(" AND ").all(|part| {
        part.split(" OR ")
            .any(|choice| allowed.contains(&choice.trim()))
    })
}

/// The packages of others that are linked into one of ours.
fn packages(of: &str, target: &str) -> Outcome<Vec<Package>> {
    let mut tree = cargo();
    tree.args([
        "tree",
        "--locked",
        "-p",
        of,
        "-e",
        "normal",
        "--target",
        target,
        "--prefix",
        "none",
        "-f",
        "{p}\t{l}\t{r}",
    ]);
    if of == PROGRAM {
        // As the archive's is built.
        tree.args(["--features", "lab"]);
    }
    let tree = read(&mut tree)?;
    let sources = sources()?;
    let packages: BTreeSet<Package> = tree
        .lines()
        .filter_map(|line| package(line, &sources).transpose())
        .collect::<Outcome<_>>()?;
    Ok(packages.into_iter().collect())
}

/// The folders in which cargo keeps the sources of packages, one a registry.
fn sources() -> Outcome<Vec<PathBuf>> {
    let home = env::var_os("CARGO_HOME").map(PathBuf::from);
    let home = home.or_else(|| Some(PathBuf::from(env::var_os("HOME")?).join(".cargo")));
    let folder = home
        .ok_or("neither CARGO_HOME nor HOME is set")?
        .join("registry/src");
    let entries = fs::read_dir(&folder).map_err(|error| cannot("list", &folder, &error))?;
    Ok(entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .collect())
}

/// A package of `cargo tree`: "name v1.2.3 (proc-macro)", licence and repository. None of one of
/// ours, behind whose version stands a path.
fn package(line: &str, sources: &[PathBuf]) -> Outcome<Option<Package>> {
    let mut fields = line.trim_end().trim_end_matches(" (*)").split('\t');
    let mut field = || fields.next().map(str::trim).unwrap_or_default();
    let (package, licence, source) = (field(), field(), field());
    let mut words = package.split(' ');
    let (Some(name), Some(version)) = (words.next(), words.next()) else {
        return Err(format!("cargo tree printed {line:?}").into());
    };
    if words.any(|word| word.starts_with("(/")) {
        return Ok(None);
    }
    let version = version.trim_start_matches('v');
    let folder = format!("{name}-{version}");
    let mut folders = sources.iter().map(|registry| registry.join(&folder));
    let or = |text: &str, instead: &str| if text.is_empty() { instead } else { text }.to_owned();
    Ok(Some(Package {
        name: name.into(),
        version: version.into(),
        licence: or(licence, "licence in its files"),
        source: or(source, "no repository named"),
        folder: folders
            .rfind(|folder| folder.is_dir())
            .ok_or_else(|| format!("the source of {name} {version} is in no registry of cargo"))?,
    }))
}

/// The licence texts in a package's folder.
fn texts_of(folder: &Path) -> Outcome<Vec<String>> {
    const NAMES: [&str; 6] = [
        "LICENSE",
        "LICENCE",
        "COPYING",
        "COPYRIGHT",
        "NOTICE",
        "UNLICENSE",
    ];
    let entries = fs::read_dir(folder).map_err(|error| cannot("list", folder, &error))?;
    let mut paths: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| {
            let name = path
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .to_uppercase();
            path.is_file() && NAMES.iter().any(|start| name.starts_with(start))
        })
        .collect();
    paths.sort();
    let each = paths.iter().map(|path| {
        let bytes = fs::read(path).map_err(|error| cannot("read", path, &error))?;
        Ok(String::from_utf8_lossy(&bytes).replace("\r\n", "\n"))
    });
    each.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_licence_needs_one_way_through() {
        let deny = fs::read_to_string(root().join("deny.toml")).unwrap();
        let of_any = allowed(&deny, "any");
        for (expression, is_fine) in [
            ("MIT", true),
            ("MIT/Apache-2.0", true),
            ("(MIT OR Apache-2.0) AND Unicode-3.0", true),
            ("Apache-2.0 WITH LLVM-exception OR Apache-2.0 OR MIT", true),
            ("Apache-2.0 OR BSL-1.0", true),
            ("GPL-3.0-or-later", false),
            ("MIT AND GPL-3.0-only", false),
            ("licence in its files", false),
        ] {
            assert_eq!(is_allowed(expression, &of_any), is_fine, "{expression}");
        }
        // An exception is of one package.
        assert!(!is_allowed("MPL-2.0", &of_any));
        assert!(is_allowed("MPL-2.0", &allowed(&deny, "serialport")));
    }

    #[test]
    fn packages_of_ours_are_not_in_the_list() {
        let sources = [env::temp_dir().join(format!("softrig-licences-{}", std::process::id()))];
        fs::create_dir_all(sources[0].join("a-1.0.0")).unwrap();
        let package = |line: &str| package(line, &sources);
        let found = package("a v1.0.0 (proc-macro)\tMIT/Zlib\t (*)")
            .unwrap()
            .unwrap();
        let ours = package("b v0.1.0 (/x/b)\tMIT\t").unwrap();
        let lost = package("c v1.0.0\t\thttps://c");
        fs::remove_dir_all(&sources[0]).unwrap();
        assert_eq!(found.folder, sources[0].join("a-1.0.0"));
        assert_eq!(
            (found.version.as_str(), found.licence.as_str()),
            ("1.0.0", "MIT/Zlib")
        );
        assert_eq!(found.source, "no repository named");
        assert_eq!(ours, None);
        assert!(lost.is_err());
    }
}
