//! Clips lines at the edge of a panel, so that a curve beyond the limits does not cross
//! other panels.

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rectangle {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) right: f64,
    pub(super) bottom: f64,
}

impl Rectangle {
    pub(super) fn contains(&self, (x, y): (f64, f64)) -> bool {
        x >= self.left && x <= self.right && y >= self.top && y <= self.bottom
    }

    /// The part of a segment inside the rectangle (Liang and Barsky).
    fn clip(&self, from: (f64, f64), to: (f64, f64)) -> Option<[(f64, f64); 2]> {
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        for (direction, room) in [
            (-dx, from.0 - self.left),
            (dx, self.right - from.0),
            (-dy, from.1 - self.top),
            (dy, self.bottom - from.1),
        ] {
            if direction == 0.0 {
                if room < 0.0 {
                    return None;
                }
            } else if direction < 0.0 {
                enter = enter.max(room / direction);
            } else {
                leave = leave.min(room / direction);
            }
        }
        (enter <= leave).then(|| {
            let at = |share: f64| (from.0 + share * dx, from.1 + share * dy);
            // Unmoved ends keep their exact coordinates, so that neighbouring
            // segments join.
            [
                if enter > 0.0 { at(enter) } else { from },
                if leave < 1.0 { at(leave) } else { to },
            ]
        })
    }

    /// Cuts a path at the edges of the panel.
    pub(super) fn clip_path(&self, path: &[(f64, f64)]) -> Vec<Vec<(f64, f64)>> {
        let mut pieces: Vec<Vec<(f64, f64)>> = Vec::new();
        if let [only] = path
            && self.contains(*only)
        {
            // A lone sample between two gaps would vanish as a line.
            let (x, y) = *only;
            pieces.push(vec![(x - 0.8, y), (x + 0.8, y)]);
        }
        for segment in path.windows(2) {
            let Some([from, to]) = self.clip(segment[0], segment[1]) else {
                continue;
            };
            match pieces.last_mut() {
                Some(piece) if piece.last() == Some(&from) => piece.push(to),
                _ => pieces.push(vec![from, to]),
            }
        }
        pieces
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_outside_the_range_is_cut_at_the_edge() {
        let area = Rectangle {
            left: 0.0,
            top: 0.0,
            right: 10.0,
            bottom: 10.0,
        };
        assert_eq!(
            area.clip((-10.0, 5.0), (20.0, 5.0)),
            Some([(0.0, 5.0), (10.0, 5.0)])
        );
        assert_eq!(
            area.clip((5.0, 5.0), (5.0, 25.0)),
            Some([(5.0, 5.0), (5.0, 10.0)])
        );
        assert_eq!(area.clip((-1.0, -5.0), (11.0, -5.0)), None);
        assert_eq!(area.clip((-4.0, 3.0), (3.0, -4.0)), None);
    }
}
