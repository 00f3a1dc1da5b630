//! The checksum of OpenIGTLink: CRC-64 of ECMA-182, highest bit first, from zero, nothing inverted.

/// The polynomial without its highest term.
const POLYNOMIAL: u64 = 0x42F0_E1EB_A9EA_3693;

/// `TABLES[k][b]`: what byte `b` leaves after `k` zero bytes more.
static TABLES: [[u64; 256]; 8] = tables();

const fn tables() -> [[u64; 256]; 8] {
    let mut tables = [[0; 256]; 8];
    let mut byte = 0;
    while byte < 256 {
        let mut crc = (byte as u64) << 56;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc >> 63 == 1 { (crc << 1) ^ POLYNOMIAL } else { crc << 1 };
            bit += 1;
        }
        tables[0][byte] = crc;
        byte += 1;
    }
    let mut k = 1;
    while k < 8 {
        let mut byte = 0;
        while byte < 256 {
            let before: u64 = tables[k - 1][byte];
            tables[k][byte] = (before << 8) ^ tables[0][(before >> 56) as usize];
            byte += 1;
        }
        k += 1;
    }
    tables
}

/// The checksum of bytes, eight at a time: a picture of 1280x720 px has nearly three million.
pub fn crc64(bytes: &[u8]) -> u64 {
    let (eights, rest) = bytes.as_chunks::<8>();
    let mut crc = 0;
    for eight in eights {
        let mixed = (crc ^ u64::from_be_bytes(*eight)).to_be_bytes();
        crc = (0..8).fold(0, |sum, k| sum ^ TABLES[7 - k][usize::from(mixed[k])]);
    }
    rest.iter().fold(crc, |crc, byte| (crc << 8) ^ TABLES[0][usize::from((crc >> 56) as u8 ^ byte)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        // The check value of CRC-64/ECMA-182 in the catalogues.
        assert_eq!(crc64(b"123456789"), 0x6C40_DF5F_0B49_7347);
        assert_eq!(crc64(b""), 0);
        // By hand: one bit shifted out once leaves the polynomial.
        assert_eq!(crc64(&[1]), POLYNOMIAL);
        // Eight at a time as bit by bit.
        let bytes: Vec<u8> = (0..100u8).map(|k| k.wrapping_mul(37)).collect();
        let mut slow = 0u64;
        for byte in &bytes {
            slow ^= u64::from(*byte) << 56;
            for _ in 0..8 {
                slow = if slow >> 63 == 1 { (slow << 1) ^ POLYNOMIAL } else { slow << 1 };
            }
        }
        assert_eq!(crc64(&bytes), slow);
    }
}
