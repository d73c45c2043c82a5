//! Writes PyTorch files, as `torch.save` does in its zip format: for checkpoints of which there is no fixture.

use std::io::Write;
use std::path::Path;

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// What a checkpoint's dictionary holds.
#[derive(Clone, Debug)]
pub enum Entry {
    /// A whole number.
    Whole(i32),
    /// True or false.
    Truth(bool),
    /// A number.
    Number(f64),
    /// A list.
    List(Vec<Entry>),
    /// A dictionary; keys that are digits alone are numbers, as in an optimiser's state.
    Dict(Vec<(String, Entry)>),
    /// A tensor of single precision.
    Tensor(Vec<usize>, Vec<f32>),
}

impl Entry {
    /// A state dict.
    pub fn tensors(tensors: impl IntoIterator<Item = (String, Vec<usize>, Vec<f32>)>) -> Self {
        Self::Dict(tensors.into_iter().map(|(name, shape, values)| (name, Self::Tensor(shape, values))).collect())
    }
}

/// Writes a file whose root is `entry`.
pub fn write_pytorch(path: &Path, entry: &Entry) {
    let mut pickle = Pickle { bytes: vec![0x80, 2], storages: Vec::new() };
    pickle.put(entry);
    pickle.bytes.push(b'.');
    let mut zip = ZipWriter::new(std::fs::File::create(path).unwrap());
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    let mut file = |name: String, bytes: &[u8]| {
        zip.start_file(name, options).unwrap();
        zip.write_all(bytes).unwrap();
    };
    file("archive/data.pkl".into(), &pickle.bytes);
    file("archive/byteorder".into(), b"little");
    for (i, storage) in pickle.storages.iter().enumerate() {
        let bytes: Vec<u8> = storage.iter().flat_map(|value| value.to_le_bytes()).collect();
        file(format!("archive/data/{i}"), &bytes);
    }
    file("archive/version".into(), b"3\n");
    zip.finish().unwrap();
}

/// The same as the bytes of a file of `torch.save` before its zip format: pickles one after another, then storages.
pub fn legacy_pytorch(entry: &Entry) -> Vec<u8> {
    let pickled = |put: &dyn Fn(&mut Pickle)| {
        let mut pickle = Pickle { bytes: vec![0x80, 2], storages: Vec::new() };
        put(&mut pickle);
        pickle.bytes.push(b'.');
        pickle
    };
    // The magic number 0x1950a86a20f9469cfc6c, as a long of ten bytes.
    let magic = [0x8a, 10, 0x6c, 0xfc, 0x9c, 0x46, 0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19];
    let root = pickled(&|pickle| pickle.put(entry));
    let keys: Vec<String> = (0..root.storages.len()).map(|i| i.to_string()).collect();
    let mut bytes = pickled(&|pickle| pickle.bytes.extend(magic)).bytes;
    bytes.extend(pickled(&|pickle| pickle.whole(1001)).bytes);
    let system = Entry::Dict(vec![
        ("protocol_version".into(), Entry::Whole(1001)),
        ("little_endian".into(), Entry::Truth(true)),
    ]);
    bytes.extend(pickled(&|pickle| pickle.put(&system)).bytes);
    bytes.extend(&root.bytes);
    let listed = pickled(&|pickle| {
        pickle.bytes.extend(b"](");
        keys.iter().for_each(|key| pickle.text(key));
        pickle.bytes.push(b'e');
    });
    bytes.extend(listed.bytes);
    for storage in &root.storages {
        bytes.extend((storage.len() as u64).to_le_bytes());
        bytes.extend(storage.iter().flat_map(|value| value.to_le_bytes()));
    }
    bytes
}

/// A pickle of protocol 2 in the making.
struct Pickle {
    bytes: Vec<u8>,
    storages: Vec<Vec<f32>>,
}

impl Pickle {
    fn put(&mut self, entry: &Entry) {
        match entry {
            Entry::Whole(value) => self.whole(*value),
            Entry::Truth(value) => self.bytes.push(if *value { 0x88 } else { 0x89 }),
            Entry::Number(value) => {
                self.bytes.push(b'G');
                self.bytes.extend(value.to_be_bytes());
            }
            Entry::List(entries) => {
                self.bytes.extend(b"](");
                entries.iter().for_each(|entry| self.put(entry));
                self.bytes.push(b'e');
            }
            Entry::Dict(entries) => {
                self.bytes.extend(b"}(");
                for (key, entry) in entries {
                    match key.parse() {
                        Ok(number) => self.whole(number),
                        Err(_) => self.text(key),
                    }
                    self.put(entry);
                }
                self.bytes.push(b'u');
            }
            Entry::Tensor(shape, values) => self.tensor(shape, values),
        }
    }

    /// `torch._utils._rebuild_tensor_v2(storage, 0, shape, stride, False, OrderedDict())`.
    fn tensor(&mut self, shape: &[usize], values: &[f32]) {
        self.bytes.extend(b"ctorch._utils\n_rebuild_tensor_v2\n((");
        self.text("storage");
        self.bytes.extend(b"ctorch\nFloatStorage\n");
        self.text(&self.storages.len().to_string());
        self.text("cpu");
        self.whole(values.len() as i32);
        self.bytes.extend(b"tQ");
        self.whole(0);
        let stride: Vec<usize> = (0..shape.len()).map(|i| shape[i + 1..].iter().product()).collect();
        for extents in [shape, &stride] {
            self.bytes.push(b'(');
            extents.iter().for_each(|&extent| self.whole(extent as i32));
            self.bytes.push(b't');
        }
        self.bytes.push(0x89);
        self.bytes.extend(b"ccollections\nOrderedDict\n)RtR");
        self.storages.push(values.to_vec());
    }

    fn whole(&mut self, value: i32) {
        self.bytes.push(b'J');
        self.bytes.extend(value.to_le_bytes());
    }

    fn text(&mut self, text: &str) {
        self.bytes.push(b'X');
        self.bytes.extend((text.len() as u32).to_le_bytes());
        self.bytes.extend(text.as_bytes());
    }
}
