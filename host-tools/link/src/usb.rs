//! USB chips behind which a board may be.

/// Vendors and products: Arduino's Mega under both of its vendors; the converters CH340 (on most
/// copies), FTDI and CP210x (on others).
pub const BOARDS: [(u16, &[u16]); 5] = [
    (0x2341, &[0x0010, 0x0042, 0x0210, 0x0242]),
    (0x2a03, &[0x0010, 0x0042, 0x0210, 0x0242]),
    (0x1a86, &[0x7523, 0x5523, 0x55d4]),
    (0x0403, &[0x6001]),
    (0x10c4, &[0xea60]),
];

/// Whether a chip is one of [`BOARDS`].
#[cfg(not(target_family = "wasm"))]
pub(super) fn looks_like_a_board(vendor: u16, product: u16) -> bool {
    BOARDS
        .iter()
        .any(|(known, products)| *known == vendor && products.contains(&product))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boards_and_their_copies_are_recognised() {
        for (vendor, product) in [(0x2341, 0x0042), (0x2a03, 0x0042), (0x1a86, 0x7523)] {
            assert!(looks_like_a_board(vendor, product));
        }
        // An Uno, and a mouse.
        assert!(!looks_like_a_board(0x2341, 0x0043));
        assert!(!looks_like_a_board(0x046d, 0xc077));
    }
}
