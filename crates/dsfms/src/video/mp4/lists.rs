//! A bound on what a slice makes the decoder allocate: it fills reference lists of any stated
//! length.

use crate::guard::caught;
use rust_h264::nal::{NalUnit, NalUnitType};
use rust_h264::pps::{Pps, parse_pps};
use rust_h264::slice::parse_slice_header;
use rust_h264::sps::{Sps, parse_sps};
use std::collections::BTreeMap;

/// Most pictures in a reference list: 32 fields (7.4.3 of H.264).
const MOST_LISTED: u32 = 32;

/// The parameter sets by their numbers, as the decoder keeps them.
#[derive(Default)]
pub(super) struct Lists {
    sequences: BTreeMap<u32, Sps>,
    pictures: BTreeMap<u32, Pps>,
}

impl Lists {
    /// Keeps a parameter set; a slice whose reference lists are longer than any is an error. What
    /// cannot be parsed passes: the decoder refuses it by the same parser.
    pub(super) fn check(&mut self, nal: &NalUnit) -> Result<(), String> {
        match caught(|| self.listed(nal)) {
            Ok(Some(listed)) if listed > MOST_LISTED => Err(format!(
                "a reference list of {listed} pictures; H.264 has at most {MOST_LISTED}"
            )),
            _ => Ok(()),
        }
    }

    /// The longer reference list of a slice, in pictures.
    fn listed(&mut self, nal: &NalUnit) -> Option<u32> {
        match nal.nal_unit_type {
            NalUnitType::Sps => {
                let sequence = parse_sps(&nal.rbsp).ok()?;
                self.sequences.insert(sequence.seq_parameter_set_id, sequence);
                None
            }
            NalUnitType::Pps => {
                let sequence = self.sequences.get(&code(&nal.rbsp, 1)?);
                let picture = parse_pps(&nal.rbsp, sequence).ok()?;
                self.pictures.insert(picture.pic_parameter_set_id, picture);
                None
            }
            NalUnitType::Slice | NalUnitType::SliceIdr => {
                let picture = self.pictures.get(&code(&nal.rbsp, 2)?)?;
                let sequence = self.sequences.get(&picture.seq_parameter_set_id)?;
                let (kind, reference) = (nal.nal_unit_type, nal.nal_ref_idc);
                let (header, _) =
                    parse_slice_header(&nal.rbsp, sequence, picture, kind, reference).ok()?;
                Some(header.num_ref_idx_l0_active.max(header.num_ref_idx_l1_active))
            }
            _ => None,
        }
    }
}

/// The Exp-Golomb number after `before` others (9.1 of H.264).
fn code(bytes: &[u8], before: usize) -> Option<u32> {
    let mut bits = bytes.iter().flat_map(|&b| (0..8).rev().map(move |i| u64::from(b >> i & 1)));
    let mut one = || {
        let zeros = bits.by_ref().position(|bit| bit == 1).filter(|&zeros| zeros < 32)?;
        let value = (0..zeros).try_fold(1, |value, _| Some(value << 1 | bits.next()?))?;
        u32::try_from(value - 1_u64).ok()
    };
    for _ in 0..before {
        one()?;
    }
    one()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ones and zeros as the content of a unit.
    fn unit(nal_unit_type: NalUnitType, bits: &str) -> NalUnit<'static> {
        let bits: Vec<u8> = bits.bytes().filter(|b| *b != b' ').map(|b| b - b'0').collect();
        let byte = |byte: &[u8]| byte.iter().enumerate().map(|(i, bit)| bit << (7 - i)).sum();
        let rbsp: Vec<u8> = bits.chunks(8).map(byte).collect();
        NalUnit { nal_ref_idc: 0, nal_unit_type, rbsp: rbsp.into() }
    }

    /// A number in Exp-Golomb code.
    fn ue(n: u32) -> String {
        let bits = format!("{:b}", n + 1);
        format!("{}{bits}", "0".repeat(bits.len() - 1))
    }

    #[test]
    fn a_slice_has_at_most_32_pictures_in_its_list() {
        let mut lists = Lists::default();
        // Baseline, level 1, one block in size, one reference.
        let sequence = "01000010 00000000 00001010 1 1 011 010 0 1 1 1 0 0 0 1";
        lists.check(&unit(NalUnitType::Sps, sequence)).unwrap();
        let mut of = |default: u32, stated: Option<u32>| {
            let picture = format!("1 1 0 0 1 {} 1 0 00 1 1 1 0 0 0 1", ue(default - 1));
            lists.check(&unit(NalUnitType::Pps, &picture)).unwrap();
            let stated = stated.map_or("0".into(), |n| format!("1 {}", ue(n - 1)));
            lists.check(&unit(NalUnitType::Slice, &format!("1 1 1 0000 {stated} 0 1 1")))
        };
        assert_eq!(of(1, None), Ok(()));
        assert_eq!(of(32, None), Ok(()));
        assert_eq!(of(1, Some(32)), Ok(()));
        for error in [of(33, None), of(1, Some(33)), of(1, Some(1 << 30))] {
            assert!(error.unwrap_err().contains("reference list"));
        }
    }

    #[test]
    fn exp_golomb_by_hand() {
        // 1 | 010 | 011 | 00100 | 0...: 0, 1, 2, 3, and an end in the middle of one.
        let bytes = [0b1010_0110, 0b0100_0000];
        let found: Vec<_> = (0..5).map(|before| code(&bytes, before)).collect();
        assert_eq!(found, [Some(0), Some(1), Some(2), Some(3), None]);
    }
}
