//! Bags of ROS 2 that are a folder: one file, or all those that its metadata list.

use std::fs::File;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};

use softrig_formats::bounded::{self, Limits};
use softrig_formats::columns::Layout;
use softrig_formats::error::InputError;
use softrig_formats::formats::binary::Binary;
use softrig_formats::formats::{Samples, read, refuse_foreign, start_of};

use crate::topics::Topics;
use crate::{mcap, rosbag};

/// What rosbag2 writes into the folder of a bag beside its files.
const ABOUT_BAG: &str = "metadata.yaml";
/// In it, what comes before the names of the files.
const FILES_OF_BAG: &str = "relative_file_paths:";
/// The endings of a bag's files, with the one that is preferred first.
const OF_BAGS: [&str; 2] = ["mcap", "db3"];
/// Appended to the ending of a file that is packed whole.
const PACKED_FILE: &str = ".zstd";

/// Reads the bag of rosbag2 in a folder.
///
/// # Errors
///
/// Names the folder that is none, or the file of it that cannot be read.
pub(crate) fn read_folder(folder: &Path, layout: &Layout) -> Result<Samples, InputError> {
    match files_in(folder)?.as_slice() {
        [only] => read(only, layout),
        several => read_together(several, folder, layout),
    }
}

/// The files of the bag in a folder: one, or all those that its metadata list.
fn files_in(folder: &Path) -> Result<Vec<PathBuf>, InputError> {
    let fail = |error: std::io::Error| InputError::from_io(folder, &error);
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .map_err(fail)?
        .map(|entry| entry.map(|it| it.path()))
        .collect::<Result<_, _>>()
        .map_err(fail)?;
    files.sort();
    let about = folder.join(ABOUT_BAG);
    if about.is_file() {
        let listed = files_listed(&bounded::read_text(&about)?);
        if listed.len() > 1 {
            let unpacked = |name: &String| {
                let name = name.strip_suffix(PACKED_FILE).unwrap_or(name);
                Some(folder.join(name)).filter(|file| file.is_file())
            };
            let there = |name: &String| unpacked(name).unwrap_or_else(|| folder.join(name));
            return Ok(listed.iter().map(there).collect());
        }
    }
    let ends = |path: &&PathBuf, ending: &str| {
        let name = path.file_name().map(|it| it.to_string_lossy());
        name.is_some_and(|it| it.ends_with(ending))
    };
    for packed in ["", PACKED_FILE] {
        for kind in OF_BAGS {
            let ending = format!(".{kind}{packed}");
            let found: Vec<PathBuf> = files
                .iter()
                .filter(|it| ends(it, &ending))
                .cloned()
                .collect();
            if found.len() > 1 {
                return Err(InputError::new(
                    format!(
                        "holds {} files, and no {ABOUT_BAG} that makes one bag of them",
                        found.len()
                    ),
                    format!("name its {ending} files one by one: each is a recording"),
                )
                .in_file(folder));
            }
            if !found.is_empty() {
                return Ok(found);
            }
        }
    }
    Err(InputError::new(
        "is a folder, and no bag of ROS 2",
        "name the recordings in it",
    )
    .in_file(folder))
}

/// The names of the files that the metadata of a bag list.
fn files_listed(about: &str) -> Vec<String> {
    about
        .lines()
        .map(str::trim)
        .skip_while(|line| !line.starts_with(FILES_OF_BAG))
        .skip(1)
        .map_while(|line| line.strip_prefix("- "))
        .map(|name| name.trim().trim_matches(['"', '\'']))
        // Older versions write the folder too.
        .map(|name| name.rsplit('/').next().unwrap_or(name).to_owned())
        .collect()
}

/// Reads the files of a bag as the one recording that they are.
fn read_together(files: &[PathBuf], bag: &Path, layout: &Layout) -> Result<Samples, InputError> {
    let limits = Limits::RECORDING;
    let mut topics = Topics::of(layout);
    for path in files {
        let fail = |error: std::io::Error| InputError::from_io(path, &error);
        let mut file = File::open(path).map_err(fail)?;
        let start = start_of(&mut file).map_err(fail)?;
        refuse_foreign(&start, path)?;
        if Binary::of(&start) == Some(Binary::Sqlite) {
            rosbag::read_into(&mut topics, path, limits)?;
        } else {
            mcap::read_into(&mut topics, Cursor::new(start).chain(file), path, limits)?;
        }
    }
    topics
        .sheet(bag, layout)?
        .samples(bag, layout, limits, "topic")
}
