//! Bytes as text (RFC 4648, padded).

/// Encode.
pub fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let word =
            chunk.iter().fold(0u32, |w, &b| w << 8 | u32::from(b)) << (8 * (3 - chunk.len()));
        for k in 0..4 {
            let index = (word >> (18 - 6 * k)) as usize & 63;
            text.push(if k <= chunk.len() { ALPHABET[index] as char } else { '=' });
        }
    }
    text
}

/// Decode; `None` where it is no base64.
pub(crate) fn from_base64(text: &str) -> Option<Vec<u8>> {
    let coded = text.trim_end_matches('=');
    let padding = text.len() - coded.len();
    if padding > 2 || coded.len() % 4 == 1 || (padding > 0 && !text.len().is_multiple_of(4)) {
        return None;
    }
    let value = |c: u8| {
        Some(match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        })
    };
    let mut bytes = Vec::with_capacity(coded.len() * 3 / 4);
    for chunk in coded.as_bytes().chunks(4) {
        let word = chunk.iter().try_fold(0u32, |w, &c| Some(w << 6 | u32::from(value(c)?)))?;
        let word = word << (6 * (4 - chunk.len()));
        bytes.extend(&word.to_be_bytes()[1..chunk.len()]);
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn examples_of_rfc_4648() {
        for (plain, coded) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")]
        {
            assert_eq!(base64(plain.as_bytes()), coded);
            assert_eq!(from_base64(coded).unwrap(), plain.as_bytes());
            assert_eq!(from_base64(coded.trim_end_matches('=')).unwrap(), plain.as_bytes());
        }
        let every: Vec<u8> = (0..=255).collect();
        assert_eq!(from_base64(&base64(&every)).unwrap(), every);
        for bad in ["A", "A===", "Zg=", "Z g=", "Zm9\u{e4}"] {
            assert!(from_base64(bad).is_none(), "{bad}");
        }
    }
}
