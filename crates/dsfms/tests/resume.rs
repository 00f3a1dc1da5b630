//! A template whose making was stopped goes on behind its last finished stage, with the same bits.

use dsfms::Template;
use dsfms::checkpoint::{Store, WriteValue};
use dsfms::synth::Case;
use std::collections::BTreeMap;
use std::sync::Mutex;

#[path = "common/explored.rs"]
mod explored;

use explored::files;

/// Keeps stages in memory, in the order of their names, and counts those used.
#[derive(Default)]
struct Memory {
    kept: Mutex<BTreeMap<String, (u64, Vec<u8>)>>,
    used: Mutex<Vec<String>>,
    refused: Mutex<Vec<String>>,
}

impl Store for Memory {
    fn load(&self, stage: &str, key: u64) -> Option<Vec<u8>> {
        let kept = self.kept.lock().unwrap();
        kept.get(stage).filter(|(k, _)| *k == key).map(|(_, bytes)| bytes.clone())
    }
    fn save(&self, stage: &str, key: u64, value: WriteValue) {
        let mut bytes = Vec::new();
        value(&mut bytes).unwrap();
        self.kept.lock().unwrap().insert(stage.into(), (key, bytes));
    }
    fn used(&self, stage: &str, _frames: usize) {
        self.used.lock().unwrap().push(stage.into());
    }
    fn refused(&self, stage: &str) {
        self.refused.lock().unwrap().push(stage.into());
    }
}

const STAGES: [&str; 4] = ["features", "matches", "poses", "depth"];

fn build(case: &Case, store: &Memory) -> Template {
    explored::build(case, Some(store))
}

#[test]
fn a_run_stopped_behind_any_stage_goes_on_to_the_same_bits() {
    let case = Case::example(1);
    let whole = Memory::default();
    let expected = files(&build(&case, &whole));
    let stages = whole.kept.lock().unwrap().clone();
    assert_eq!(
        stages.keys().map(String::as_str).collect::<std::collections::BTreeSet<_>>(),
        STAGES.into()
    );
    assert!(whole.used.lock().unwrap().is_empty());
    for finished in 1..=STAGES.len() {
        let store = Memory::default();
        for stage in &STAGES[..finished] {
            store.kept.lock().unwrap().insert(stage.to_string(), stages[*stage].clone());
        }
        let found = files(&build(&case, &store));
        assert_eq!(*store.used.lock().unwrap(), STAGES[..finished]);
        for ((name, found), (_, expected)) in found.iter().zip(&expected) {
            assert!(found == expected, "{name} differs behind {}", STAGES[finished - 1]);
        }
        assert_eq!(found.len(), expected.len());
        // And the stages that were missing are those of the whole run.
        assert_eq!(*store.kept.lock().unwrap(), stages);
    }
    // Values that break off: never used.
    let torn = Memory { kept: Mutex::new(stages), ..Default::default() };
    for stage in STAGES {
        let mut kept = torn.kept.lock().unwrap();
        let bytes = &mut kept.get_mut(stage).unwrap().1;
        bytes.truncate(bytes.len() / 2);
    }
    assert_eq!(files(&build(&case, &torn)), expected);
    assert_eq!(*torn.refused.lock().unwrap(), STAGES);
}
