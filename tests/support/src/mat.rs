//! MAT files of level 5, for tests of what reads them.

/// An array for [`mat_file`].
#[derive(Clone, Copy, Debug)]
pub struct MatEntry<'a> {
    /// The array's name.
    pub name: &'a str,
    /// Length along each axis.
    pub shape: &'a [u32],
    /// MATLAB's class: 6 `double`, 7 `single`, 9 `uint8`.
    pub class: u32,
    /// How the elements are stored: 2 as bytes, 7 in single, 9 in double precision.
    pub stored: u32,
    /// The elements, little-endian; the first index runs fastest.
    pub data: &'a [u8],
}

impl<'a> MatEntry<'a> {
    /// Bytes, or truth values.
    pub fn bytes(name: &'a str, shape: &'a [u32], data: &'a [u8]) -> Self {
        Self { name, shape, class: 9, stored: 2, data }
    }

    /// Numbers in double precision, given as their bytes.
    pub fn doubles(name: &'a str, shape: &'a [u32], data: &'a [u8]) -> Self {
        Self { name, shape, class: 6, stored: 9, data }
    }

    /// The array as a data element.
    pub fn element(&self) -> Vec<u8> {
        let element = |kind: u32, data: &[u8]| {
            let mut bytes = [kind, data.len() as u32].map(u32::to_le_bytes).concat();
            bytes.extend(data);
            bytes.resize(bytes.len().next_multiple_of(8), 0);
            bytes
        };
        let shape: Vec<u8> = self.shape.iter().flat_map(|length| length.to_le_bytes()).collect();
        let parts = [
            element(6, &[self.class, 0].map(u32::to_le_bytes).concat()),
            element(5, &shape),
            element(1, self.name.as_bytes()),
            element(self.stored, self.data),
        ];
        element(14, &parts.concat())
    }
}

/// The header of a little-endian file.
pub fn mat_header() -> Vec<u8> {
    let mut bytes = b"MATLAB 5.0 MAT-file".to_vec();
    bytes.resize(124, b' ');
    bytes.extend([0x00, 0x01, b'I', b'M']);
    bytes
}

/// A file of these arrays, not deflated.
pub fn mat_file(arrays: &[MatEntry]) -> Vec<u8> {
    arrays.iter().fold(mat_header(), |file, array| [file, array.element()].concat())
}
