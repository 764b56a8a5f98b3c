//! Arguments, help and completions.

use predicates::str::is_empty;

use super::common::{Bench, stdout};

/// The command, CITATION.cff and the README cite the same thing.
#[test]
fn it_is_cited_alike_everywhere() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let read = |name: &str| std::fs::read_to_string(root.join(name)).unwrap();
    let (file, readme) = (read("CITATION.cff"), read("README.md"));
    let bibtex = Bench::new().prints("--cite");
    assert!(readme.contains(&bibtex), "{bibtex}");
    let of = |key: &str| {
        let (_, rest) = bibtex.split_once(&format!("{key} ")).unwrap();
        let (_, value) = rest.split_once('{').unwrap();
        value
            .split('}')
            .next()
            .unwrap()
            .trim_start_matches('{')
            .to_owned()
    };
    for key in ["title", "author", "version"] {
        let value = of(key);
        let found = file.lines().any(|line| line.contains(&value));
        assert!(found, "{key} {value}\n{file}");
    }
    assert_eq!(of("version"), env!("CARGO_PKG_VERSION"));
}

#[test]
fn faults_of_arguments_exit_with_2() {
    let bench = Bench::new();
    for (line, part) in [
        ("", "Usage: softrig <COMMAND>"),
        (
            "diagnoze --model m.toml",
            "unrecognized subcommand 'diagnoze'",
        ),
        ("fit good.csv", "give --model MODEL.toml, or write model"),
        ("simulate --model m.toml", "--recording <REC.csv>"),
        (
            "simulate --model m.toml --protocol step --recording good.csv",
            "cannot be used with",
        ),
        (
            "simulate --model m.toml --protocol step --angle-deg 3000",
            "0.1 to 360 degrees",
        ),
        (
            "simulate --model m.toml --protocol step --hold-s nan",
            "0.1 to 3600 seconds",
        ),
        (
            "simulate --model m.toml --protocol step --arithmetic f16",
            "micromath",
        ),
        (
            "diagnose --model m.toml good.csv other.csv --seed=-1",
            "--seed",
        ),
        (
            "fit --model m.toml good.csv --absolute-pressure=500",
            "from 0 to 110 kPa",
        ),
        ("fit --model m.toml good.csv --pressure-in atm", "kpa, psi"),
        (
            "fit --model m.toml good.csv --units pressure=atm",
            "kpa, psi",
        ),
        ("fit --model m.toml good.csv --columns p=q", "none of time"),
        (
            "fit --model m.toml good.csv --units time=s --time-in ms",
            "cannot be used with",
        ),
        ("completions tcsh", "bash"),
    ] {
        bench.fails(line, &[part]);
    }
    for (line, parts) in [
        (
            "example -o demo --effect frictoin",
            ["frictoin is not a known kind", "none", "coulomb_friction"],
        ),
        (
            "example -o demo --noise-deg nan",
            ["the noise is NaN°", "between 0", "20 degrees"],
        ),
        (
            "example -o demo --noise-deg=-1",
            ["the noise is -1°", "between 0", "20 degrees"],
        ),
    ] {
        bench.refuses(line, &parts);
    }
}

/// The subcommands that a help text lists.
pub fn subcommands(help: &str) -> Vec<String> {
    help.lines()
        .skip_while(|line| *line != "Commands:")
        .skip(1)
        .take_while(|line| !line.is_empty())
        // Continued descriptions are indented further.
        .filter(|line| !line.starts_with("   "))
        .filter_map(|line| line.split_whitespace().next())
        .filter(|name| *name != "help")
        .map(str::to_owned)
        .collect()
}

#[test]
fn every_help_has_an_example() {
    fn visit(bench: &Bench, command: &str, seen: &mut Vec<String>) {
        let line = format!("{command} --help");
        let help = stdout(&bench.line(&line).assert().success().stderr(is_empty()));
        let (_, examples) = help
            .split_once("Examples:\n")
            .unwrap_or_else(|| panic!("`softrig {command} --help` has no example"));
        let shown = format!("  softrig {command}");
        assert!(
            examples.contains(shown.trim_end()),
            "no {shown:?} in {examples}"
        );
        for name in subcommands(&help) {
            visit(bench, format!("{command} {name}").trim(), seen);
        }
        seen.push(command.to_owned());
    }
    let bench = Bench::empty();
    let mut seen = Vec::new();
    visit(&bench, "", &mut seen);
    for name in ["diagnose", "materials predict", "schema", "completions"] {
        assert!(seen.contains(&name.to_owned()), "{name} is not in {seen:?}");
    }
}

#[test]
fn completions_know_every_subcommand() {
    let bench = Bench::empty();
    let help = stdout(&bench.line("--help").assert().success());
    let names = subcommands(&help);
    assert!(names.contains(&"diagnose".to_owned()));
    for (shell, mark) in [
        ("bash", "complete -F _softrig"),
        ("zsh", "#compdef softrig"),
        ("fish", "complete -c softrig"),
    ] {
        let line = format!("completions {shell}");
        let script = stdout(&bench.line(&line).assert().success().stderr(is_empty()));
        assert!(script.contains(mark), "{shell}");
        for name in &names {
            assert!(script.contains(name), "{name} is not completed in {shell}");
        }
    }
}
