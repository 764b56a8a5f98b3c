//! The rigs of the page: labels of `bench/data/real_known.json` that say what a reader has to
//! know beside them.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::invariance::known::{self, Known};

/// A rig that others recorded.
#[derive(Clone, Debug)]
pub struct Rig {
    /// Its folder.
    pub name: String,
    /// What is known of it.
    pub known: Known,
    /// What the page says of it.
    pub page: Page,
}

/// What the page says of a rig.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Page {
    /// Heading of its section.
    pub title: String,
    /// Known or published facts about the missing physics, for the table.
    pub known: String,
    /// The quantity in the column `angle_deg`, as the label of an axis.
    pub quantity: String,
    /// The recorded rig, and its authors' description of the physics.
    pub about: String,
    /// Authors and the source with its commit.
    pub source: String,
    /// Link to the source.
    pub link: String,
    /// Its licence.
    pub licence: String,
}

/// All of them in the order of the file, controls last.
///
/// # Errors
///
/// What is wrong with the file of this repository.
pub fn all() -> Result<Vec<Rig>, String> {
    #[derive(Deserialize)]
    struct Entry {
        #[serde(flatten)]
        known: Known,
        page: Option<Page>,
    }
    let entries: Map<String, Value> = known::read_json(&known::real_file())?;
    let rigs = entries.into_iter().filter_map(|(name, entry)| {
        let Entry { known, page } = match serde_json::from_value(entry) {
            Ok(entry) => entry,
            Err(error) => return Some(Err(format!("{name}: {error}"))),
        };
        Some(Ok(Rig {
            name,
            known,
            page: page?,
        }))
    });
    rigs.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rigs_of_the_page_come_in_their_order_controls_last() {
        let rigs = all().unwrap();
        assert_eq!(rigs.len(), 8);
        assert_eq!(rigs[0].name, "pendulum");
        assert_eq!(rigs[0].known.holdout, ["vad_"]);
        assert!(rigs.is_sorted_by_key(|rig| rig.known.control));
        assert_eq!(rigs.iter().filter(|rig| rig.known.control).count(), 3);
    }
}
