//! The checksum against the catalogue's. Apart from it, since its file stands alone.

use proptest::prelude::*;

use crate::checksum::Crc16;

proptest! {
    #[test]
    fn agrees_with_the_catalogue(bytes: [u8; 32], length in 0..=32usize) {
        let reference = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);
        let bytes = &bytes[..length];
        prop_assert_eq!(Crc16::of(bytes).value(), reference.checksum(bytes));
    }
}
