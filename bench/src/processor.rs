//! Processor time, as Linux counts it.

use std::fs;

/// Whose processor time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Of {
    /// Of this process.
    Itself,
    /// Of the processes that were started here and have ended.
    Children,
}

/// Processor time (s) so far; none where the system does not keep it in a file.
pub fn seconds(of: Of) -> Option<f64> {
    seconds_in(&fs::read_to_string("/proc/self/stat").ok()?, of)
}

/// From the text of Linux's `/proc/self/stat` (proc(5)): fields 14 and 15, or 16 and 17, in hundredths of a second. They
/// are counted after the name in parentheses, which may hold blanks.
fn seconds_in(stat: &str, of: Of) -> Option<f64> {
    const TICKS_PER_SECOND: f64 = 100.0;
    let (_, fields) = stat.rsplit_once(')')?;
    let before = match of {
        Of::Itself => 11,
        Of::Children => 13,
    };
    let mut fields = fields.split_whitespace().skip(before);
    let mut ticks = || fields.next()?.parse::<f64>().ok();
    Some((ticks()? + ticks()?) / TICKS_PER_SECOND)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn processor_time_is_read() {
        let stat = "12 (a (b) c) S 1 2 3 4 5 6 7 8 9 10 100 25 250 50 20 0";
        assert_eq!(seconds_in(stat, Of::Children), Some(3.0));
        assert_eq!(seconds_in(stat, Of::Itself), Some(1.25));
        assert_eq!(seconds_in("12 a", Of::Children), None);
        assert_eq!(seconds_in("1 (a) S 1", Of::Children), None);
    }
}
