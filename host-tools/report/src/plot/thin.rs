//! Fewer points for the same picture.
//!
//! A recording of minutes at a kilohertz has far more samples than the page has pixels,
//! and a file with all of them is slow to open. The thinned picture must look the same:
//! a spike of one sample is kept.

use super::axis::drawable;
use super::canvas::{pixel, tenths};

/// More dots than this in one series say nothing more and make slow files.
const MAXIMUM_DOTS: usize = 900;

/// Splits a curve where a value cannot be drawn.
pub(super) fn runs(points: impl Iterator<Item = (f64, f64)>) -> Vec<Vec<(f64, f64)>> {
    let mut runs: Vec<Vec<(f64, f64)>> = vec![Vec::new()];
    for (x, y) in points {
        if !(drawable(x) && drawable(y)) {
            runs.push(Vec::new());
        } else if let Some(run) = runs.last_mut() {
            run.push((x, y));
        }
    }
    runs.retain(|run| !run.is_empty());
    runs
}

/// Keeps what can be seen of a path in pixels.
///
/// Where `x` never decreases, each pixel column keeps its extremes in the order
/// in which they came, so that a spike of one sample survives. Other paths lose
/// only points that fall on their predecessor.
pub(super) fn thin_line(path: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let forwards = path.windows(2).all(|pair| pair[0].0 <= pair[1].0);
    let mut kept: Vec<(f64, f64)> = Vec::new();
    if forwards {
        let mut rest = path;
        while let Some(&(x, _)) = rest.first() {
            let column = x.floor();
            let length = rest
                .iter()
                .position(|point| point.0.floor() > column)
                .unwrap_or(rest.len());
            let (here, after) = rest.split_at(length);
            rest = after;
            if here.len() <= 2 {
                kept.extend_from_slice(here);
                continue;
            }
            let mut lowest = 0;
            let mut highest = 0;
            for (index, point) in here.iter().enumerate() {
                if point.1 < here[lowest].1 {
                    lowest = index;
                }
                if point.1 > here[highest].1 {
                    highest = index;
                }
            }
            kept.push(here[lowest.min(highest)]);
            if lowest != highest {
                kept.push(here[lowest.max(highest)]);
            }
        }
    } else {
        for point in path {
            if kept.last().is_none_or(|last| pixel(*last) != pixel(*point)) {
                kept.push(*point);
            }
        }
    }
    kept
}

/// Keeps one dot per cell of a grid, coarse enough that few enough remain.
pub(super) fn thin_dots(dots: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut cell = 0.5;
    loop {
        let mut taken = std::collections::BTreeSet::new();
        let kept: Vec<(f64, f64)> = dots
            .iter()
            .filter(|(x, y)| taken.insert((tenths(x / cell), tenths(y / cell))))
            .copied()
            .collect();
        if kept.len() <= MAXIMUM_DOTS {
            return kept;
        }
        cell *= 1.3;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_a_spike() {
        let mut path: Vec<(f64, f64)> = (0..12_000)
            .map(|i| (f64::from(i) * 0.05, if i % 2 == 0 { 5.0 } else { -5.0 }))
            .collect();
        path[6_001].1 = 500.0;
        let kept = thin_line(&path);
        assert!(kept.len() < 2_000, "{} points", kept.len());
        let top = kept
            .into_iter()
            .fold(0.0, |top, point| f64::max(top, point.1));
        assert!((top - 500.0).abs() < f64::EPSILON);
    }
}
