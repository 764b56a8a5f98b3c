//! The documents hold together: every relative link and anchor in every Markdown file of the
//! repository leads somewhere, and the book in `docs/` has every page.
//!
//! Links to the web are not followed: a test that needs the network fails for reasons of its own.

use std::{
    collections::{BTreeSet, HashMap},
    ffi::OsStr,
    fs,
    path::{Component, Path, PathBuf},
};

use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd};

/// Folders that hold no documents of ours.
const SKIPPED: &[&str] = &["target", "demo", "node_modules"];

fn root() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.parent().expect("tests/ is in the repository").into()
}

/// What a Markdown file says about itself and about others.
struct Document {
    /// Anchors of its headings.
    anchors: BTreeSet<String>,
    /// Where its links and pictures lead, as written.
    links: Vec<String>,
}

impl Document {
    fn read(path: &Path) -> Self {
        let text =
            fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        Self::parse(&text)
    }

    fn parse(text: &str) -> Self {
        let mut anchors = BTreeSet::new();
        let mut links = Vec::new();
        let mut heading: Option<String> = None;
        for event in Parser::new_ext(text, Options::ENABLE_TABLES) {
            match event {
                Event::Start(Tag::Heading { .. }) => heading = Some(String::new()),
                Event::End(TagEnd::Heading(_)) => {
                    let anchor = anchor(&heading.take().unwrap_or_default());
                    // As on GitHub: of headings that are the same the second has -1 at its end.
                    let mut unique = anchor.clone();
                    let mut repeats = 0;
                    while anchors.contains(&unique) {
                        repeats += 1;
                        unique = format!("{anchor}-{repeats}");
                    }
                    anchors.insert(unique);
                }
                Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                    links.push(dest_url.into_string());
                }
                Event::Text(words) | Event::Code(words) => {
                    if let Some(heading) = &mut heading {
                        heading.push_str(&words);
                    }
                }
                Event::Html(tags) | Event::InlineHtml(tags) => {
                    for attribute in ["src=\"", "srcset=\"", "href=\""] {
                        let values = tags.split(attribute).skip(1);
                        links.extend(
                            values.filter_map(|rest| Some(rest.split_once('"')?.0.to_owned())),
                        );
                    }
                }
                _ => {}
            }
        }
        Self { anchors, links }
    }
}

/// The anchor of a heading, as GitHub and mdBook make it.
fn anchor(heading: &str) -> String {
    heading
        .trim()
        .chars()
        .filter_map(|letter| match letter {
            letter if letter.is_alphanumeric() || matches!(letter, '-' | '_') => {
                Some(letter.to_lowercase().to_string())
            }
            letter if letter.is_whitespace() => Some("-".to_owned()),
            _ => None,
        })
        .collect()
}

/// All Markdown files below a folder, relative to the repository.
fn markdown(folder: &Path, root: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("the repository can be read") {
        let path = entry.expect("the repository can be read").path();
        let name = path.file_name().and_then(OsStr::to_str).unwrap_or_default();
        if path.is_dir() {
            if !name.starts_with('.') && !SKIPPED.contains(&name) {
                markdown(&path, root, found);
            }
        } else if path.extension() == Some(OsStr::new("md")) {
            found.push(
                path.strip_prefix(root)
                    .expect("below the repository")
                    .into(),
            );
        }
    }
}

/// The file that a link in `page` leads to, relative to the repository, and its anchor. Nothing
/// for links to the web; an error where it leaves the repository.
fn target(page: &Path, link: &str) -> Option<Result<(PathBuf, Option<String>), String>> {
    if link.contains("://") || link.starts_with("mailto:") {
        return None;
    }
    let (file, anchor) = match link.split_once('#') {
        Some((file, anchor)) => (file, Some(anchor.to_owned())),
        None => (link, None),
    };
    if file.is_empty() {
        return Some(Ok((page.into(), anchor)));
    }
    let folder = page.parent().unwrap_or(Path::new(""));
    let mut path = PathBuf::new();
    for part in folder.join(file.replace("%20", " ")).components() {
        let inside = match part {
            Component::Normal(name) => {
                path.push(name);
                true
            }
            Component::ParentDir => path.pop(),
            Component::CurDir => true,
            Component::RootDir | Component::Prefix(_) => false,
        };
        if !inside {
            return Some(Err(format!("{link} leaves the repository")));
        }
    }
    Some(Ok((path, anchor)))
}

/// What is wrong with a link in `page`.
fn fault(
    root: &Path,
    documents: &HashMap<&Path, Document>,
    page: &Path,
    link: &str,
) -> Option<String> {
    let (path, anchor) = match target(page, link)? {
        Ok(found) => found,
        Err(fault) => return Some(fault),
    };
    if !root.join(&path).is_file() {
        return Some(format!("{link}: there is no file {}", path.display()));
    }
    if page.starts_with("docs") && !path.starts_with("docs") {
        return Some(format!(
            "{link} leads out of docs/, which is the book: name the file instead"
        ));
    }
    let known = &documents.get(path.as_path())?.anchors;
    let anchor = anchor.filter(|anchor| !known.contains(anchor))?;
    Some(format!(
        "{link}: {} has no heading #{anchor}",
        path.display()
    ))
}

/// What is wrong with the links of all documents.
fn faults(root: &Path) -> Vec<String> {
    let mut pages = Vec::new();
    markdown(root, root, &mut pages);
    let documents: HashMap<&Path, Document> = pages
        .iter()
        .map(|page| (page.as_path(), Document::read(&root.join(page))))
        .collect();
    let mut faults: Vec<String> = documents
        .iter()
        .flat_map(|(page, document)| {
            let links = document.links.iter();
            links
                .filter_map(|link| fault(root, &documents, page, link))
                .map(|fault| format!("{}: {fault}", page.display()))
        })
        .collect();
    faults.sort();
    faults
}

#[test]
fn every_link_leads_somewhere() {
    let faults = faults(&root());
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn a_broken_link_is_found() {
    let folder = std::env::temp_dir().join(format!("softrig-documents-{}", std::process::id()));
    fs::create_dir_all(folder.join("docs")).expect("a folder for the test");
    fs::write(
        folder.join("docs/a.md"),
        "# One `two`, three!\n\n# One two three\n\n[good](#one-two-three) [good](b.md#über-uns) \
         [good](#one-two-three-1) [web](https://example.org/none.md)\n[bad](#one) [bad](none.md) \
         [bad](b.md#none) [bad](../c.md) [bad](../../d.md)\n\n<img src=\"none.svg\">\n",
    )
    .and_then(|()| fs::write(folder.join("docs/b.md"), "# Über uns\n"))
    .and_then(|()| fs::write(folder.join("c.md"), "[good](docs/b.md)\n"))
    .expect("documents for the test");
    let found = faults(&folder);
    fs::remove_dir_all(&folder).expect("the test cleans up");
    let bad: Vec<&str> = found
        .iter()
        .filter_map(|fault| fault.strip_prefix("docs/a.md: ")?.split([':', ' ']).next())
        .collect();
    assert_eq!(
        bad,
        [
            "#one",
            "../../d.md",
            "../c.md",
            "b.md#none",
            "none.md",
            "none.svg"
        ],
        "{found:?}"
    );
}

#[test]
fn the_book_has_every_page() {
    let root = root();
    let summary = Path::new("docs/SUMMARY.md");
    let listed: BTreeSet<PathBuf> = Document::read(&root.join(summary))
        .links
        .iter()
        .filter_map(|link| Some(target(summary, link)?.expect("the book is in docs/").0))
        .collect();
    let mut pages = Vec::new();
    markdown(&root.join("docs"), &root, &mut pages);
    let forgotten: Vec<&PathBuf> = pages
        .iter()
        .filter(|page| *page != summary && !listed.contains(*page))
        .collect();
    assert!(
        forgotten.is_empty(),
        "not in docs/SUMMARY.md: {forgotten:?}"
    );
}

/// Figures that pages quote from others, which benchmarks write.
#[test]
fn quoted_figures_are_those_of_the_measured_pages() {
    let read = |name: &str| fs::read_to_string(root().join(name)).expect("a page");
    let cells = |line: &str| -> Vec<String> {
        let cells = line.trim_matches('|').split('|');
        cells.map(|cell| cell.trim().to_owned()).collect()
    };
    let real = read("docs/real.md");
    let mut table = real.lines().filter(|line| line.starts_with('|')).map(cells);
    let head = table.next().expect("the table of the rigs");
    let place = head
        .iter()
        .position(|cell| cell.starts_with("diagnosis, s"))
        .expect("the time of a diagnosis");
    let seconds: Vec<f64> = table
        .skip(1)
        .filter(|row| row.len() == head.len())
        .map(|row| {
            row[place]
                .split(' ')
                .next()
                .unwrap_or_default()
                .parse()
                .expect("seconds")
        })
        .collect();
    let slowest = seconds.iter().copied().fold(0.0, f64::max).ceil();
    let row = |page: &str, start: &str, cell: usize| -> f64 {
        let text = read(page);
        // The last of several sets on a page.
        let line = text.lines().rfind(|line| line.starts_with(start));
        let line = line.unwrap_or_else(|| panic!("{page} has no row {start}"));
        cells(line)[cell].parse().expect("a number")
    };
    let session = row("docs/blind.md", "| wall time a case, median (s)", 1);
    let longest = row("docs/blind.md", "| wall time a case, worst (s)", 1);
    let thousand = row("docs/benchmarks.md", "| 1 000 |", 1);
    let figures = [
        (format!("at most {slowest} s for each of"), "README.md"),
        (
            format!("at most {slowest} s for each of"),
            "docs/book/your-recordings.md",
        ),
        (format!("a median of {session:.0} s"), "README.md"),
        (
            format!("a median of {session:.0} s"),
            "docs/book/your-recordings.md",
        ),
        (
            format!("at most {longest:.0} s for bench"),
            "docs/book/your-recordings.md",
        ),
        (
            format!("{thousand} s for [a thousand recordings]"),
            "README.md",
        ),
        (
            format!("{thousand} s for a thousand short recordings"),
            "docs/book/your-recordings.md",
        ),
    ];
    let count = [
        "no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine",
    ];
    let rigs = format!("[{} real rigs]", count[seconds.len()]);
    let rigs = ["README.md", "docs/book/your-recordings.md"].map(|page| (rigs.clone(), page));
    for (figure, page) in figures.into_iter().chain(rigs) {
        let text = read(page).split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(text.contains(&figure), "{page} does not say: {figure}");
    }
    // The image, from the file that `cargo xtask size --accept` writes beside the table.
    let golden = read("firmware/size.txt");
    // The cycles are in a table of their own, which xtask holds to the file.
    let is_figure = |line: &&str| !line.starts_with('#') && !line.contains("cycles_");
    for line in golden.lines().filter(is_figure) {
        let (name, value) = line.split_once(' ').expect("a figure");
        let digits = value.strip_suffix(".0").unwrap_or(value);
        let shown = match digits.len() {
            4 if !digits.contains('.') => format!("{} {}", &digits[..1], &digits[1..]),
            6 if !digits.contains('.') => format!("{} {}", &digits[..3], &digits[3..]),
            _ => digits.to_owned(),
        };
        let unit = if name.ends_with("percent") {
            " %"
        } else {
            " bytes"
        };
        let cell = format!("| {shown}{unit} |");
        assert!(read("docs/benchmarks.md").contains(&cell), "{name}: {cell}");
    }
}

/// The version of the workspace is the newest of the changelog, every crate has it, and the page
/// on what is stable names the versions of files, JSON and wire that the code has.
#[test]
fn a_version_is_the_same_everywhere() {
    let read = |name: &str| fs::read_to_string(root().join(name)).expect(name);
    let workspace: toml::Table = read("Cargo.toml").parse().expect("TOML");
    let package = &workspace["workspace"]["package"];
    let version = package["version"].as_str().expect("a version");
    let changelog = read("CHANGELOG.md");
    let mut versions = changelog
        .lines()
        .filter_map(|line| line.strip_prefix("## "))
        .map(|heading| heading.split(' ').next().unwrap_or_default());
    assert_eq!(versions.next(), Some("Unreleased"));
    assert_eq!(versions.next(), Some(version));
    let members = workspace["workspace"]["members"]
        .as_array()
        .expect("members");
    for member in members {
        let path = format!("{}/Cargo.toml", member.as_str().expect("a folder"));
        let member: toml::Table = read(&path).parse().expect("TOML");
        let inherits = member["package"]["version"].get("workspace");
        assert_eq!(
            inherits.and_then(toml::Value::as_bool),
            Some(true),
            "{path}"
        );
    }
    let stable = read("docs/stability.md");
    let json = softrig::diagnose::decide::verdict::SCHEMA;
    for row in [
        format!(
            "| the [serial protocol](serial.md) | {} |",
            wire::reply::VERSION
        ),
        format!("`results.parquet` | `\"schema\": {json}` |"),
        format!("Version {version} is"),
    ] {
        assert!(stable.contains(&row), "{row}");
    }
}

/// Whoever forks the repository runs what everybody runs.
#[test]
fn continuous_integration_is_the_command_that_everybody_runs() {
    let read = |name: &str| fs::read_to_string(root().join(name)).expect(name);
    let workflow = read(".github/workflows/ci.yml");
    assert!(workflow.lines().any(|line| line.trim() == "- run: .ci/run"));
    assert!(read(".ci/run").contains("exec cargo xtask test"));
}

/// The texts of a picture.
fn words_of(picture: &Path) -> Vec<String> {
    let text = fs::read_to_string(picture).expect("a picture");
    let document = roxmltree::Document::parse(&text).expect("SVG");
    let nodes = document.descendants().filter(roxmltree::Node::is_text);
    nodes
        .filter_map(|node| node.text())
        .map(|words| words.trim().to_owned())
        .collect()
}

/// A quantity and its unit are written `angle (°)`, as in the names of columns and on the terminal.
#[test]
fn pictures_write_units_in_brackets() {
    let folder = root().join("docs/images");
    let mut count = 0;
    for entry in fs::read_dir(&folder).expect("pictures") {
        let path = entry.expect("pictures").path();
        if path.extension() != Some(OsStr::new("svg")) {
            continue;
        }
        for words in words_of(&path) {
            count += usize::from(words.ends_with(')'));
            let unit = words.rsplit_once(", ").map(|(_, unit)| unit);
            let bare =
                unit.is_some_and(|it| ["s", "°", "kPa", "MB", "N", "rad", "ms"].contains(&it));
            assert!(!bare, "{}: {words}", path.display());
        }
    }
    assert!(count > 30, "only {count} labels have a unit");
}

/// README, the terminal above it and the picture below it are of one run.
#[test]
fn the_demo_is_one_run() {
    let readme = fs::read_to_string(root().join("README.md")).expect("README.md");
    let mut sentences = readme
        .lines()
        .filter(|line| line.starts_with("The gap shrank from"));
    let sentence = sentences.next().expect("what the demo ends with");
    for picture in ["demo.svg", "loop.svg"] {
        let words = words_of(&root().join("docs/images").join(picture));
        assert!(
            words.iter().any(|it| it == sentence),
            "{picture}: {sentence}"
        );
    }
}
