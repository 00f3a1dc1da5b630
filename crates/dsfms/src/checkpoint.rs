//! Values of finished stages, kept so that a run that was stopped goes on behind the last of them.
//!
//! A stage asks for its value by name and by a key over everything that it depends on; whoever
//! keeps the values says which build made them. Values are written with `postcard`, exactly: what
//! is read back has the bits of what was kept.

use serde::Serialize;
use serde::de::DeserializeOwned;
use std::io::{self, Write};

/// Writes the bytes of a value.
pub type WriteValue<'a> = &'a dyn Fn(&mut dyn Write) -> io::Result<()>;

/// Keeps the values of stages; may be called from any thread.
pub trait Store: Sync {
    /// What was saved under a name and a key by this build of the program; `None` where there is
    /// nothing.
    fn load(&self, stage: &str, key: u64) -> Option<Vec<u8>>;
    /// Keep a value, whose bytes are written piece by piece: depth maps of all frames are too large
    /// to be in memory twice. What cannot be kept costs the next run time, not this one its result.
    fn save(&self, stage: &str, key: u64, value: WriteValue<'_>);
    /// A value that was loaded is used; `frames`: how many frames it is about.
    fn used(&self, stage: &str, frames: usize);
    /// What was loaded is no value of that stage, and is not used.
    fn refused(&self, stage: &str);
}

/// A store, and the key of what is kept in it; or nothing, where nothing is to be kept.
#[derive(Clone, Copy, Default)]
pub struct Keep<'a> {
    store: Option<&'a dyn Store>,
    key: u64,
    /// Behind the name of every stage.
    suffix: &'static str,
}

impl<'a> Keep<'a> {
    /// Keep in a store.
    pub fn new(store: &'a dyn Store) -> Self {
        Self { store: Some(store), key: 0, suffix: "" }
    }

    /// Under a key that a digest of further input enters; `digest` is asked only where something is
    /// kept.
    pub(crate) fn with(self, digest: impl FnOnce(&mut Digest)) -> Self {
        if self.store.is_none() {
            return self;
        }
        let mut hash = Digest::default();
        hash.bytes(&self.key.to_le_bytes());
        digest(&mut hash);
        Self { key: hash.finish(), ..self }
    }

    #[cfg(test)]
    pub(crate) fn key(&self) -> u64 {
        self.key
    }

    /// For another attempt at the same stages.
    pub(crate) fn suffixed(self, suffix: &'static str) -> Self {
        Self { suffix, ..self }
    }

    /// The value of a stage: the kept one where it is `whole`, else what `make` makes, which is
    /// then kept. `frames`: how many frames a value is about.
    pub(crate) fn stage<T: Serialize + DeserializeOwned, E>(
        &self,
        name: &str,
        frames: impl Fn(&T) -> usize,
        whole: impl Fn(&T) -> bool,
        make: impl FnOnce() -> Result<T, E>,
    ) -> Result<T, E> {
        let Some(store) = self.store else { return make() };
        let name = format!("{name}{}", self.suffix);
        if let Some(bytes) = store.load(&name, self.key) {
            // All of it: bytes left over are of something else.
            match postcard::take_from_bytes::<T>(&bytes) {
                Ok((value, [])) if whole(&value) => {
                    store.used(&name, frames(&value));
                    return Ok(value);
                }
                _ => store.refused(&name),
            }
        }
        let value = make()?;
        store.save(&name, self.key, &|to| {
            postcard::to_io(&value, to).map(|_| ()).map_err(io::Error::other)
        });
        Ok(value)
    }
}

impl std::fmt::Debug for Keep<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Keep").field("keeps", &self.store.is_some()).finish_non_exhaustive()
    }
}

/// A number for everything that was fed, the same for every build and machine: FNV-1a of 64 bits.
/// It tells a change, not a forgery.
pub struct Digest(u64);

impl Default for Digest {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Digest {
    /// Bytes, apart from those before and after them.
    pub fn bytes(&mut self, bytes: &[u8]) {
        for &byte in (bytes.len() as u64).to_le_bytes().iter().chain(bytes) {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }

    /// A value as it is serialised; one that cannot be is like no other.
    pub(crate) fn value(&mut self, value: &impl Serialize) {
        match postcard::to_allocvec(value) {
            Ok(bytes) => self.bytes(&bytes),
            Err(_) => self.bytes(&std::process::id().to_le_bytes()),
        }
    }

    /// The number.
    pub fn finish(&self) -> u64 {
        self.0
    }
}

/// A digest of bytes.
pub(crate) fn digest(bytes: &[u8]) -> u64 {
    let mut digest = Digest::default();
    digest.bytes(bytes);
    digest.finish()
}

/// Arrays longer than those that serde knows, as one list of their numbers.
pub(crate) mod flat {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<S: Serializer, const N: usize>(
        list: &[[u8; N]],
        to: S,
    ) -> Result<S::Ok, S::Error> {
        list.as_flattened().serialize(to)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>, const N: usize>(
        from: D,
    ) -> Result<Vec<[u8; N]>, D::Error> {
        let all = Vec::<u8>::deserialize(from)?;
        match all.as_chunks() {
            (list, []) => Ok(list.to_vec()),
            _ => Err(D::Error::custom("a list that ends within an array")),
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use std::collections::BTreeMap;
    use std::sync::Mutex;

    /// Keeps in memory, and remembers what it was asked.
    #[derive(Default)]
    pub(crate) struct MemoryStore {
        pub kept: Mutex<BTreeMap<String, (u64, Vec<u8>)>>,
        pub used: Mutex<Vec<(String, usize)>>,
        pub refused: Mutex<Vec<String>>,
    }

    impl Store for MemoryStore {
        fn load(&self, stage: &str, key: u64) -> Option<Vec<u8>> {
            let kept = self.kept.lock().unwrap();
            kept.get(stage).filter(|(k, _)| *k == key).map(|(_, bytes)| bytes.clone())
        }
        fn save(&self, stage: &str, key: u64, value: WriteValue) {
            let mut bytes = Vec::new();
            value(&mut bytes).unwrap();
            self.kept.lock().unwrap().insert(stage.into(), (key, bytes));
        }
        fn used(&self, stage: &str, frames: usize) {
            self.used.lock().unwrap().push((stage.into(), frames));
        }
        fn refused(&self, stage: &str) {
            self.refused.lock().unwrap().push(stage.into());
        }
    }

    fn stage(keep: &Keep, made: Vec<f64>) -> Vec<f64> {
        let whole = |v: &Vec<f64>| v.len() < 4;
        keep.stage::<_, ()>("numbers", Vec::len, whole, || Ok(made)).unwrap()
    }

    #[test]
    fn a_value_is_read_back_exactly_and_only_under_its_own_key() {
        let store = MemoryStore::default();
        let key = |n: u8| Keep::new(&store).with(|d| d.bytes(&[n]));
        let odd = vec![0.1 + 0.2, f64::INFINITY, -0.0];
        assert_eq!(stage(&key(1), odd.clone()), odd);
        let bits = |v: Vec<f64>| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(stage(&key(1), vec![])), bits(odd));
        assert_eq!(*store.used.lock().unwrap(), [("numbers".to_string(), 3)]);
        assert_eq!(stage(&key(2), vec![7.0]), [7.0]);
        assert_eq!(stage(&key(2).suffixed("-b"), vec![8.0]), [8.0]);
        assert!(store.refused.lock().unwrap().is_empty());
    }

    #[test]
    fn what_is_no_value_of_the_stage_is_made_again() {
        let store = MemoryStore::default();
        let keep = Keep::new(&store);
        for bytes in [&[][..], &[2, 1, 2, 3], &[0, 9], &[0xff; 12], &[0xff, 0xff, 0xff, 0x7f, 1]] {
            store.save("numbers", 0, &|to| to.write_all(bytes));
            assert_eq!(stage(&keep, vec![3.0]), [3.0], "{bytes:?}");
        }
        assert_eq!(store.refused.lock().unwrap().len(), 5);
        // Read, but not whole.
        let five = postcard::to_allocvec(&vec![0.0; 5]).unwrap();
        store.save("numbers", 0, &|to| to.write_all(&five));
        assert_eq!(stage(&keep, vec![4.0]), [4.0]);
    }

    #[test]
    fn a_digest_is_that_of_fnv() {
        // FNV-1a of eight bytes of the length and `foobar`, worked out apart from this program.
        assert_eq!(digest(b"foobar"), 0xb277_229a_2d9d_19f2);
    }

    #[test]
    fn where_nothing_is_kept_no_digest_is_taken() {
        let keep = Keep::default().with(|_| panic!("asked"));
        assert_eq!(stage(&keep, vec![1.0]), [1.0]);
    }
}
